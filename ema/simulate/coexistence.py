"""Steady states that coexist at one frequency and force, and whole curves of them over frequency, isolated ones too.

At a fixed frequency the steady states over the force are one connected curve far more often than those over the
frequency at a fixed force: where that curve passes the force again, it shows states on branches that no sweep over
frequency reaches (isolas). Newton's method from random starts adds states that even this curve does not reach. Neither
proves that there are no others.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from ema.data import BeamModel, Finding
from ema.data.stability import UNDECIDED, CoexistingStates, FloquetMultipliers, SteadyState, SteadyStateCurve
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import is_number, positive
from ema.simulate.continuation import Arcs, ForcedMotion, Plane, along
from ema.simulate.harmonic import Condensed, _Point, condense, with_harmonics
from ema.simulate.stability import multipliers_of
from ema.simulate.steady_states import HarmonicBalance
from ema.simulate.turning_points import ForcedCurve, slope

_FEWEST, _MOST, _MOST_FOLLOWED = 9, 15, 31
"""Harmonics with which states are sought, between the first two: as many as one asks for; and at most those with which
a curve is followed, as many as the state asks for at which it begins."""
_ARCS = Arcs(first=0.01, longest=0.05, shortest=1e-6, most=1500, bend=0.9)
"""Steps along a curve, over the size of the motion and the width of the band, or one e-fold of the force."""
_DISTINCT = 1e-3
"""Relative distance of first harmonics, of solutions with the same harmonics, from which on they are two states: they
are solved to 1e-9."""
_SMALLEST, _LARGEST, _SCATTER = 0.3, 3.0, 0.5
"""Size of a random start over the smallest and over the largest motion known, that of free contacts among them, and the
scatter of single contacts about it."""
_SAMPLED = 24
"""Points of a curve whose multipliers are computed at first, besides those at its folds."""
_NEAR = 0.05
"""Distance of first harmonics of the motion in time up to which a point of a curve is that motion."""
_CLOSED_CURVE = 0.75
"""Distance of a point from the first one, over the length of a step, at which a curve is closed."""


@dataclass(frozen=True)
class ForceLevels(ForcedMotion):
    """Motion at one frequency under a force whose logarithm, from that of the model on, is the unknown."""

    omega: float
    stored: tuple[np.ndarray, np.ndarray]

    def frequency(self, unknowns: np.ndarray) -> float:
        """Angular frequency in rad/s."""
        return self.omega

    def moves_forces(self, index: int) -> bool:
        """Contact forces follow the motion alone."""
        return False

    def gains(self, unknowns: np.ndarray, count: int) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Receptances of the contacts."""
        return self.stored[0]

    def rest(
        self, amplitudes: np.ndarray, forces: np.ndarray, unknowns: np.ndarray
    ) -> Float[np.ndarray, "contact size"]:
        """U - U_drive + Z G."""
        drive = float(np.exp(unknowns[0])) * self.stored[1]
        return np.asarray(self.condensed.kernels.residual(amplitudes, drive, self.stored[0], forces))


@dataclass
class _Search:
    """Distinct solutions at one frequency with the same number of harmonics, and where each came from."""

    condensed: Condensed
    omega: float
    count: int
    points: list[_Point] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.gains = self.condensed.gains(self.omega, self.count)

    def try_from(self, start: np.ndarray, source: str) -> bool | None:
        """Newton's method from a start: whether it came to a new state; ``None`` where it came to none."""
        self.condensed.left = self.condensed.budget
        point = self.condensed._again(_Point(self.omega, start, start, start[:, 0], 1.0), self.gains)
        if point is None or not np.all(np.isfinite(point.amplitudes)):
            return None
        if any(self.condensed._change(known, point) < _DISTINCT for known in self.points):
            return False
        self.points.append(point)
        self.sources.append(source)
        return True

    def over_the_force(self, span: float) -> tuple[float, float]:
        """Follow the curves over the force from a ``span``-th of it upward, and from ``span`` times it downward.

        Their passages of the force are taken. Returns the lowest and the highest force that was passed.
        """
        levels = [0.0, *self._one_way(-np.log(span))]
        if max(levels) < np.log(span):
            levels += self._one_way(np.log(span))
        return self.condensed.force * float(np.exp(min(levels))), self.condensed.force * float(np.exp(max(levels)))

    def _one_way(self, begin: float) -> list[float]:
        """Follow the curve from the logarithm ``begin`` of the force over that of the model; those that it passed."""
        condensed = self.condensed
        begun = condensed.at(condensed.force * np.exp(begin), condensed.limits).solve(self.omega / (2 * np.pi))
        if begun is None:
            return []
        start, stored = (
            with_harmonics(begun.amplitudes, self.count),
            (
                self.gains,
                condensed.drive(self.omega, self.count),
            ),
        )
        size = float(np.linalg.norm(start)) * np.exp(-begin)
        here, levels = np.append(start.ravel() / size, begin), [begin]
        # far from the slip forces the motion grows with the force
        ahead = -np.sign(begin) * np.append(start.ravel() / size, 1.0)
        condensed.left = condensed.budget
        for point in along(
            lambda plane: ForceLevels(condensed, plane, self.omega, stored),
            here,
            ahead / np.linalg.norm(ahead),
            size,
            _ARCS,
        ):
            levels.append(float(point[-1]))
            if levels[-1] * levels[-2] <= 0:
                share = levels[-2] / (levels[-2] - levels[-1]) if levels[-1] != levels[-2] else 0.0
                between = here + share * (point - here)
                self.try_from(between[:-1].reshape(start.shape) * size, "curve over the force")
            here = point
            if abs(levels[-1]) > abs(begin) * (1 + 1e-9):
                break
        return levels

    def _sliding(self) -> Complex[np.ndarray, "contact"]:
        """Complex first harmonic of the contacts in m where none of them had a force."""
        first, condensed = self.condensed.excited, self.condensed
        drive = condensed.drive(self.omega, first + 1)[:, 2 * first :] @ [1, -1j]
        free = np.eye(len(drive)) - (self.gains[0, first] + 1j * self.gains[1, first]) * condensed.stiffness
        return np.asarray(np.linalg.lstsq(free, drive, rcond=None)[0])

    def from_random_starts(self, starts: int, seed: int) -> tuple[int, int]:
        """Try random sizes, phases and distributions over the contacts; how many reached a state, and how many came
        after the last new one."""
        random, solved, later, first = np.random.default_rng(seed), 0, 0, 2 * self.condensed.excited
        known = [point.amplitudes[:, first] - 1j * point.amplitudes[:, first + 1] for point in self.points]
        known.append(self._sliding())
        sizes = [size for size in (float(np.linalg.norm(shape)) for shape in known) if size > 0] or [0.0]
        for _ in range(starts):
            size = np.exp(random.uniform(np.log(_SMALLEST * min(sizes)), np.log(_LARGEST * max(sizes))))
            turned = known[random.integers(len(known))] * np.exp(1j * random.uniform(0, 2 * np.pi))
            turned = turned * (1 + _SCATTER * random.standard_normal(len(turned)))
            turned *= size / max(float(np.linalg.norm(turned)), 1e-300)
            start = np.zeros((len(turned), 2 * self.count))
            start[:, first], start[:, first + 1] = turned.real, -turned.imag
            came = self.try_from(start, "random start")
            solved, later = solved + (came is not None), 0 if came else later + 1
        return solved, later


def coexisting_states(
    model: BeamModel,
    frequency: float,
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    settings: HarmonicBalance | None = None,
    *,
    starts: int = 40,
    seed: int = 0,
    span: float = 10.0,
    progress: Progress = silent,
) -> CoexistingStates:
    """Search the steady states that coexist at one frequency and force, and say which of them are stable.

    The curve of steady states over the force is followed from a small force on, and Newton's method is begun at random.
    What comes back are the distinct states that were reached; there may be others.

    Parameters
    ----------
    model : BeamModel
        The model.
    frequency : float
        Frequency of the force [Hz].
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    outputs : sequence of Dof or str
        DOFs whose amplitudes are computed.
    settings : HarmonicBalance, optional
        Tolerance, modes, harmonics and budget of each solution.
    starts : int, default 40
        Number of random starts, 0 or more.
    seed : int, default 0
        Seed of the random starts.
    span : float, default 10.0
        The curve over the force is followed from ``force / span`` to ``force * span``; above 1.
    progress : Progress, optional
        Called during the search.

    Returns
    -------
    CoexistingStates
        The states with their Floquet multipliers, the smallest first, and what was searched.

    Raises
    ------
    InputError
        If frequency or force is not positive, the number of starts is negative, or the span is not above 1.

    References
    ----------
    .. [1] Kuether, Renson, Detroux, Grappasonni, Kerschen and Allen (2015), Nonlinear normal modes, modal interactions
       and isolated resonance curves, Journal of Sound and Vibration 351:299.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import Damping
    >>> from ema.examples import beam_model
    >>> model = replace(beam_model(), damping=Damping(ratio=0.01))
    >>> found = coexisting_states(model, 60.0, 1.0, "1:+X", ["1:+X"], starts=3)
    >>> [state.stability.verdict for state in found.states]
    ['stable']
    """
    chosen = settings or HarmonicBalance()
    positive(model.name, frequency=frequency, budget=chosen.budget)
    _whole(model.name, starts=starts)
    if not (is_number(span) and span > 1):
        raise InputError("not a span of forces", where=model.name, got=span, expected="a factor above 1")
    condensed = _condensed(model, force, at, outputs, chosen)
    search, forces, (solved, later) = _searched(condensed, frequency, (starts, seed, span))
    states: list[SteadyState] = []
    points: list[_Point] = []
    for number, (raw, source) in enumerate(zip(search.points, search.sources, strict=True)):
        advance(progress, "steady states", number, len(search.points))
        point = _refined(condensed, frequency, raw)
        if any(condensed._change(known, point) < _DISTINCT for known in points):
            continue
        points.append(point)
        states.append(_state(condensed, point, multipliers_of(condensed, point), source))
    states.sort(key=lambda state: float(np.linalg.norm(state.first)))
    findings = tuple(_several(model.name, frequency, states)) if len(states) > 1 else ()
    return CoexistingStates(
        tuple(states), condensed.problem.outputs, starts, solved, later, forces, findings, model.name
    )


def _whole(where: str, **numbers: Any) -> None:
    """Refuse what is no whole number from 0 on.

    Raises
    ------
    InputError : as said.
    """
    for name, value in numbers.items():
        if not (isinstance(value, int | np.integer) and value >= 0):
            raise InputError(
                f"not a number of {name}", where=where, got=f"{name} = {value!r}", expected="a whole number, 0 or more"
            )


def _condensed(
    model: BeamModel, force: float, at: Dof | str, outputs: Sequence[Dof | str], settings: HarmonicBalance
) -> Condensed:
    condensed = condense(model, force, at, outputs, settings.tolerance, settings.modes)
    condensed.budget = settings.budget
    condensed.keep(settings.harmonics)
    return condensed


def _searched(
    condensed: Condensed, frequency: float, options: tuple[int, int, float]
) -> tuple[_Search, tuple[float, float], tuple[int, int]]:
    """The search at one frequency; ``options``: random starts, seed and span of the forces."""
    starts, seed, span = options
    begun = condensed.solve(frequency)
    count = condensed.harmonics or min(max(_FEWEST, 0 if begun is None else begun.count), _MOST)
    search = _Search(condensed, 2 * np.pi * frequency, count)
    if begun is not None:
        search.try_from(with_harmonics(begun.amplitudes, count), "from rest")
    forces = search.over_the_force(span)
    return search, forces, search.from_random_starts(starts, seed)


def _refined(condensed: Condensed, frequency: float, raw: _Point) -> _Point:
    """A solution with as many harmonics as the tolerance asks for, where that stays near; else the one there is."""
    start = with_harmonics(raw.amplitudes, max(3, raw.count // 2))
    for guess in (start, raw.amplitudes):
        point = condensed.solve(frequency, guess)
        if point is not None and condensed._change(raw, point) < _NEAR:
            return point
    raw.error = condensed.judged(raw)
    return raw


def _state(condensed: Condensed, point: _Point, multipliers: FloquetMultipliers, source: str) -> SteadyState:
    return SteadyState(
        frequency=point.omega / (2 * np.pi),
        force=condensed.force,
        orders=condensed.orders(point.count),
        values=condensed.outputs(point, condensed.rows),
        error_estimate=point.error,
        stability=multipliers,
        source=source,
    )


def _several(where: str, frequency: float, states: Sequence[SteadyState]) -> Iterator[Finding]:
    """A finding where several states coexist."""
    stable = sum(state.stability.stable for state in states)
    yield Finding.of(
        "warning",
        "several-steady-states",
        where,
        "{count} steady states at {frequency} Hz, of which {stable} are stable.",
        float(frequency),
        advice="Which of the stable states a structure takes depends on where it comes from: try both directions.",
        count=len(states),
        frequency=f"{frequency:.5g}",
        stable=stable,
    )


@dataclass(frozen=True)
class _Followed:
    """Points of a curve: amplitudes in m and angular frequencies in rad/s; how it begins and ends."""

    amplitudes: Float[np.ndarray, "point contact size"]
    omegas: Float[np.ndarray, "point"]
    ends: tuple[str, str]
    detached: bool = False

    def near(self, omega: float) -> Iterator[Float[np.ndarray, "contact size"]]:
        """Amplitudes where the curve passes a frequency, linear between its points."""
        away = self.omegas - omega
        for n in np.flatnonzero(away[1:] * away[:-1] <= 0):
            way = away[n] - away[n + 1]
            share = away[n] / way if way else 0.0
            yield self.amplitudes[n] + share * (self.amplitudes[n + 1] - self.amplitudes[n])


def frf_curves(
    model: BeamModel,
    band: tuple[float, float],
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    settings: HarmonicBalance | None = None,
    *,
    searched: int = 5,
    starts: int = 20,
    seed: int = 0,
    stability: bool = True,
    progress: Progress = silent,
) -> tuple[SteadyStateCurve, ...]:
    """Follow the curves of steady states over frequency through their folds, with the stability along them.

    The first curve begins at the lower edge of the band. At ``searched`` frequencies coexisting states are searched;
    each that lies on no curve that is known begins another one. Curves that no search came to are missing.

    Parameters
    ----------
    model : BeamModel
        The model.
    band : tuple of (float, float)
        Frequencies [Hz] between which curves are followed.
    force : float
        Amplitude of the force [N].
    at : Dof or str
        DOF of the force.
    outputs : sequence of Dof or str
        DOFs whose amplitudes are computed.
    settings : HarmonicBalance, optional
        Tolerance, modes, harmonics and budget.
    searched : int, default 5
        Number of frequencies, even in the band, at which coexisting states are searched; 0 follows the first curve
        alone.
    starts : int, default 20
        Random starts at each of them.
    seed : int, default 0
        Seed of the random starts.
    stability : bool, default True
        Whether to compute Floquet multipliers: at up to a few dozen points of a curve, at its folds and where the
        verdict changes; between two points with one verdict, that verdict.
    progress : Progress, optional
        Called while the band is searched.

    Returns
    -------
    tuple of SteadyStateCurve
        The curve from the lower edge first.

    Raises
    ------
    InputError
        If the band does not ascend from above 0 Hz, or a number is not positive.

    Examples
    --------
    >>> from ema.examples import beam_model
    >>> curves = frf_curves(beam_model(), (50.0, 60.0), 1.0, "1:+X", ["1:+X"], searched=0, stability=False)
    >>> len(curves), curves[0].isolated
    (1, False)
    """
    chosen = settings or HarmonicBalance()
    if not (all(is_number(edge) for edge in band) and 0 < band[0] < band[1]):
        raise InputError("not a band", where=model.name, got=band, expected="two frequencies above 0 Hz, ascending")
    _whole(model.name, searched=searched, starts=starts)
    condensed = _condensed(model, force, at, outputs, chosen)
    edges = 2 * np.pi * band[0], 2 * np.pi * band[1]
    curves: list[_Followed] = []
    begun = condensed.solve(band[0])
    if begun is not None:
        curves.append(_one_way(condensed, _to_follow(condensed, begun), edges, 1.0))
    for number, frequency in enumerate(np.linspace(*band, searched + 2)[1:-1]):
        advance(progress, "frequencies searched", number, searched)
        search, _, _ = _searched(condensed, float(frequency), (starts, seed + number, 10.0))
        for point in search.points:
            if not any(_on(search, curve, point) for curve in curves):
                begun = _to_follow(condensed, _refined(condensed, float(frequency), point))
                curve = _curve(condensed, begun, edges)
                # one that could not be followed any farther from the edge may be this one
                parts = [n for n, one in enumerate(curves) if "lost" in one.ends and _contains(condensed, curve, one)]
                curves = [one for n, one in enumerate(curves) if n not in parts]
                curves.insert(min(parts, default=len(curves)), replace(curve, detached=0 not in parts))
    # where the first curve was lost, one that begins elsewhere may be the rest of it
    lost = any("lost" in curve.ends for curve in curves[:1])
    curves = [replace(one, detached=one.detached and not lost and "lost" not in one.ends) for one in curves]
    return tuple(_with_stability(condensed, curve, stability) for curve in curves)


def _contains(condensed: Condensed, curve: _Followed, part: _Followed) -> bool:
    """Whether a curve passes through the middle point of another one."""
    middle = len(part.omegas) // 2
    here = part.amplitudes[middle]
    for there in curve.near(float(part.omegas[middle])):
        size = min(here.shape[1], there.shape[1])
        if np.linalg.norm(here[:, :size] - there[:, :size]) < _NEAR * np.linalg.norm(here):
            return True
    return False


def _to_follow(condensed: Condensed, point: _Point) -> _Point:
    """A solution with the harmonics with which its curve is followed."""
    count = condensed.harmonics or min(max(_FEWEST, point.count), _MOST_FOLLOWED)
    condensed.left = condensed.budget
    again = condensed._again(point, condensed.gains(point.omega, count))
    return point if again is None else again


def _on(search: _Search, curve: _Followed, point: _Point) -> bool:
    """Whether a solution lies on a curve: it is what Newton's method makes of a passage of its frequency."""
    for start in curve.near(search.omega):
        search.condensed.left = search.condensed.budget
        begun = _Point(search.omega, start, start, start[:, 0], 1.0)
        again = search.condensed._again(begun, search.gains)
        if again is not None and search.condensed._change(again, point) < _DISTINCT:
            return True
    return False


def _curve(condensed: Condensed, point: _Point, edges: tuple[float, float]) -> _Followed:
    """The curve through a solution: upward from there until it closes or leaves the band, then the other way."""
    ahead = _one_way(condensed, point, edges, 1.0)
    if ahead.ends[1] == "closed":
        return ahead
    back = _one_way(condensed, point, edges, -1.0)
    return _Followed(
        np.concatenate([back.amplitudes[:0:-1], ahead.amplitudes]),
        np.concatenate([back.omegas[:0:-1], ahead.omegas]),
        (back.ends[1], ahead.ends[1]),
    )


def _one_way(condensed: Condensed, point: _Point, edges: tuple[float, float], sign: float) -> _Followed:
    """The curve from a solution on, with ``sign`` upward or downward at first; it ends beyond the band or closed."""
    size, shape = max(float(np.linalg.norm(point.amplitudes)), 1e-300), point.amplitudes.shape
    width = edges[1] - edges[0]
    here = np.append(point.amplitudes.ravel() / size, (point.omega - edges[0]) / width)
    tangent = sign * np.append(slope(condensed, point).ravel() * width / size, 1.0)
    tangent /= np.linalg.norm(tangent)
    first, points, ends, direction = here, [here], ("edge", "lost"), tangent
    condensed.left = condensed.budget
    motion: Callable[[Plane], ForcedMotion] = lambda plane: ForcedCurve(condensed, plane, edges)  # noqa: E731
    for reached in along(motion, here, tangent, size, _ARCS):
        way = reached - points[-1]
        points.append(reached)
        if not -1e-9 <= reached[-1] <= 1 + 1e-9:
            ends = "edge", "edge"
            break
        if len(points) > 4 and _passes(points[-2], way, first, direction):
            points[-1], ends = first, ("closed", "closed")
            break
    table = np.array(points)
    return _Followed(table[:, :-1].reshape(-1, *shape) * size, edges[0] + width * table[:, -1], ends)


def _passes(begin: np.ndarray, way: np.ndarray, first: np.ndarray, direction: np.ndarray) -> bool:
    """Whether a step along a curve passes its first point, in the direction in which it left that."""
    length = float(np.linalg.norm(way))
    along_it = float((first - begin) @ way) / length**2
    aside = float(np.linalg.norm(begin + along_it * way - first))
    return 0 <= along_it <= 1 and aside < _CLOSED_CURVE * length and float(way @ direction) > 0


def _with_stability(condensed: Condensed, curve: _Followed, stability: bool) -> SteadyStateCurve:
    """The curve with multipliers at some of its points, and the verdicts between those that agree."""
    points = [_point(condensed, *pair) for pair in zip(curve.omegas, curve.amplitudes, strict=True)]
    known: dict[int, FloquetMultipliers] = {}
    if stability:
        turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(curve.omegas))) != 0)
        spread = np.linspace(0, len(points) - 1, min(_SAMPLED, len(points))).round()
        wanted = sorted({*map(int, spread), *(int(n) for turn in turns for n in (turn - 1, turn, turn + 1))})
        while wanted:
            known |= {n: multipliers_of(condensed, points[n]) for n in wanted}
            order = sorted(known)
            wanted = [
                (low + high) // 2
                for low, high in pairwise(order)
                if high - low > 1 and known[low].verdict != known[high].verdict
            ]
    verdicts, losses = _between(known, len(points))
    return SteadyStateCurve(
        frequencies=curve.omegas / (2 * np.pi),
        values=np.array([condensed.first(point) for point in points]),
        dofs=condensed.problem.outputs,
        force=condensed.force,
        largest=np.array([known[n].largest if n in known else np.nan for n in range(len(points))]),
        verdicts=verdicts,
        losses=losses,
        ends=curve.ends,
        detached=curve.detached,
        name=condensed.problem.system.name,
    )


def _between(known: dict[int, FloquetMultipliers], count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Verdict and loss of every point: its own, or those of the neighbours on both sides, which agree."""
    verdicts, losses, nearest = [UNDECIDED] * count, [""] * count, sorted(known)
    for n in range(count):
        if nearest:
            before = nearest[max(int(np.searchsorted(nearest, n, side="right")) - 1, 0)]
            verdicts[n], losses[n] = known[before].verdict, known[before].loss
    return tuple(verdicts), tuple(losses)


def _point(condensed: Condensed, omega: float, amplitudes: np.ndarray) -> _Point:
    """A point of a curve as a solution whose error is that of few harmonics."""
    forces, _, lost, _ = condensed.contact_forces(amplitudes, omega, condensed.fine, derive=False)
    return _Point(float(omega), amplitudes, forces, lost, _NEAR)
