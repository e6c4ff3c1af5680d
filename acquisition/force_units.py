"""Normal forces in another unit than the one stated: a thousand times off what stands beside them, or off a torque.

A factor that all normal forces of a campaign share is seen only where a nominal force or a torque is stated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ema.data import Finding, JointForce, Run
from ema.messages import mark

_KILO = (300.0, 3000.0)
"""Ratios that are the thousand of kN taken for N, with a force off by a factor of three besides."""

_GAP = np.sqrt(1000.0)
"""Ratio of neighbouring forces of a campaign from which on the lower may be the upper in another unit."""

_OFTEN = 0.05
"""Share of the values of a trace from which on those of another unit are no single faults."""

_PER_TORQUE = (70.0, 50_000.0)
"""N per N m of the forces that a torque gives, n T / (K d) (VDI 2230): from one bolt M36 with a nut factor K of 0.4 to
eight bolts M2 with 0.08. Of bolts M3 to M24 a thousandth and the thousandfold lie outside."""

_OTHER_UNITS = {"lbf": 4.4482, "kgf": 9.80665}
"""N of other units of force (NIST SP 811)."""


def is_kilo(ratio: float) -> bool:
    """Whether a ratio of forces, or its inverse, is that of kN to N."""
    return _KILO[0] < max(ratio, 1 / max(ratio, 1e-300)) < _KILO[1]


def other_unit(ratio: float, limit: float) -> str:
    """The unit that a ratio of forces, or its inverse, is within a factor ``limit`` of; empty where none is."""
    factor = max(ratio, 1 / max(ratio, 1e-300))
    return next((unit for unit, newtons in _OTHER_UNITS.items() if 1 / limit <= factor / newtons <= limit), "")


def unit_findings(force: JointForce, nominal: float | None, place: str) -> list[Finding]:
    """A factor of a thousand against the nominal force, within the record, or against the torque."""
    values = np.array([force.mean]) if force.trace is None else force.trace
    reference = nominal if nominal else float(np.median(values))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(values / reference)
    large = (ratio > _KILO[0]) & (ratio < _KILO[1])
    small = (ratio > 1 / _KILO[1]) & (ratio < 1 / _KILO[0])
    share = float(np.mean(large | small))
    if share < _OFTEN:
        return [] if nominal else _against_torque(force, place)
    against = mark("the nominal force") if nominal else mark("the rest of its record")
    factor = float(np.median(ratio[large | small]))
    return [
        Finding.of(
            "error",
            "normal-force-unit",
            place,
            "{share} % of the normal force values are {factor} times {against} of {reference} N, as if "
            "kN had been taken for N.",
            factor,
            1.0,
            advice="Correct the unit of this joint in the campaign file, or its side data.",
            share=f"{100 * share:.0f}",
            factor=f"{factor:.4g}",
            against=against,
            reference=f"{reference:.4g}",
        )
    ]


def _against_torque(force: JointForce, place: str) -> list[Finding]:
    if not force.torque or not force.mean:
        return []
    least, largest = (per_torque * force.torque for per_torque in _PER_TORQUE)
    if least <= abs(force.mean) <= largest:
        return []
    return [
        Finding.of(
            "warning",
            "normal-force-unit",
            place,
            "The normal force is {mean} N, and a torque of {torque} N m gives {least} to {largest} N, by bolts from "
            "M36 to M2: the unit of one of them is another one.",
            abs(force.mean),
            least if abs(force.mean) < least else largest,
            advice="Correct the unit of the normal force or of the torque in the campaign file, or the side data.",
            mean=f"{force.mean:.4g}",
            torque=f"{force.torque:.4g}",
            least=f"{least:.2g}",
            largest=f"{largest:.2g}",
        )
    ]


def against_other_joints(forces: Sequence[JointForce], nominal: Mapping[str, float], where: str) -> list[Finding]:
    """A finding where a joint of a run is a thousand times as much pressed as another, and not both have a nominal
    force, which says which unit is meant.
    """
    known = sorted((force for force in forces if force.mean > 0), key=lambda force: force.mean)
    if len(known) < 2 or not is_kilo(known[-1].mean / known[0].mean):
        return []
    if known[0].joint in nominal and known[-1].joint in nominal:
        return []
    low, high = known[0], known[-1]
    return [
        Finding.of(
            "error",
            "normal-force-unit",
            where,
            "Joint {low} is pressed by {least} N and joint {high} by {largest} N, as if kN had been taken for N.",
            high.mean / low.mean,
            1.0,
            advice="Correct the unit of one of the joints in the campaign file, or its side data.",
            low=low.joint,
            high=high.joint,
            least=f"{low.mean:.4g}",
            largest=f"{high.mean:.4g}",
        )
    ]


def against_other_runs(runs: Sequence[Run], nominal: Mapping[str, Mapping[str, float]]) -> tuple[Run, ...]:
    """Runs of a campaign, with a finding where their normal forces fit the others a thousand times as large or small.

    Parameters
    ----------
    runs : of the campaign.
    nominal : nominal force of the joints that have one, by run and joint; it says which unit is meant.
    """
    known = {run.id: run.condition.normal_force for run in runs if run.condition.normal_force > 0}
    names = sorted(known, key=lambda name: known[name])
    forces = np.array([known[name] for name in names])
    if len(forces) < 3:
        return tuple(runs)
    steps = forces[1:] / forces[:-1]
    split = int(np.argmax(steps)) + 1
    few, many = sorted((slice(0, split), slice(split, len(forces))), key=lambda part: len(forces[part]))
    right = forces[few] * (1000.0 if few.start == 0 else 0.001)
    fits = np.all((right >= 0.5 * forces[many].min()) & (right <= 2 * forces[many].max()))
    if steps[split - 1] <= _GAP or not fits or len(forces[many]) < 2:
        return tuple(runs)
    named = {name for name in names[few] if not nominal.get(name)}
    nearest = float(forces[many][0 if few.start == 0 else -1])
    return tuple(
        replace(run, findings=(*run.findings, _of_run(run.id, known[run.id], nearest))) if run.id in named else run
        for run in runs
    )


def _of_run(name: str, force: float, nearest: float) -> Finding:
    return Finding.of(
        "error",
        "normal-force-unit",
        f"run {name}",
        "The normal force is {mean} N, {times} times the nearest one of the other runs of {nearest} N, as if kN had "
        "been taken for N.",
        force / nearest,
        1.0,
        advice="Correct the unit of this run in the campaign file, or its side data; where the force was meant, state "
        "it as nominal.",
        mean=f"{force:.4g}",
        times=f"{force / nearest:.4g}",
        nearest=f"{nearest:.4g}",
    )
