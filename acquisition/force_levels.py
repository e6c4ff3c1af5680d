"""Normal forces of the runs of a campaign against their nominal levels: the zero of a load cell, files exchanged."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from acquisition.force import STATED_LIMIT
from ema.data import Finding, Run

Nominal = Mapping[str, Mapping[str, float]]
"""Nominal force in N of each joint of each run that states one."""

CHANCE = 0.01
"""Chance that a load cell with a right zero is named for its zero; its 95 % interval is stated."""

ZERO_LIMIT = 0.01
"""Zero, as a fraction of the least nominal level, up to which it is of no account: what a drift may be
(`acquisition.force_drift.DRIFT_LIMIT`)."""

FITS = 4.0
"""Standard deviations of the logarithm of measured over nominal force within which a run fits a level, and beyond which
it does not: both runs of a pair have to do both. Of normal values one in 16 000 is beyond it."""

_LEAST_SCATTER = 0.02
"""The least scatter of measured over nominal forces that is assumed: no hand sets a screw more exactly."""

_USUAL_SCATTER = 0.1
"""That of a campaign with too few other runs to tell."""

_NOT_AS_STATED = "normal-force-not-as-stated"


@dataclass(frozen=True)
class _Zero:
    """Measured = gain nominal + zero, with halves of 95 % intervals; the levels that it comes from."""

    gain: float
    gain_half: float
    zero: float
    zero_half: float
    certain: bool
    least: float
    levels: int


def against_nominal_levels(runs: Sequence[Run], nominal: Nominal) -> tuple[tuple[Run, ...], tuple[Finding, ...]]:
    """Runs of a campaign without the findings that a cause for several of them explains, and findings of those causes.

    Parameters
    ----------
    runs : of the campaign.
    nominal : force of the joints that have a nominal one, by run and joint.
    """
    measured = {
        run.id: {
            joint.joint: joint.mean
            for joint in run.condition.joints
            if joint.known and joint.mean > 0 and joint.joint in nominal.get(run.id, {})
        }
        for run in runs
    }
    measured = {name: forces for name, forces in measured.items() if forces}
    findings, explained = [], set()
    for one, other in _exchanged(measured, nominal):
        findings.append(_exchange(one, other, measured, nominal))
        explained |= {(name, joint) for name in (one, other) for joint in measured.pop(name)}
    for joint in dict.fromkeys(joint for forces in measured.values() for joint in forces):
        pairs = {name: (nominal[name][joint], forces[joint]) for name, forces in measured.items() if joint in forces}
        zero = _zero(list(pairs.values()))
        if zero is None or not zero.certain or abs(zero.zero) < ZERO_LIMIT * zero.least:
            continue
        findings.append(_of_zero(joint, zero))
        line = {name: zero.gain * level + zero.zero for name, (level, _) in pairs.items()}
        explained |= {
            (name, joint) for name, (_, force) in pairs.items() if 1 / STATED_LIMIT < force / line[name] < STATED_LIMIT
        }
    kept = []
    for run in runs:
        places = tuple(f"run {run.id}, joint {joint}" for name, joint in explained if name == run.id)
        left = tuple(one for one in run.findings if one.code != _NOT_AS_STATED or one.where not in places)
        kept.append(replace(run, findings=left) if len(left) < len(run.findings) else run)
    return tuple(kept), tuple(findings)


def _exchanged(measured: Mapping[str, Mapping[str, float]], nominal: Nominal) -> Iterator[tuple[str, str]]:
    """Pairs of runs each of which fits the nominal forces of the other, and not its own; no run twice."""

    def off(name: str, stated: str) -> np.ndarray:
        levels = nominal[stated]
        return np.array([np.log(force / levels[joint]) for joint, force in measured[name].items()])

    own = {name: off(name, name) for name in measured}
    used: set[str] = set()
    for one, other in combinations(_off_their_level(own), 2):
        if {one, other} & used or measured[one].keys() != measured[other].keys():
            continue
        rest = [values for name, values in own.items() if name not in (one, other)]
        values = np.concatenate(rest) if rest else np.zeros(0)
        usual = float(np.median(values)) if len(values) > 2 else 0.0
        spread = 1.4826 * float(np.median(np.abs(values - usual))) if len(values) > 2 else _USUAL_SCATTER
        limit = FITS * max(spread, _LEAST_SCATTER)
        crossed = [np.abs(off(*pair) - usual) for pair in ((one, other), (other, one))]
        if all(np.all(np.abs(own[name] - usual) > limit) for name in (one, other)) and all(
            np.all(each < limit) for each in crossed
        ):
            used |= {one, other}
            yield one, other


def _off_their_level(own: Mapping[str, np.ndarray]) -> list[str]:
    """Runs that can be off their nominal forces whichever two are left out: the others need no look at all pairs.

    Leaving out ``out`` values moves a median by ``out / 2`` ranks at most, and that of distances by as many and by what
    the centre moves.
    """
    values = np.sort(np.concatenate([np.zeros(0), *own.values()]))
    out = 2 * max(map(len, own.values()), default=0)
    if len(values) - out <= 2:
        return list(own)
    first, last = (len(values) - 1 - out) // 2, -(-(len(values) - 1 + out) // 2)
    low, high = values[max(first, 0)], values[min(last, len(values) - 1)]
    distances = np.sort(np.abs(values - (low + high) / 2))
    spread = 1.4826 * (distances[max(first, 0)] - (high - low) / 2)
    limit = FITS * max(spread, _LEAST_SCATTER)
    return [name for name, off in own.items() if np.all(np.maximum(np.abs(off - low), np.abs(off - high)) > limit)]


def _exchange(one: str, other: str, measured: Mapping[str, Mapping[str, float]], nominal: Nominal) -> Finding:
    first, second = (float(np.mean(list(measured[name].values()))) for name in (one, other))
    stated = [float(np.mean([nominal[name][joint] for joint in measured[name]])) for name in (one, other)]
    return Finding.of(
        "warning",
        "normal-force-exchanged",
        f"runs {one}, {other}",
        "Run {one} was measured at {first} N where {first_nominal} N are nominal, and run {other} at {second} N where "
        "{second_nominal} N are: each fits the level of the other, as if their files had been exchanged.",
        advice="Exchange the files of the two runs in the campaign file, or correct their nominal forces.",
        one=one,
        other=other,
        first=f"{first:.4g}",
        second=f"{second:.4g}",
        first_nominal=f"{stated[0]:.4g}",
        second_nominal=f"{stated[1]:.4g}",
    )


def _zero(pairs: Sequence[tuple[float, float]]) -> _Zero | None:
    """Line of measured over nominal forces; runs at one level share how it was set, and count once.

    What a level is off may be a share of it or the same at all levels: the line is fitted with weights for either, and
    the zero is certain where it is with both. Stated is the less certain of the two.
    """
    from scipy.stats import t

    levels = np.array(sorted({nominal for nominal, _ in pairs}))
    if len(levels) < 3:
        return None
    means = np.array([np.mean([force for nominal, force in pairs if nominal == level]) for level in levels])
    results = []
    for weights in (1 / levels, np.full(len(levels), 1 / np.mean(levels))):
        matrix = np.stack([levels, np.ones(len(levels))], axis=1) * weights[:, None]
        solution, *_ = np.linalg.lstsq(matrix, means * weights, rcond=None)
        freedom = len(levels) - 2
        variance = np.sum((matrix @ solution - means * weights) ** 2) / freedom
        std = np.sqrt(variance * np.diag(np.linalg.inv(matrix.T @ matrix)))
        half = t.isf(0.025, freedom) * std
        certain = bool(abs(solution[1]) > t.isf(CHANCE / 2, freedom) * std[1])
        gain, zero = (float(value) for value in solution)
        results.append(_Zero(gain, float(half[0]), zero, float(half[1]), certain, float(levels[0]), len(levels)))
    widest = max(results, key=lambda one: one.zero_half)
    return replace(widest, certain=all(one.certain for one in results))


def _of_zero(joint: str, zero: _Zero) -> Finding:
    return Finding.of(
        "warning",
        "normal-force-zero",
        f"joint {joint}",
        "Over {levels} nominal levels the measured normal force is {gain} ± {gain_half} times the nominal one and "
        "{zero} ± {zero_half} N: the zero of the load cell is off, or the nominal forces are.",
        zero.zero,
        zero.zero_half,
        advice="Read the load cell with the joint loose, and correct its zero by that.",
        levels=str(zero.levels),
        gain=f"{zero.gain:.4g}",
        gain_half=f"{zero.gain_half:.2g}",
        zero=f"{zero.zero:+.4g}",
        zero_half=f"{zero.zero_half:.2g}",
    )
