"""Steady states that coexist at one frequency and force.

At a fixed frequency the steady states over the force are one connected curve far more often than those over the
frequency at a fixed force: where that curve passes the force again, it shows states on branches that no sweep over
frequency reaches (isolas). Newton's method from random starts adds states that even this curve does not reach. Neither
proves that there are no others.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from ema.data import BeamModel, Finding
from ema.data.stability import CoexistingStates, FloquetMultipliers, SteadyState
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.checks import is_number, positive
from ema.simulate.continuation import Arcs, ForcedMotion, along
from ema.simulate.harmonic import Condensed, _Point, condense, with_harmonics
from ema.simulate.stability import multipliers_of
from ema.simulate.steady_states import HarmonicBalance

_FEWEST, _MOST = 9, 15
"""Harmonics with which states are sought, between these two: as many as one asks for."""
_ARCS = Arcs(first=0.01, longest=0.05, shortest=1e-6, most=1500, bend=0.9)
"""Steps along a curve, over the size of the motion and the width of the band, or one e-fold of the force."""
DISTINCT = 1e-3
"""Relative distance of first harmonics, of solutions with the same harmonics, from which on they are two states: they
are solved to 1e-9."""
_SMALLEST, _LARGEST, _SCATTER = 0.3, 3.0, 0.5
"""Size of a random start over the smallest and over the largest motion known, that of free contacts among them, and the
scatter of single contacts about it."""
_NEAR = 0.05
"""Distance of first harmonics, relative, up to which a solution with more harmonics is still that state."""


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
class Search:
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
        if any(self.condensed._change(known, point) < DISTINCT for known in self.points):
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
    whole(model.name, starts=starts)
    if not (is_number(span) and span > 1):
        raise InputError("not a span of forces", where=model.name, got=span, expected="a factor above 1")
    condensed = condensed_model(model, force, at, outputs, chosen)
    search, forces, (solved, later) = search_at(condensed, frequency, (starts, seed, span))
    states: list[SteadyState] = []
    points: list[_Point] = []
    for number, (raw, source) in enumerate(zip(search.points, search.sources, strict=True)):
        advance(progress, "steady states", number, len(search.points))
        point = refined(condensed, frequency, raw)
        if any(condensed._change(known, point) < DISTINCT for known in points):
            continue
        points.append(point)
        states.append(_state(condensed, point, multipliers_of(condensed, point), source))
    states.sort(key=lambda state: float(np.linalg.norm(state.first)))
    findings = tuple(_several(model.name, frequency, states)) if len(states) > 1 else ()
    return CoexistingStates(
        tuple(states), condensed.problem.outputs, starts, solved, later, forces, findings, model.name
    )


def whole(where: str, **numbers: Any) -> None:
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


def condensed_model(
    model: BeamModel, force: float, at: Dof | str, outputs: Sequence[Dof | str], settings: HarmonicBalance
) -> Condensed:
    """A model seen from its contacts, with the settings of the harmonic balance."""
    condensed = condense(model, force, at, outputs, settings.tolerance, settings.modes)
    condensed.budget = settings.budget
    condensed.keep(settings.harmonics)
    return condensed


def search_at(
    condensed: Condensed, frequency: float, options: tuple[int, int, float]
) -> tuple[Search, tuple[float, float], tuple[int, int]]:
    """The search at one frequency; ``options``: random starts, seed and span of the forces."""
    starts, seed, span = options
    begun = condensed.solve(frequency)
    count = condensed.harmonics or min(max(_FEWEST, 0 if begun is None else begun.count), _MOST)
    search = Search(condensed, 2 * np.pi * frequency, count)
    if begun is not None:
        search.try_from(with_harmonics(begun.amplitudes, count), "from rest")
    forces = search.over_the_force(span)
    return search, forces, search.from_random_starts(starts, seed)


def refined(condensed: Condensed, frequency: float, raw: _Point) -> _Point:
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
