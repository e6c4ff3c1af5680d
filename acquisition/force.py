"""The normal force of each joint during a run: from a channel of the records, from side data, stated, or unknown."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Float

from acquisition import units
from acquisition.campaign_file import JointTable, NormalForceTable, RunTable
from acquisition.columns import column, moment, numbers, read_columns
from acquisition.force_cross_talk import cross_talk_findings
from acquisition.force_drift import drift_findings
from acquisition.force_units import against_other_joints, is_kilo, other_unit, unit_findings
from ema.data import Finding, JointForce, Recording
from ema.errors import InputError

STATED_LIMIT = 1.3
"""Ratio of the measured normal force to the nominal one, or its inverse, up to which the nominal one was reached.

Tightening by torque scatters by a third; half of it would name every second bolt."""

SCATTER_LIMIT = 0.10
"""Largest deviation of a joint from the mean of all joints, as a fraction of it."""

_BLOCKS = 64
"""Block means of a trace at most."""
_TENTH = 6
"""Block means that are a tenth of a record."""
_ENDS = 0.1
"""Share of the time of a trace at either end whose means make its drift."""
_ROUNDING = 1e-12
"""Range of a trace over its mean up to which it is constant: rounding of doubles over a sum."""


@dataclass(frozen=True)
class Trace:
    """Normal force (sample,) in N at times (sample,) in s from the start of the run; mean and standard deviation of
    all that was measured, of which the values may be block means; the share of samples that are no numbers."""

    times: Float[np.ndarray, "sample"]
    values: Float[np.ndarray, "sample"]
    mean: float
    std: float
    lost: float = 0.0


@dataclass(frozen=True)
class Span:
    """When a run was measured (UTC); ``None`` where its records carry no time."""

    start: datetime | None = None
    stop: datetime | None = None


def joint_forces(
    run: RunTable,
    joints: Sequence[JointTable],
    records: Sequence[Recording],
    span: Span,
    folders: Sequence[Path],
    where: str,
) -> tuple[tuple[JointForce, ...], tuple[Finding, ...]]:
    """Normal force of every joint of a run, with what is wrong about it.

    Parameters
    ----------
    records : of the run; read only where a channel measures a normal force.
    folders : of the campaign and of its data, where side data are looked for.

    Raises
    ------
    InputError : side data are absent, have no such column, or none within the time of the run.
    """
    stated = {table.joint: table for table in run.normal_force}
    on_records = _joints_on_records(records) if records else {}
    if run.beam is False:
        return (), cross_talk_findings(records, on_records, run.kind, where)
    if not (stated or run.beam or on_records):
        return (), ()
    names = list(dict.fromkeys([*(joint.name for joint in joints), *stated, *on_records])) or ["beam"]
    cells = {joint.name: joint for joint in joints}
    forces: list[JointForce] = []
    findings: list[Finding] = []
    sampled: dict[str, str] = {}
    for name in names:
        table = stated.get(name, NormalForceTable(joint=name))
        channel = table.channel or ("" if table.file or table.value else on_records.get(name, ""))
        sampled |= {name: channel} if channel else {}
        force, lost = _measured(table, channel, records, span, folders, f"{where}, joint {name}")
        findings += lost
        forces.append(replace(force, calibration=_calibration(cells.get(name))))
    nominal = _nominal(run)
    findings += _findings(forces, nominal, set(sampled), where)
    return tuple(forces), (*findings, *cross_talk_findings(records, sampled, run.kind, where))


def nominal_forces(runs: Sequence[RunTable]) -> dict[str, dict[str, float]]:
    """Nominal normal force in N of each joint that has one, by run."""
    return {run.id: _nominal(run) for run in runs}


def _nominal(run: RunTable) -> dict[str, float]:
    return {
        table.joint: units.measure(table.nominal, "force")[0] for table in run.normal_force if table.nominal is not None
    }


def _measured(
    table: NormalForceTable, channel: str, records: Sequence[Recording], span: Span, folders: Sequence[Path], where: str
) -> tuple[JointForce, tuple[Finding, ...]]:
    noted = JointForce(
        table.joint,
        torque=None if table.torque is None else units.measure(table.torque, "torque")[0],
        sequence=table.sequence,
        run_in=table.run_in,
    )
    if table.value is not None:
        std = float("nan") if table.std is None else units.measure(table.std, "force")[0]
        return replace(noted, mean=units.measure(table.value, "force")[0], std=std), ()
    if not channel and not table.file:
        return noted, ()
    trace = _of_channel(records, channel, where) if channel else _of_side_data(table, span, folders, where)
    force = replace(
        noted,
        mean=trace.mean,
        std=trace.std,
        drift=drift(trace),
        trace=trace.values,
        trace_times=trace.times,
    )
    return force, _lost(trace, where)


def _lost(trace: Trace, where: str) -> tuple[Finding, ...]:
    """A finding where samples of a normal force are no numbers."""
    if not trace.lost:
        return ()
    return (
        Finding.of(
            "warning",
            "not-finite",
            where,
            "{lost} % of the samples of the normal force are not numbers; its mean is that of the others.",
            trace.lost,
            0.0,
            advice="Check the load cell, its cable and the export.",
            lost=f"{100 * trace.lost:.2g}",
        ),
    )


def drift(trace: Trace) -> float:
    """End minus start in N: the mean over the last tenth of the time less that over the first (NaN for one value)."""
    if len(trace.values) < 2:
        return float("nan")
    first, last = trace.times[0], trace.times[-1]
    end = _ENDS * (last - first)
    return float(np.mean(trace.values[trace.times >= last - end]) - np.mean(trace.values[trace.times <= first + end]))


def _of_channel(records: Sequence[Recording], channel: str, where: str) -> Trace:
    """Block means of a channel over all records; the standard deviation is that of all samples."""
    if not records:
        raise InputError(
            "the run has no records, so no channel of a record",
            where=where,
            got=channel,
            advice="state the value or the file of the normal force in place of the channel",
        )
    times: list[float] = []
    values: list[float] = []
    weight, total, squares, samples = 0, 0.0, 0.0, 0
    elapsed, start = 0.0, None
    for record in records:
        names = [line.name for line in record.channels]
        if channel not in names:
            raise InputError(
                "no such normal-force channel in the record",
                where=f"{where}, {record.name}",
                got=channel,
                expected="one of " + ", ".join(names),
            )
        if not record.channels[names.index(channel)].scaled:
            raise InputError("a normal force without a unit", where=where, got=channel, advice='state unit = "N"')
        quantity = record.channels[names.index(channel)].quantity
        if quantity != "force":
            raise InputError(
                "the channel of a normal force measures no force",
                where=f"{where}, {record.name}, channel {channel}",
                got=quantity,
                expected="force",
                advice='add sensitivity = "0.5 mV/N" (or what the load cell has)'
                if quantity == "voltage"
                else "correct the channel or its unit",
            )
        signal = np.asarray(record.signals[names.index(channel)], dtype=np.float64)
        if record.start is not None:
            start = start or record.start
            elapsed = (record.start - start).total_seconds()
        edges = np.linspace(0, len(signal), min(_BLOCKS, len(signal)) + 1).astype(int)
        number = np.isfinite(signal)
        signal = np.where(number, signal, 0.0)
        counts = np.add.reduceat(number.astype(np.int64), edges[:-1])
        sums = np.add.reduceat(signal, edges[:-1])[counts > 0]
        values += list(sums / counts[counts > 0])
        times += list((elapsed + 0.5 * (edges[:-1] + edges[1:]) / record.sampling_rate)[counts > 0])
        samples, weight = samples + len(signal), weight + int(counts.sum())
        total, squares = total + signal.sum(), squares + float(signal @ signal)
        elapsed += record.duration
    if not weight:
        raise InputError(
            "the channel of a normal force holds no numbers",
            where=where,
            got=f"{samples} samples that are NaN or infinite",
            advice="state the value of the normal force, or leave the channel out",
        )
    mean = total / weight
    std = float(np.sqrt(max(squares / weight - mean**2, 0.0)))
    order = np.argsort(times, kind="stable")
    return Trace(np.array(times)[order], np.array(values)[order], float(mean), std, 1 - weight / samples)


def _of_side_data(table: NormalForceTable, span: Span, folders: Sequence[Path], where: str) -> Trace:
    """The part of a column of side data that was written during the run."""
    paths = [folder / table.file for folder in folders]
    path = next((path for path in paths if path.is_file()), paths[0])
    label = f"{where}, {table.file}"
    columns = read_columns(path)
    unit = units.parse(str(table.unit))
    values = unit.to_si(numbers(column(columns, table.column, label), f"{label}, column {table.column}"))
    times = _times(table, columns, span, label)
    inside = np.isfinite(times)
    if table.between is not None:
        low, high = (units.measure(text, "time")[0] for text in table.between)
        inside &= (times >= low) & (times <= high)
    elif span.start is not None and span.stop is not None and _dated(table, columns):
        inside &= (times >= 0) & (times <= (span.stop - span.start).total_seconds())
    during, inside = int(inside.sum()), inside & np.isfinite(values)
    if not inside.any():
        raise InputError(
            "no normal force within the time of the run",
            where=label,
            got=f"{len(values)} values" + (f" from {times.min():g} to {times.max():g} s" if len(values) else ""),
            advice="check start, between and the clock of the front end",
        )
    times, values = times[inside], values[inside]
    begin = times[0] if table.between else 0.0
    return Trace(times - begin, values, float(np.mean(values)), float(np.std(values)), 1 - len(values) / during)


def _dated(table: NormalForceTable, columns: dict[str, list[str]]) -> bool:
    return bool(table.time) and (bool(table.start) or _is_moment(columns.get(table.time, [""])[0]))


def _is_moment(text: str) -> bool:
    return len(text) >= 10 and text[4:5] == "-" and text[7:8] == "-"


def _times(table: NormalForceTable, columns: dict[str, list[str]], span: Span, where: str) -> Float[np.ndarray, "n"]:
    """Seconds from the start of the run (of the table, where nothing says when either was)."""
    rows = len(column(columns, table.column, where))
    if not table.time:
        return np.arange(rows, dtype=np.float64)
    texts = column(columns, table.time, where)
    if texts and _is_moment(texts[0]):
        moments = [moment(text, where) for text in texts]
        zero = span.start or moments[0]
        return np.array([(each - zero).total_seconds() for each in moments])
    if table.time_unit is None:
        raise InputError("the time column has no unit", where=where, got=table.time, advice='add time_unit = "s"')
    unit = units.parse(table.time_unit)
    if unit.quantity != "time":
        raise InputError(
            "the unit of the time column is no time",
            where=where,
            got=table.time_unit,
            expected="s, ms, min",
            advice="correct time_unit",
        )
    seconds = np.asarray(unit.to_si(numbers(texts, f"{where}, column {table.time}")), dtype=np.float64)
    if table.start and span.start is not None:
        return seconds + (moment(table.start, where) - span.start).total_seconds()
    return seconds


def span_of(records: Sequence[Recording], samples: Sequence[int]) -> Span:
    """From the start of the first record to the end of the last, by their headers and lengths."""
    if any(record.start is None for record in records) or not records:
        return Span()
    starts = [moment(record.start.isoformat(), "") for record in records if record.start is not None]
    stops = [
        start + timedelta(seconds=count / record.sampling_rate)
        for start, record, count in zip(starts, records, samples, strict=True)
    ]
    return Span(min(starts), max(stops))


def _joints_on_records(records: Sequence[Recording]) -> dict[str, str]:
    """Channels that measure the normal force of a joint, by the joint's name."""
    return {
        channel.joint: channel.name
        for channel in records[0].channels
        if channel.role == "normal force" and channel.joint
    }


def _calibration(joint: JointTable | None) -> str:
    if joint is None:
        return ""
    return ", ".join(filter(None, (joint.load_cell, joint.calibrated_on and f"calibrated on {joint.calibrated_on}")))


def _findings(forces: Sequence[JointForce], nominal: dict[str, float], sampled: set[str], where: str) -> list[Finding]:
    """``sampled`` are the joints whose force is a channel of the records."""
    findings = []
    for force in forces:
        label = f"{where}, joint {force.joint}"
        if not force.known:
            findings.append(
                Finding(
                    "error",
                    "normal-force-unknown",
                    label,
                    "The beam was pressed by a normal force that nobody stated.",
                    advice=(
                        "Measure it, or state it in [[runs.normal_force]]; comparison and placement refuse this run."
                    ),
                )
            )
            continue
        findings += unit_findings(force, nominal.get(force.joint), label)
        findings += _against_nominal(force, nominal.get(force.joint), label)
        of_sensor = _sensor_findings(force, label, sampled=force.joint in sampled)
        findings += of_sensor
        if not any(finding.code == "normal-force-none" for finding in of_sensor):
            findings += drift_findings(force, label, _TENTH if force.joint in sampled else None)
    known = [force for force in forces if force.known]
    if any(one.code == "normal-force-unit" for one in findings):  # scatter is what follows from it
        return findings
    if between := against_other_joints(known, nominal, where):
        return [*findings, *between]
    mean = float(np.mean([force.mean for force in known])) if known else 0.0
    if len(known) > 1 and mean:
        worst = max(known, key=lambda force: abs(force.mean - mean))
        scatter = abs(worst.mean / mean - 1)
        if scatter > SCATTER_LIMIT:
            findings.append(
                Finding.of(
                    "warning",
                    "normal-force-scatter",
                    where,
                    "Joint {joint} is pressed by {mean} N, {difference} % off the mean of all joints of "
                    "{mean_of_all} N.",
                    scatter,
                    SCATTER_LIMIT,
                    advice="Tighten the joints evenly, or compare joint by joint.",
                    joint=worst.joint,
                    mean=f"{worst.mean:.4g}",
                    difference=f"{100 * scatter:.0f}",
                    mean_of_all=f"{mean:.4g}",
                )
            )
    return findings


def _against_nominal(force: JointForce, nominal: float | None, place: str) -> list[Finding]:
    """A mean that is not the nominal force, nor that in another unit."""
    ratio = abs(force.mean) / nominal if nominal else 1.0
    if 1 / STATED_LIMIT <= ratio <= STATED_LIMIT or is_kilo(ratio):
        return []
    unit = other_unit(ratio, STATED_LIMIT)
    return [
        Finding.of(
            "warning",
            "normal-force-not-as-stated",
            place,
            "The normal force is {mean} N, and {nominal} N are stated as nominal: the condition is the "
            "one that was measured.",
            ratio,
            STATED_LIMIT,
            advice="Look for {unit} taken for N, or N for {unit}, in the unit, the sensitivity and the nominal force."
            if unit
            else "Correct the nominal force, or the sensitivity and the zero of the load cell.",
            mean=f"{force.mean:.4g}",
            nominal=f"{nominal:.4g}",
            unit=unit,
        )
    ]


def _sensor_findings(force: JointForce, place: str, *, sampled: bool) -> list[Finding]:
    """A joint is pressed, never pulled; and a sensor that measures is never quite at rest."""
    findings = []
    if sampled and 0 < abs(force.mean) < force.std and abs(force.drift) < force.std:
        return [
            Finding.of(
                "error",
                "normal-force-none",
                place,
                "The normal force of {mean} N is less than it scatters by, {std} N: the load cell shows no "
                "force, or the joint opens.",
                force.mean,
                force.std,
                advice=(
                    "Check cable and amplifier of the load cell; state the force as value where it is known otherwise."
                ),
                mean=f"{force.mean:.4g}",
                std=f"{force.std:.4g}",
            )
        ]
    if force.mean < 0:
        findings.append(
            Finding.of(
                "error",
                "normal-force-negative",
                place,
                "The normal force is {mean} N: the joint would be pulled apart.",
                force.mean,
                0.0,
                advice=(
                    "Where the load cell counts compression negative, turn it round: a sensitivity with a minus, "
                    'or the repair what = "reverse sign". Otherwise correct its zero.'
                ),
                mean=f"{force.mean:.4g}",
            )
        )
    if sampled and force.trace is not None and np.ptp(force.trace) <= _ROUNDING * abs(force.mean):
        findings.append(
            Finding.of(
                "warning",
                "normal-force-constant",
                place,
                "All samples of the normal force are {mean} N: a load cell that measures has noise.",
                force.mean,
                advice="Check its cable and its amplifier; a force that is known otherwise is stated as value.",
                mean=f"{force.mean:.4g}",
            )
        )
    return findings
