"""Whether a hammer test sees one linear structure: what follows the level of the impacts, decided before modes are.

A joint that slips under the impact and sticks afterwards rings as a linear structure, so that the misfit of a linear
model is small and its modes are wrong. Two things betray it, and both are compared between impacts on the same point,
where a linear structure has no choice:

- the modal amplitude of the late decay, extrapolated back to the impact, over the force (homogeneity);
- that amplitude over the one read right behind the impact (backward extrapolation, Allen and Mayes, Mechanical Systems
  and Signal Processing 24, 2010). It needs no force. Its level is that of the vibration which the joint goes on to slip
  in, so that what the impact before has left in the joint does not hide how the decay follows it.

What follows the level is nonlinear. What does not follow it is noise, another place of the impact or a bad force
window; a test that has more of it than of noise does not decide.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Literal

import numpy as np
from jaxtyping import Complex, Float

from ema.data import Finding, Lazy, LevelEffect, Run
from ema.data.modal import COVERAGE_FACTOR
from ema.estimate.impact_decays import LATE, FreeDecays, ImpactDecays, free_decays, late_decays
from ema.progress import Progress, silent

TWICE = float(np.log(2.0))
"""Change per factor e of the force that a change for twice the force is."""
CHANGE = 0.045
"""Change of the modal constants with the level (relative, per factor e of the force, root mean square over modes and
points by energy) from which on a structure is named not linear.

Calibrated on the 150 tables of `python -m tests.bench.linearity` with seed 101. Linear tables reach 0.022; of 21
tables that lose less than 0.5 % of the work of the impacts by slip, 20 stay below 0.04; of 39 that lose more than 5 %
and have a readable slope, 37 exceed 0.05. Halved, 4 of the 21 are named; doubled, 34 instead of 37 of the 39.
"""
DECAY_CHANGE = 0.05
"""The same for the late decay over what is measured right behind the impact, per factor e of the vibration there;
noisier, and blind to slip within the contact.

Calibrated on tables of seed 300101. 80 linear ones without a bad force window (20 of each kind) reach 0.034; of 60 with
misplaced impacts five exceed the limit, each by less than twice what noise shows, and none is named. 24 friction tables
that lose more than 5 % by slip are all named, by this or the other change; with the force as level
two of them had been suspect.
"""
EXCESS = 3.0
"""Scatter among impacts on a point that the level does not explain, over that by noise, from which on the place of the
impacts or the force is suspected, and the level has to explain more than chance would."""
HARMLESS = 0.005
"""Relative scatter among impacts on a point that never counts: levels a fifth apart change more by `CHANGE`."""
CLEAR = 3.0
"""Change with the level over what noise alone shows of it, from which on it is beyond noise."""
CHANCE = 0.005
"""Probability of as large a change with the levels interchanged at random among the impacts of a point, up to which the
level is certain to matter: one linear test in 200 reaches it. Where impacts on a point differ by more than noise
explains, nothing else names a structure not linear. Impacts of a hand-held hammer do, by their place and direction:
five impacts on one point, of which one order in 120 is as good by chance, then never decide."""
CERTAIN = 0.5
"""Part of `CHANGE` and `DECAY_CHANGE` from which on a change names a structure where chance is excluded: what linear
tables reach up to `CHANGE` is chance. Of 251 linear tables (seeds 320003, 320004, 320006) none is named by it, nor is
any of 20 that lose less than 0.5 % by slip; of 141 that lose more than 5 % (320001, 320002, 320005) 136 are named
instead of 135."""
LIKELY = 0.2
"""The same probability above which nothing follows the level, however large the change is: with two impacts on one
point it is 1. The largest of six named tables among the first 36 of seed 261129 is 0.12. Above it, impacts that differ
by more than noise explains are no sign of slip either."""
LATER = 0.15
"""Response, relative to that behind the impact, at which the late decay begins if the joint still slips at `LATE`."""
PRECISE = 0.003
"""Relative noise of a modal amplitude above which it counts less than by its energy."""
USABLE = 0.05
"""Relative noise of a modal amplitude above which it is not used."""
FEWEST_POINTS = 12
"""Points struck once from which on their different levels stand for impacts on one point."""
AGAIN = 0.05
"""A further contact of the hammer, over the first, from which on an impact has its modes in other proportions than the
others on its point. What other modes leave in the reading behind the impact is another part of it then."""
BEYOND_NOISE = 6.0
"""Standard deviation of the vibration levels on a point over that by noise, below which they are one level. Noise in
the level is noise in the amplitudes that follow it: at this limit it makes a slope of 1/36, half of `DECAY_CHANGE`."""
NOISE_FACTOR = COVERAGE_FACTOR
"""``reach`` in half of an interval. The size is a root mean square of complex slopes, each of which noise moves by no
more than ``reach`` along itself."""
_DRAWS = 4000
"""Random interchanges at most: of as many a chance of 0.5 % is known to a fifth of itself (binomial)."""
_SURE = 20
"""Interchanges that explain as much, after which the count ends: the chance is known to a fifth of itself then."""
_BLOCK = 200
"""Interchanges that are made at once: speed and memory alone, the count is that of one after the other."""

Verdict = Literal["linear", "not linear", "suspect", "not testable"]
"""``suspect`` is what is probably not linear: the late decay over what is measured right behind the impact changes with
the level beyond noise, and differs between impacts of one level on a point, which no place and no force of an impact
explains (none of 40 linear tables of `python -m tests.bench.linearity --misplaced 0.1 --n 40` has that, nor any of its
other linear ones). What an impact leaves in a joint is seen by the next one."""


@dataclass(frozen=True)
class LevelDependence:
    """How much of the modal amplitudes of equal impacts follows their level.

    Parameters
    ----------
    size : relative change for a force e times as large, noise taken off.
    scatter : relative, of single impacts about that, NaN where no point has three impacts; ``noise`` is what noise
        explains of it.
    reach : size that noise alone would show.
    chance : probability of such a size with the levels interchanged at random.
    """

    size: float
    scatter: float
    noise: float
    reach: float
    chance: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % bounds of ``size``: what noise shows of it, more where impacts scatter by more than noise explains."""
        wider = max(self.scatter / self.noise, 1.0) if self.scatter > 0 and self.noise > 0 else 1.0
        half = NOISE_FACTOR * wider * self.reach
        return max(self.size - half, 0.0), self.size + half

    @property
    def unexplained(self) -> bool:
        """Whether impacts differ by more than noise and level explain."""
        return self.scatter > max(EXCESS * self.noise, HARMLESS) and self.chance > CHANCE

    def limit(self, usual: float) -> float:
        """Change from which on a structure is not linear: ``usual``, or less of it where chance is excluded."""
        return CERTAIN * usual if self.chance <= CHANCE else usual

    def exceeds(self, usual: float) -> bool:
        """Whether more follows the level than the limit, and more than noise and chance."""
        sure = self.chance <= CHANCE if np.isnan(self.scatter) else not self.unexplained
        return sure and self.chance <= LIKELY and self._changes(self.limit(usual))

    def scatters(self, limit: float) -> bool:
        """Whether impacts differ by more than noise and level explain, and the level changes more than ``limit``."""
        return self.unexplained and self.chance <= LIKELY and self._changes(limit)

    def _changes(self, limit: float) -> bool:
        return self.size >= max(limit, CLEAR * self.reach)

    def excludes(self, usual: float) -> bool:
        """Whether less follows the level than the limit, and so much would be seen."""
        return self.size < self.limit(usual) and self.reach < usual and not self.unexplained


@dataclass(frozen=True)
class Linearity:
    """The verdict on a hammer test, and what it rests on.

    ``constants`` is the level dependence of the modal constants, ``decay`` that of the late decay over the early one;
    ``None`` where it cannot be read. ``decays`` begin where the response has fallen to ``later`` of that behind the
    impact. ``reason`` says why nothing was decided. ``beside`` is the run of another level that it took to decide.
    ``free`` are the free decays of the run itself, for what else is read from them.
    """

    verdict: Verdict
    constants: LevelDependence | None = None
    decay: LevelDependence | None = None
    decays: ImpactDecays | None = None
    reason: str = ""
    later: float = LATE
    beside: str = ""
    free: FreeDecays | None = None


def linearity(run: Run, band: tuple[float, float], progress: Progress = silent) -> Linearity:
    """Decide whether a hammer test sees a linear structure, from its records.

    Parameters
    ----------
    run : a hammer test; impacts on a point that differ in level by a fifth are enough, twice the level is better.
    band : Hz, of the modes.

    Raises
    ------
    InputError : a record cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> from ema.data import Channel, Condition, Excitation, ModalModel, Run, poles_from
    >>> from ema.dof import Dof
    >>> from ema.simulate import RovingHammer, VirtualRig
    >>> at, poles = Dof(1, "+Z"), poles_from(np.array([300.0]), np.array([0.01]))
    >>> model = ModalModel(poles, np.ones((1, 1)), (at,), 1 / (2j * poles.imag)[None], (at,), scaling="unit modal mass")
    >>> acceleration = Channel("acc", at, quantity="acceleration", unit="m/s^2")
    >>> rig = VirtualRig(model, RovingHammer((at,)), (acceleration,), 4096.0, noise={"acceleration": 0.1, "force": 0.1})
    >>> linearity(Run("beam", Condition(Excitation(kind="hammer")), tuple(rig.takes())), (200.0, 500.0)).verdict
    'linear'
    """
    free = free_decays(run, band, progress)
    result = Linearity("not testable", reason="no decay is long enough to be fitted behind the impacts")
    for later in (LATE, LATER):
        decays = late_decays(free, band, later)
        if decays is None:
            break
        judged = replace(judge(decays), later=later)
        # What slips beyond measure is not linear, whatever a later decay says; it may say how much. It sees less, for
        # noise is amplified by the longer way back, and decides where nothing but noise had left a doubt.
        result = judged if judged.verdict == "not linear" or not _stands(result) else result
        if result.verdict in ("linear", "not linear") and not _beyond(result):
            break
    return replace(result, free=free)


def _stands(result: Linearity) -> bool:
    """Whether a verdict stands against that of a decay that begins later: all but doubts that noise may have left."""
    tests = [
        (one, usual) for one, usual in ((result.constants, CHANGE), (result.decay, DECAY_CHANGE)) if one is not None
    ]
    doubt = any(one.unexplained and one.size >= one.limit(usual) for one, usual in tests)
    return doubt or result.verdict != "not testable"


def _beyond(result: Linearity) -> bool:
    """Whether twice the force would change a modal amplitude by more than all of it.

    A late decay keeps between none and all of what the impact gave: poles were fitted to a joint that still slips.
    """
    return any(one is not None and TWICE * one.size > 1 for one in (result.constants, result.decay))


OTHER_LEVEL = 1.3
"""Ratio of the median forces of two runs from which on one is the harder. Medians of impacts of one nominal level that
scatter by a fifth differ by a tenth at most on three points or more."""
SAME_FORCE = 0.03
"""Relative difference of the normal forces of two runs up to which they are one condition: with a contact stiffness
that grows with the root of the normal force it changes the joint by 1.5 %, a third of `CHANGE`."""


def other_levels(run: Run, runs: Sequence[Run]) -> tuple[Run, ...]:
    """Tests of its kind that may be judged together with ``run``: the same joints and normal forces, nothing loosened.

    Nothing was loosened between runs of one ``assembly``; without that label two runs may be two structures.
    """
    return tuple(one for one in runs if one.id != run.id and _same_condition(run, one))


def _same_condition(one: Run, other: Run) -> bool:
    if one.kind != other.kind or any(not len(run.recordings) or run.frfs for run in (one, other)):
        return False
    mine, theirs = one.condition.joints, other.condition.joints
    if one.assembly != other.assembly or [joint.joint for joint in mine] != [joint.joint for joint in theirs]:
        return False
    near = all(abs(a.mean - b.mean) <= SAME_FORCE * a.mean for a, b in zip(mine, theirs, strict=True))
    return bool(one.assembly) and near


def linearity_beside(
    run: Run, others: Sequence[Run], band: tuple[float, float], progress: Progress = silent
) -> Linearity:
    """The verdict on a hammer test, with tests of other levels beside it.

    They decide where the test itself does not, and against it where it is the harder of two that differ. Where the
    lighter of two that differ does not decide by itself, it may still be linear: that stays open.

    Parameters
    ----------
    run, others : hammer tests under one condition, see :func:`other_levels`.
    band : Hz, of the modes.

    Raises
    ------
    InputError : a record cannot be used.
    """
    alone = linearity(run, band, progress)
    for other in others:
        if alone.verdict == "not linear":
            break
        both = linearity(_with_records_of(run, other), band, progress)
        harder = _level(run) > OTHER_LEVEL * _level(other)
        if (both.verdict == "not linear" and harder) or (both.verdict == "linear" and alone.verdict != "linear"):
            # the decays of both decide; those of the run itself give its modes
            alone = replace(both, beside=other.id, free=alone.free)
    return alone


def _with_records_of(run: Run, other: Run) -> Run:
    """The run with the records of another behind its own, each read when it is used."""
    records = [partial(one.recordings.__getitem__, row) for one in (run, other) for row in range(len(one.recordings))]
    return replace(run, recordings=Lazy(records))


def _level(run: Run) -> float:
    """Median over the records of their largest force, N."""
    tops = [float(np.abs(one.signals[one.with_role("reference")]).max()) for one in run.recordings]
    return float(np.median(tops))


def judge(decays: ImpactDecays) -> Linearity:
    """The verdict on late decays."""
    points: Sequence[Hashable] = decays.inputs
    energy, ratio, variance = _energy(decays), *_over_early(decays)
    if len(set(points)) == len(points):
        if len(points) < FEWEST_POINTS:
            return Linearity("not testable", decays=decays, reason="no point was struck twice")
        # The points are a range of levels.
        decay = level_dependence(ratio, variance, energy, _vibration(decays)[0], [0] * len(points))
        return _decided(None, decay, decays)
    # a window is set for all impacts, and takes a little of those too whose contact it just outlasts
    whole = not decays.cut.any()
    constants = level_dependence(*_constants(decays), energy, decays.peaks, points) if whole else None
    once = np.flatnonzero(decays.again < AGAIN)
    levels, where = _separate_levels(decays)[once], [points[int(row)] for row in once]
    return _decided(constants, level_dependence(ratio[once], variance[once], energy[once], levels, where), decays)


def _energy(decays: ImpactDecays) -> Float[np.ndarray, "impact mode"]:
    """Energy of every mode where the free decay begins, up to a factor: the smaller of both readings.

    A pole that is no mode may be far from small when it is extrapolated back over the early part.
    """
    readings = [np.sum(np.abs(one) ** 2, axis=2) for one in (decays.amplitudes, decays.behind)]
    left = np.exp(2 * np.outer(decays.gaps, decays.poles.real))
    return np.asarray(np.minimum(*readings) * left / np.abs(decays.poles) ** 2)


def _vibration(decays: ImpactDecays) -> tuple[Float[np.ndarray, "impact"], Float[np.ndarray, "impact"]]:
    """Displacement where the free decay begins, rms over modes and responses up to a factor; its relative std by noise.

    A joint goes on to slip in what vibrates, whatever the impact before has left in it; the force of an impact
    does not know that.
    """
    left = np.exp(2 * np.outer(decays.gaps, decays.poles.real))[:, :, None] / np.abs(decays.poles[:, None]) ** 4
    square = np.sum(np.abs(decays.behind) ** 2 * left, axis=(1, 2))
    # L = sqrt(sum |x|^2), x with noise of variance v: L has the variance sum |x|^2 v / (2 L^2)
    noise = np.sum(np.abs(decays.behind) ** 2 * decays.behind_variance * left**2, axis=(1, 2)) / 2
    return np.sqrt(square), np.sqrt(noise) / square


def _separate_levels(decays: ImpactDecays) -> Float[np.ndarray, "impact"]:
    """Levels of the vibration behind the impacts; one level on each point where noise is too large for a slope."""
    level, noise = _vibration(decays)
    for point in dict.fromkeys(decays.inputs):
        rows = [row for row, one in enumerate(decays.inputs) if one == point]
        if np.std(np.log(level[rows])) < BEYOND_NOISE * np.sqrt(np.mean(noise[rows] ** 2)):
            level[rows] = level[rows].mean()
    return level


def _decided(
    constants: LevelDependence | None, decay: LevelDependence | None, decays: ImpactDecays | None
) -> Linearity:
    tests = [(one, usual) for one, usual in ((constants, CHANGE), (decay, DECAY_CHANGE)) if one is not None]
    if any(one.exceeds(usual) for one, usual in tests):
        return Linearity("not linear", constants, decay, decays)
    if decay is not None and decay.scatters(DECAY_CHANGE):
        return Linearity("suspect", constants, decay, decays)
    # What one test excludes another may read: slip within the contact changes the constants and not the decay. A size
    # above the limit that noise might show is no sign of a linear structure either.
    if any(one.excludes(usual) for one, usual in tests) and all(one.size < one.limit(usual) for one, usual in tests):
        return Linearity("linear", constants, decay, decays)
    reason = "the impacts on each point are too equal"
    if any(one.unexplained for one, _ in tests):
        reason = "impacts on the same point differ by more than noise and level explain"
    return Linearity("not testable", constants, decay, decays, reason)


def level_dependence(
    values: Complex[np.ndarray, "impact mode"],
    variance: Float[np.ndarray, "impact mode"],
    energy: Float[np.ndarray, "impact mode"],
    level: Float[np.ndarray, "impact"],
    points: Sequence[Hashable],
) -> LevelDependence | None:
    """How modal values of impacts on the same point follow the level of the impact.

    Least squares of ``value / mean - 1 = slope ln(level)``, one complex slope for each mode and point; the chance is
    that of one slope for each mode over all points, by interchanging the levels on every point.

    Parameters
    ----------
    values, variance : of a linear structure, values are equal on a point but for noise of this variance.
    energy : weight of modes and points.
    level : of the impacts, or of the vibration behind them; positive.
    points : where each impact was.

    Returns
    -------
    LevelDependence or None
        ``None`` where no point has two impacts of different level, or every mode is lost in noise.
    """
    rows = [np.flatnonzero([point == one for point in points]) for one in dict.fromkeys(points)]
    rows = [part for part in rows if len(part) > 1 and np.ptp(level[part]) > 0]
    if not rows:
        return None
    x, z, noise, weight = [], [], [], []
    for part in rows:
        mean = values[part].mean(axis=0)
        relative = values[part] / mean - 1
        x.append(np.log(level[part]) - np.log(level[part]).mean())
        z.append(relative - relative.mean(axis=0))
        noise.append(variance[part].mean(axis=0) / np.abs(mean) ** 2)
        usable = noise[-1] < USABLE**2
        weight.append(np.where(usable, np.median(energy[part], axis=0) / (1 + noise[-1] / PRECISE**2), 0.0))
    w, v = np.array(weight) / max(float(np.sum(weight)), np.finfo(float).tiny), np.array(noise)
    spread = np.array([part @ part for part in x])
    slopes = np.array([part @ change for part, change in zip(x, z)])
    # One slope for each mode, its size by the energy of the points at which it was read.
    common = np.sum(w * slopes, axis=0)
    known = np.sum(w * spread[:, None], axis=0)
    seen = known > 0
    if not seen.any():
        return None
    common, known = common[seen], known[seen]
    by_noise = np.sum(w**2 * spread[:, None] * v, axis=0)[seen] / known**2
    size = np.sum(known * np.abs(common / known) ** 2) / known.sum()
    reach = np.sum(known * by_noise) / known.sum()
    left = sum(
        np.sum(one * np.abs(change - np.outer(part, slope / squares)) ** 2 / max(len(part) - 2, 1))
        for one, part, change, slope, squares in zip(w, x, z, slopes, spread)
        if len(part) > 2
    )
    repeated = [len(part) > 2 for part in x]
    share = max(float(np.sum(w[repeated])), np.finfo(float).tiny)
    scatter = float(np.sqrt(left / share)) if any(repeated) else float("nan")
    expected = float(np.sqrt(np.sum(w * v)))
    return LevelDependence(
        float(np.sqrt(max(size - reach, 0.0))),
        scatter,
        expected,
        float(np.sqrt(reach)),
        _chance(x, z, w, float(np.sum(np.abs(common) ** 2 / known))),
    )


def _chance(
    x: Sequence[Float[np.ndarray, "impact"]],
    z: Sequence[Complex[np.ndarray, "impact mode"]],
    weight: Float[np.ndarray, "point mode"],
    explained: float,
) -> float:
    """Share of random interchanges of the levels on every point that explain as much."""
    rng = np.random.default_rng(0)
    known = np.sum(weight * np.array([part @ part for part in x])[:, None], axis=0)
    seen, above, drawn = known > 0, 0, 0
    weighted = np.concatenate([change * share for change, share in zip(z, weight)])[:, seen] / np.sqrt(known[seen])
    # points one after the other that were struck as often are interchanged at once
    equal = [np.array(list(part)) for _, part in groupby(x, key=len)]
    while drawn < _DRAWS and above < _SURE:
        slopes = _interchanged(rng, equal, _BLOCK) @ weighted
        reached = np.cumsum(np.sum(np.abs(slopes) ** 2, axis=1) >= explained * (1 - 1e-12))
        used = min(int(np.searchsorted(reached, _SURE - above)) + 1, _BLOCK)
        drawn, above = drawn + used, above + int(reached[used - 1])
    return float((1 + above) / (1 + drawn))


def _interchanged(
    rng: np.random.Generator, equal: Sequence[Float[np.ndarray, "_ _"]], count: int
) -> Float[np.ndarray, "draw impact"]:
    """Levels interchanged at random on every point, ``count`` times; ``equal`` has points with as many impacts each."""
    if len(equal) == 1:
        return rng.permuted(np.tile(equal[0], (count, 1)), axis=1).reshape(count, -1)
    return np.array([np.concatenate([rng.permuted(part, axis=1).ravel() for part in equal]) for _ in range(count)])


def _constants(decays: ImpactDecays) -> tuple[Complex[np.ndarray, "impact mode"], Float[np.ndarray, "impact mode"]]:
    """Late amplitudes over the force, of all responses together, and their variance."""
    values = decays.amplitudes / decays.forces[:, :, None]
    variance = decays.variance / np.abs(decays.forces[:, :, None]) ** 2
    reference = np.empty_like(values)
    for point in dict.fromkeys(decays.inputs):
        rows = [row for row, one in enumerate(decays.inputs) if one == point]
        reference[rows] = values[rows].mean(axis=0)
    return _together(values, reference, variance)


def _over_early(decays: ImpactDecays) -> tuple[Complex[np.ndarray, "impact mode"], Float[np.ndarray, "impact mode"]]:
    """Late amplitudes over those read right behind the impact, of all responses together, and their variance."""
    variance = decays.variance + decays.behind_variance
    return _together(decays.amplitudes, decays.behind, variance)


def _together(
    values: Complex[np.ndarray, "impact mode out"],
    reference: Complex[np.ndarray, "impact mode out"],
    variance: Float[np.ndarray, "impact mode out"],
) -> tuple[Complex[np.ndarray, "impact mode"], Float[np.ndarray, "impact mode"]]:
    """Least squares of ``values = factor * reference`` over the responses; the factor and its variance."""
    size = np.sum(np.abs(reference) ** 2 / variance, axis=2)
    return np.sum(reference.conj() * values / variance, axis=2) / size, 1 / size


def level_effect(result: Linearity) -> LevelEffect | None:
    """How far the modal constants follow the impacts, or the late decay where nothing is known of the constants."""
    seen = result.constants or result.decay
    if seen is None or result.decays is None:
        return None
    lower, upper = (TWICE * bound for bound in seen.interval)
    peaks = result.decays.peaks
    return LevelEffect(TWICE * seen.size, lower, upper, float(peaks.min()), float(peaks.max()))


def level_finding(result: Linearity, where: str) -> Finding:
    """What a reader has to know about the verdict."""
    if result.verdict == "not testable":
        return Finding.of(
            "info",
            "linearity-not-testable",
            where,
            "Whether the structure is linear is not testable: {reason}.",
            advice="Repeat some impacts at half the level, several on each point.",
            reason=result.reason,
        )
    if result.verdict == "suspect":
        return _doubt(result, where)
    named = result.verdict == "not linear"
    texts, value, limit = [], 0.0, CHANGE
    for one, most, what in (
        (result.constants, CHANGE, "the modal constants of the late decay"),
        (
            result.decay,
            DECAY_CHANGE,
            "the late decay, extrapolated back to the impact, over the response measured there",
        ),
    ):
        if one is not None and (one.exceeds(most) if named else one.excludes(most)):
            texts.append(f"{what} by {_percent(TWICE * one.size)}")
            if one.size / one.limit(most) > value / limit:
                value, limit = one.size, one.limit(most)
    peaks = result.decays.peaks if result.decays is not None else np.zeros(1)
    beside = f", together with run {result.beside}" if result.beside else ""
    statement = (
        f"An impact twice as strong changes {' and '.join(texts)} "
        f"(by impacts of {peaks.min():.0f} to {peaks.max():.0f} N{beside})"
    )
    if not named:
        return Finding("info", "level-tested", where, f"{statement}: no sign of a nonlinear structure.", value, limit)
    return Finding(
        "warning",
        "slip-then-ring",
        where,
        f"{statement}: the structure is not linear at this level. A joint that slips under the impact and sticks "
        "afterwards does this while the FRFs still look like those of a linear structure.",
        value,
        limit,
        "Use the modes of the decay after sticking for small amplitudes; measure again at half the level.",
    )


def _doubt(result: Linearity, where: str) -> Finding:
    """Why a structure is probably not linear."""
    assert result.decay is not None and result.decays is not None
    peaks, decay = result.decays.peaks, result.decay
    return Finding.of(
        "warning",
        "linearity-doubtful",
        where,
        "An impact twice as strong changes the late decay, extrapolated back to the impact, over the response "
        "measured there by {change} (by impacts of {low} to {high} N), and impacts on one point differ in it by "
        "{scatter}, where noise explains {noise}. Neither the place nor the force of an impact does that: the "
        "structure is probably not linear at this level.",
        decay.size,
        DECAY_CHANGE,
        advice="Repeat some impacts at half the level, several on each point, before the FRFs are used.",
        change=_percent(TWICE * decay.size),
        low=f"{peaks.min():.0f}",
        high=f"{peaks.max():.0f}",
        scatter=f"{100 * decay.scatter:.2g} %",
        noise=f"{100 * decay.noise:.2g} %",
    )


def _percent(change: float) -> str:
    """A change in percent, to two digits; from as much again on it only says that there is little in common."""
    return "more than 100 %" if change > 1 else f"{100 * change:.2g} %"
