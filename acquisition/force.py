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
from ema.data import Finding, JointForce, Recording
from ema.errors import InputError

DRIFT_LIMIT = 0.05
"""Drift over a run, as a fraction of the mean, up to which a normal force counts as constant."""

SCATTER_LIMIT = 0.10
"""Largest deviation of a joint from the mean of all joints, as a fraction of it."""

_KILO = (300.0, 3000.0)
_BLOCKS = 64
_ENDS = 0.1
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Trace:
    """Normal force (sample,) in N at times (sample,) in s from the start of the run; mean and standard deviation of
    all that was measured, of which the values may be block means."""

    times: Float[np.ndarray, "sample"]
    values: Float[np.ndarray, "sample"]
    mean: float
    std: float


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
    if run.beam is False or not (stated or run.beam or on_records):
        return (), ()
    names = list(dict.fromkeys([*(joint.name for joint in joints), *stated, *on_records])) or ["beam"]
    cells = {joint.name: joint for joint in joints}
    forces: list[JointForce] = []
    sampled: set[str] = set()
    for name in names:
        table = stated.get(name, NormalForceTable(joint=name))
        channel = table.channel or ("" if table.file or table.value else on_records.get(name, ""))
        sampled |= {name} if channel else set()
        force = _measured(table, channel, records, span, folders, f"{where}, joint {name}")
        forces.append(replace(force, calibration=_calibration(cells.get(name))))
    nominal = {name: units.measure(table.nominal, "force")[0] for name, table in stated.items() if table.nominal}
    return tuple(forces), tuple(_findings(forces, nominal, sampled, where))


def _measured(
    table: NormalForceTable, channel: str, records: Sequence[Recording], span: Span, folders: Sequence[Path], where: str
) -> JointForce:
    noted = JointForce(
        table.joint,
        torque=None if table.torque is None else units.measure(table.torque, "torque")[0],
        sequence=table.sequence,
        run_in=table.run_in,
    )
    if table.value is not None:
        std = float("nan") if table.std is None else units.measure(table.std, "force")[0]
        return replace(noted, mean=units.measure(table.value, "force")[0], std=std)
    if not channel and not table.file:
        return noted
    trace = _of_channel(records, channel, where) if channel else _of_side_data(table, span, folders, where)
    return replace(
        noted,
        mean=trace.mean,
        std=trace.std,
        drift=drift(trace),
        trace=trace.values,
        trace_times=trace.times,
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
        raise InputError("the run has no records, so no channel of a record", where=where, got=channel)
    times: list[float] = []
    values: list[float] = []
    weight, total, squares = 0, 0.0, 0.0
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
        sums = np.add.reduceat(signal, edges[:-1])
        values += list(sums / np.diff(edges))
        times += list(elapsed + 0.5 * (edges[:-1] + edges[1:]) / record.sampling_rate)
        weight, total, squares = weight + len(signal), total + signal.sum(), squares + float(signal @ signal)
        elapsed += record.duration
    mean = total / weight
    std = float(np.sqrt(max(squares / weight - mean**2, 0.0)))
    order = np.argsort(times, kind="stable")
    return Trace(np.array(times)[order], np.array(values)[order], float(mean), std)


def _of_side_data(table: NormalForceTable, span: Span, folders: Sequence[Path], where: str) -> Trace:
    """The part of a column of side data that was written during the run."""
    paths = [folder / table.file for folder in folders]
    path = next((path for path in paths if path.is_file()), paths[0])
    place = f"{where}, {table.file}"
    columns = read_columns(path)
    unit = units.parse(str(table.unit))
    values = unit.to_si(numbers(column(columns, table.column, place), f"{place}, column {table.column}"))
    times = _times(table, columns, span, place)
    inside = np.isfinite(values) & np.isfinite(times)
    if table.between is not None:
        low, high = (units.measure(text, "time")[0] for text in table.between)
        inside &= (times >= low) & (times <= high)
    elif span.start is not None and span.stop is not None and _dated(table, columns):
        inside &= (times >= 0) & (times <= (span.stop - span.start).total_seconds())
    if not inside.any():
        raise InputError(
            "no normal force within the time of the run",
            where=place,
            got=f"{len(values)} values" + (f" from {times.min():g} to {times.max():g} s" if len(values) else ""),
            advice="check start, between and the clock of the front end",
        )
    times, values = times[inside], values[inside]
    return Trace(times - (times[0] if table.between else 0.0), values, float(np.mean(values)), float(np.std(values)))


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
        raise InputError("the unit of the time column is no time", where=where, got=table.time_unit)
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
        place = f"{where}, joint {force.joint}"
        if not force.known:
            findings.append(
                Finding(
                    "error",
                    "normal-force-unknown",
                    place,
                    "The beam was pressed by a normal force that nobody stated.",
                    advice=(
                        "Measure it, or state it in [[runs.normal_force]]; comparison and placement refuse this run."
                    ),
                )
            )
            continue
        findings += _unit_findings(force, nominal.get(force.joint), place)
        findings += _sensor_findings(force, place, sampled=force.joint in sampled)
        relative = abs(force.drift / force.mean) if force.mean else float("inf")
        if np.isfinite(force.drift) and force.drift and relative > DRIFT_LIMIT:
            findings.append(
                Finding(
                    "warning",
                    "normal-force-drift",
                    place,
                    f"The normal force drifted by {force.drift:+.3g} N during the run, {100 * relative:.1f} % "
                    "of its mean "
                    f"of {force.mean:.4g} N.",
                    relative,
                    DRIFT_LIMIT,
                    "Let the joint settle, use a strain-gauge ring or re-zero at every point, and measure again.",
                )
            )
    known = [force for force in forces if force.known]
    mean = float(np.mean([force.mean for force in known])) if known else 0.0
    if len(known) > 1 and mean:
        worst = max(known, key=lambda force: abs(force.mean - mean))
        scatter = abs(worst.mean / mean - 1)
        if scatter > SCATTER_LIMIT:
            findings.append(
                Finding(
                    "warning",
                    "normal-force-scatter",
                    where,
                    f"Joint {worst.joint} is pressed by {worst.mean:.4g} N, {100 * scatter:.0f} % off the mean of all "
                    f"joints of {mean:.4g} N.",
                    scatter,
                    SCATTER_LIMIT,
                    "Tighten the joints evenly, or compare joint by joint.",
                )
            )
    return findings


def _sensor_findings(force: JointForce, place: str, *, sampled: bool) -> list[Finding]:
    """A joint is pressed, never pulled; and a sensor that measures is never quite at rest."""
    findings = []
    if force.mean < 0:
        findings.append(
            Finding(
                "error",
                "normal-force-negative",
                place,
                f"The normal force is {force.mean:.4g} N: the joint would be pulled apart.",
                force.mean,
                0.0,
                "Where the load cell counts compression negative, turn it round: a sensitivity with a minus, or the "
                'repair what = "reverse sign". Otherwise correct its zero.',
            )
        )
    if sampled and force.trace is not None and np.ptp(force.trace) <= _ROUNDING * abs(force.mean):
        findings.append(
            Finding(
                "warning",
                "normal-force-constant",
                place,
                f"All samples of the normal force are {force.mean:.4g} N: a load cell that measures has noise.",
                force.mean,
                advice="Check its cable and its amplifier; a force that is known otherwise is stated as value.",
            )
        )
    return findings


def _unit_findings(force: JointForce, nominal: float | None, place: str) -> list[Finding]:
    """A factor of a thousand against the nominal force, or within the record, is a kilonewton taken for a newton."""
    values = np.array([force.mean]) if force.trace is None else force.trace
    reference = nominal if nominal else float(np.median(values))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(values / reference)
    large = (ratio > _KILO[0]) & (ratio < _KILO[1])
    small = (ratio > 1 / _KILO[1]) & (ratio < 1 / _KILO[0])
    if not (large.any() or small.any()):
        return []
    against = "the nominal force" if nominal else "the rest of its record"
    share = float(np.mean(large | small))
    factor = float(np.median(ratio[large | small]))
    return [
        Finding(
            "error",
            "normal-force-unit",
            place,
            f"{100 * share:.0f} % of the normal force values are {factor:.4g} times {against} of "
            f"{reference:.4g} N, as if "
            "kN had been taken for N.",
            factor,
            1.0,
            "Correct the unit of this joint in the campaign file, or its side data.",
        )
    ]
