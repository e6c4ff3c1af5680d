"""Floquet multipliers of steady states: the monodromy of the whole state over a period of the exciting force.

A friction contact remembers: its state is more than displacements and velocities. The map that the time solver makes of
displacements, velocities and states of the laws over a period is differentiated by differences of runs where it closes:
the harmonic solution is where the search for the periodic motion of the map begins (shooting; Seydel 2010, chapter 7).
Friction springs are counted from where they would be unstressed, w = z - k u: one that never slips keeps its w, and has
a multiplier of 1 that stands for a residual force, not for a loss of stability.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.optimize import linear_sum_assignment
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, gmres

from ema.data import BeamModel, HarmonicResponse
from ema.data.stability import UNDECIDED, UNSTABLE, FloquetMultipliers
from ema.errors import InputError
from ema.progress import Progress, advance, silent
from ema.simulate.harmonic import Condensed, _Point, condense
from ema.simulate.steady_states import HarmonicBalance
from ema.simulate.transient import _Modes, _State, room_for

_STEPS, _MOST_STEPS = 256, 4096
"""Steps of a period at first, and at most where a verdict asks for more."""
_ACCURATE, _OF_MARGIN = 1e-3, 0.1
"""Error of a multiplier, absolute and over its distance from the unit circle, either of which is enough."""
_NUDGE = 1e-6
"""Change of a coordinate for differences, over the size of the motion: the solver errs by 1e-12 of it, and the
derivative by a millionth."""
_WITHIN = 1e-4
"""Largest change of a relative displacement for differences, over that of the motion."""
_LEAST_NUDGE = 1e-4
"""Least size of a spring's coordinate over that of the motion, and of the motion of a contact over the largest of them,
that changes for differences are made for."""
_DENSE, _SOUGHT, _LEADING, _BASIS = 64, 8, 4, 40
"""Coordinates up to which the whole monodromy is made; else so many of the largest multipliers are sought by Arnoldi's
method, of which the first are kept, in a basis of that size."""
_CLOSED, _NEWTON_STEPS, _SHORTEST = 1e-9, 15, 0.1
"""Change over a period, relative to the size of the motion, at which it is periodic; steps of Newton's method at most,
and the share of one below which none is tried."""
_SOLVED = 1e-6
"""How far Newton's step is solved for by GMRES, relative."""
_REMEMBERED = 1e-3
"""Change of all forces, relative, that a law without loss keeps along the same motion for a period."""
_KEPT = 1e-6
"""Row of the monodromy over that of a spring that keeps its force: the error of the derivative."""
_SAFETY, _BETWEEN = 2.0, (0.75, 6.0)
"""Factor on what half as long steps change, and the share of steps in between with theirs: twice the rest of a sequence
that errs by their length. Where contacts turn within a step the rest depends on where the step lies: two numbers of
steps may agree by chance, three hardly do."""
_LEAST_ERROR = 1e-6
"""Error that is stated at least: that of the differences."""
_SAME, _FARTHEST = 3.0, 0.05
"""How far the first harmonic of the periodic motion may be from the harmonic solution: that many times its stated
error, and at most; farther away, another steady state was reached."""
_NOT_AGAIN = "the steady state was not found again from its slips"
_NEAR_CIRCLE = "a multiplier is within its error of the unit circle"
_SAMPLES = 64
"""Of a period, from which its first harmonic is made."""


class PeriodMap:
    """The state one period of the force later, as so many steps make it.

    Coordinates are, in the root of J: displacements times frequency and velocities of the modes that the contacts see,
    and for every friction spring (z - k u) / sqrt(k). A law whose force depends on velocities adds the two further
    states of each contact. What else a law keeps follows from these.
    """

    def __init__(self, condensed: Condensed, point: _Point, steps: int) -> None:
        self.condensed, self.steps, problem = condensed, steps, condensed.problem
        from ema.contact.call_kernels import WAY_BEFORE

        base, self.laws, self._way = problem.base, problem.laws, WAY_BEFORE
        start, self.begun = condensed.start_in_time(point, steps)
        self.modes = np.flatnonzero(base.coupled | (base.damping is not None))
        self.slip = base.slip[:, self.modes]
        self.frequencies = np.maximum(base.frequencies[self.modes], point.omega)
        self.omega, self.template = point.omega, start
        phase = self.begun + 2 * np.pi * np.arange(steps + 1) / steps
        self.load, self.limits = condensed.force * np.cos(phase)[:, None], condensed.slip_forces(phase[:-1])
        self._kept = np.nonzero(self._remembered())
        self._rows = np.array([base.row(problem.system, condensed.driven)])
        self._run = self._stepper(start)

    def _remembered(self) -> Bool[np.ndarray, "contact state"]:
        """Which states of the laws are coordinates."""
        flexibility, kept = self.laws.flexibility, np.zeros(self.laws.flexibility.shape, bool)
        for name, first, end, _, across, _ in self.laws.groups:
            for shift in {0, across}:
                part = slice(first + shift, end + shift)
                kept[part] = flexibility[part] > 0 if name != "normal" else False
        kept[self.laws.rates, : self._way + 1] = True
        return kept

    def _stepper(self, state: _State) -> _Modes:
        h = 2 * np.pi / self.omega / self.steps
        return _Modes(self.condensed.problem, state, h, (self.modes, True), self._rows)

    @cached_property
    def springs(self) -> Float[np.ndarray, "kept"]:
        """Stiffness in N/m of the springs among the states that are kept, 0 for other states."""
        flexibility = self.laws.flexibility[self._kept]
        return np.asarray(np.divide(1.0, flexibility, out=np.zeros_like(flexibility), where=flexibility > 0))

    @cached_property
    def _scales(self) -> Float[np.ndarray, "kept"]:
        """Of the states: root of the stiffness of a spring; of its contact for what a law keeps besides."""
        contact = self.laws.stiffness[self._kept[0]]
        scale = np.sqrt(np.where(self.springs > 0, self.springs, contact))
        way = (self._kept[1] == self._way) & (self.springs == 0)
        return np.where(way, 1 / scale, scale)

    def coordinates(self, state: _State) -> Float[np.ndarray, "coordinate"]:
        """Coordinates of a state whose modes are those that the contacts see."""
        kept = state.z[self._kept] - self.springs * state.u[self._kept[0]]
        return np.concatenate([self.frequencies * state.q, state.p, kept / self._scales])

    @property
    def start(self) -> Float[np.ndarray, "coordinate"]:
        """Coordinates of the harmonic solution."""
        begun = self.template
        return self.coordinates(_State(begun.q[self.modes], begun.p[self.modes], begun.u, begun.f, begun.z))

    def state(self, coordinates: Float[np.ndarray, "coordinate"]) -> _State:
        """The state of coordinates."""
        count = len(self.modes)
        q, p = coordinates[:count] / self.frequencies, coordinates[count : 2 * count]
        u, z = self.slip @ q, self.template.z.copy()
        z[self._kept] = coordinates[2 * count :] * self._scales + self.springs * u[self._kept[0]]
        return _State(q, p, u, self._forces(u, z), z)

    def _forces(self, u: np.ndarray, z: np.ndarray) -> Float[np.ndarray, "contact"]:
        """Forces in N of the contacts, and what normal contacts keep brought in line with their openings."""
        from ema.contact import normal_kernels as kernels

        force = np.where(self.laws.flexibility > 0, z, 0.0).sum(axis=1)
        force[self.laws.rates] = z[self.laws.rates, : self._way].sum(axis=1)
        for name, first, end, *_ in self.laws.groups:
            if name == "normal":
                ties = self.laws.couplings
                assert ties is not None
                press: Any = kernels.press_all
                table = ties.normals
                pressed, _, energy = press(table, ties.curve, table[:, kernels.PENETRATION] - u[first:end])
                force[first:end] = table[:, kernels.FORCE] - pressed
                energy = energy - table[:, kernels.ENERGY] + table[:, kernels.FORCE] * u[first:end]
                z[first:end, 0], z[first:end, 1] = u[first:end], np.sqrt(2 * np.maximum(energy, 0.0))
        return np.asarray(force)

    def ahead(
        self, coordinates: Float[np.ndarray, "coordinate"], every: int | None = None
    ) -> tuple[Float[np.ndarray, "coordinate"], dict[str, np.ndarray]]:
        """Coordinates after a period, and samples of the way there after ``every`` steps, the whole period by default.

        Samples are those of ``Stepper.run``; modes that no contact sees stay zero in them.
        """
        state, run = self.state(coordinates), self._run
        run.q[:], run.p[:], run.u[:], run.f[:], run.z[:] = state.q, state.p, state.u, state.f, state.z
        run.exchange[:] = self.laws.exchange()
        run.memory = self.laws.memory(run.compliance[0])
        run.limits[:] = self.limits[-1]
        every = self.steps if every is None else every
        samples = room_for(self.condensed.problem, self.steps // every)
        parts = tuple(samples[name] for name in ("q", "p", "u", "f", "energy"))
        run.advance((self.steps, every, 0), self.limits, self.load, parts)
        end = _State(run.q, run.p, run.u, run.f, run.z)
        return self.coordinates(end), samples

    def nudges(self, size: float, moved: Float[np.ndarray, "contact"]) -> Float[np.ndarray, "coordinate"]:
        """Changes of the coordinates for differences; ``moved`` m are the amplitudes of the contacts."""
        moved = np.maximum(moved, max(_LEAST_NUDGE * float(moved.max(initial=0.0)), 1e-300))
        slips = np.abs(self.slip) / moved[:, None]
        reach = np.max(slips, axis=0, initial=1e-300) / self.frequencies
        modes = np.minimum(_NUDGE * size, _WITHIN / reach)
        contact = self._kept[0]
        # a spring moves by its own share of the motion
        own = np.where(self.springs > 0, np.sqrt(self.springs) * moved[contact], self._scales * moved[contact])
        way = (self._kept[1] == self._way) & (self.springs == 0)
        own = np.where(way, moved[contact] * 2 * np.pi / self.steps / self._scales, own)
        return np.concatenate([modes, modes, _NUDGE * np.maximum(own, _LEAST_NUDGE * size)])

    def families(self, coordinates: np.ndarray, sticking: np.ndarray) -> int:
        """How many other springs have a memory that a given motion never fades: the force of a law without loss.

        Each belongs to a family of steady states with other residual forces. Not looked at where contacts depend on
        each other.
        """
        if self.laws.couplings is not None or sticking[2 * len(self.modes) :].sum() == (self.springs > 0).sum():
            return 0
        begun, way = self.state(coordinates), self.ahead(coordinates, 1)[1]["u"].T
        # the first increment of ``followed`` is none
        path = np.column_stack([begun.u, begun.u, way])
        limits = np.broadcast_to(self.limits[0][:, None], path.shape)
        if len(self.limits) > 1:
            limits = np.column_stack([self.limits[-1], self.limits[-1], self.limits.T])
        nudge, nudged = _REMEMBERED * np.sqrt(np.mean(begun.z[self._kept] ** 2)), begun.z.copy()
        nudged[self._kept] += np.where(self.springs > 0, nudge, 0.0)
        h = 2 * np.pi / self.omega / self.steps
        ends = [self.laws.followed(path, limits, h, start)[1][self._kept] for start in (begun.z, nudged)]
        left = np.abs(ends[1] - ends[0] - nudge) < _KEPT * nudge
        return int(np.sum(left & (self.springs > 0) & ~sticking[2 * len(self.modes) :]))

    def extent(self, coordinates: np.ndarray) -> tuple[float, Float[np.ndarray, "contact"]]:
        """Size of the motion of the modes in the root of J, and amplitudes of the contacts in m."""
        way = self.ahead(coordinates, self.steps // _SAMPLES)[1]
        modal = np.hypot(way["q"][:, self.modes] * self.frequencies, way["p"][:, self.modes])
        return max(float(np.linalg.norm(modal, axis=1).max()), 1e-300), np.abs(way["u"]).max(axis=0)

    def first(self, coordinates: np.ndarray, point: _Point) -> Complex[np.ndarray, "dof"]:
        """First harmonic of the outputs along the motion that begins there.

        Modes that no contact sees move as in the harmonic solution.
        """
        motion = self.ahead(coordinates, self.steps // _SAMPLES)[1]["q"][:, self.modes]
        wave = 2 / _SAMPLES * np.exp(-1j * (self.begun + 2 * np.pi * np.arange(1, _SAMPLES + 1) / _SAMPLES))
        modal = self.condensed.modal(point)[self.condensed.excited].copy()
        modal[self.modes] = wave @ motion
        return np.asarray(self.condensed.rows @ modal)


@dataclass(frozen=True)
class Monodromy:
    """Derivative of a period map, by differences of runs, in coordinates over their ``nudges``.

    ``free`` says which coordinates are no springs that stick.
    """

    period: PeriodMap
    begun: np.ndarray
    end: np.ndarray
    nudges: np.ndarray

    @cached_property
    def free(self) -> Bool[np.ndarray, "coordinate"]:
        """Coordinates but those of springs that stick: whatever moves by a nudge, they keep their unstressed place."""
        signs = np.where(np.random.default_rng(len(self.nudges)).random(len(self.nudges)) < 0.5, -1.0, 1.0)
        moved = (self.period.ahead(self.begun + signs * self.nudges)[0] - self.end) / self.nudges
        springs = np.concatenate([np.zeros(2 * len(self.period.modes), bool), self.period.springs > 0])
        return np.asarray(~(springs & (np.abs(moved - signs) < _KEPT)))

    def product(self, vector: Float[np.ndarray, "free"], side: int = 0) -> Float[np.ndarray, "free"]:
        """Derivative along a vector, from a run ahead (``side`` 1), back (-1), or both (0)."""
        largest = float(np.abs(vector).max(initial=0.0))
        if largest == 0.0:
            return np.zeros_like(vector)
        step = np.zeros_like(self.begun)
        step[self.free] = self.nudges[self.free] * vector / largest
        ends = [self.period.ahead(self.begun + sign * step)[0] if side != -sign else self.end for sign in (1, -1)]
        change = (ends[0] - ends[1]) * (largest if side else 0.5 * largest)
        return np.asarray((change / self.nudges)[self.free])

    def matrix(self, side: int = 0) -> Float[np.ndarray, "free free"]:
        """The whole derivative."""
        return np.array([self.product(column, side) for column in np.eye(int(self.free.sum()))]).T

    def leading(self, families: int) -> list[Complex[np.ndarray, "multiplier"]]:
        """Multipliers by differences both ways, ahead and back, without ``families``, which are the nearest to 1.

        All of them, or the largest ones.
        """
        size = int(self.free.sum())
        if size <= _DENSE:
            whole = [self.matrix(side) for side in (1, -1)]
            every = [np.linalg.eigvals(table) for table in (0.5 * (whole[0] + whole[1]), *whole)]
        else:
            every = [self._arnoldi(side, families) for side in (0, 1, -1)]
        return [values[np.argsort(np.abs(values - 1.0), kind="stable")][families:].astype(complex) for values in every]

    def _arnoldi(self, side: int, families: int) -> Complex[np.ndarray, "multiplier"]:
        """The largest multipliers; all of them where they are too close to each other for Arnoldi's method."""
        size = int(self.free.sum())
        operator = LinearOperator((size, size), partial(self.product, side=side), dtype=np.float64)
        start = np.random.default_rng(size).standard_normal(size)
        count = min(_SOUGHT + families, size // 3)
        basis = min(max(_BASIS, 3 * count), size)
        try:
            return np.asarray(
                eigs(operator, count, v0=start, ncv=basis, tol=_LEAST_ERROR, maxiter=5, return_eigenvectors=False)
            )
        except ArpackNoConvergence:
            return np.asarray(np.linalg.eigvals(self.matrix(side)))

    def newton_step(self) -> Float[np.ndarray, "coordinate"]:
        """Change of the coordinates with which the motion would close, were it linear; springs that stick stay."""
        rest, size = ((self.end - self.begun) / self.nudges)[self.free], int(self.free.sum())
        if size <= _DENSE:
            # families of states leave a matrix that is singular to the error of the differences
            step = np.linalg.lstsq(np.eye(size) - self.matrix(1), rest, rcond=_KEPT)[0]
        else:
            operator = LinearOperator((size, size), lambda one: one - self.product(one, 1), dtype=np.float64)
            step = gmres(operator, rest, rtol=_SOLVED, restart=size, maxiter=1)[0]
        out = np.zeros_like(self.begun)
        out[self.free] = self.nudges[self.free] * step
        return out


def _periodic(period: PeriodMap, begun: np.ndarray, nudges: np.ndarray, size: float) -> Monodromy | None:
    """The derivative at the periodic motion nearby, by Newton's method with step halving; ``None`` where it fails."""
    here, step, length, best, last = begun, np.zeros_like(begun), 1.0, np.inf, begun
    for _ in range(_NEWTON_STEPS):
        end = period.ahead(here)[0]
        rest = float(np.linalg.norm(end - here)) / size
        if rest <= _CLOSED:
            return Monodromy(period, here, end, nudges)
        if not rest < best:
            length *= 0.5
            if length < _SHORTEST:
                return None
        else:
            best, last, length = rest, here, 1.0
            step = Monodromy(period, here, end, nudges).newton_step()
        here = last + length * step
    return None


def _ranked(values: np.ndarray, others: np.ndarray) -> Float[np.ndarray, "multiplier"]:
    """Difference of the magnitude of every value from that of the same rank among ``others``; the surplus counts 0.

    Magnitudes in their order depend continuously on a matrix, whichever multipliers belong to each other.
    """
    order, sizes = np.argsort(-np.abs(values), kind="stable"), np.zeros(len(values))
    known = np.sort(np.abs(others))[::-1][: len(values)]
    sizes[: len(known)] = known
    out = np.zeros(len(values))
    out[order] = np.abs(np.abs(values)[order] - sizes)
    return out


def _matched(values: np.ndarray, others: np.ndarray) -> Float[np.ndarray, "multiplier"]:
    """Distance of every value from the one of ``others`` that belongs to it; the surplus counts from 0."""
    padded = np.concatenate([others, np.zeros(max(len(values) - len(others), 0))])
    distances = np.abs(values[:, None] - padded[None, :])
    rows, columns = linear_sum_assignment(distances)
    out = np.zeros(len(values))
    out[rows] = distances[rows, columns]
    return out


def _unseen(condensed: Condensed, omega: float) -> Complex[np.ndarray, "multiplier"]:
    """Multipliers of the modes that no contact sees: exp(lambda T), lambda^2 + d lambda + w^2 = 0."""
    base = condensed.problem.base
    if base.damping is not None:
        return np.zeros(0, complex)
    decay, squares = base.decay[~base.coupled], base.frequencies[~base.coupled] ** 2
    root = np.sqrt((0.25 * decay**2 - squares).astype(complex))
    return np.exp(2 * np.pi / omega * np.concatenate([-0.5 * decay + root, -0.5 * decay - root]))


def floquet_multipliers(
    model: BeamModel,
    response: HarmonicResponse,
    settings: HarmonicBalance | None = None,
    *,
    normal_forces: Float[np.ndarray, "joint phase"] | None = None,
    progress: Progress = silent,
) -> tuple[FloquetMultipliers, ...]:
    """Compute the Floquet multipliers of steady states: whether small disturbances of each die out.

    The monodromy is that of the whole state over a period of the force, displacements, velocities and what the friction
    laws remember, by differences of runs of the time solver about the periodic motion. It says nothing of large
    disturbances, and nothing of states whose period is a multiple of that of the force.

    Parameters
    ----------
    model : BeamModel
        The model.
    response : HarmonicResponse
        Its steady states, as ``frf`` and ``frf_up_and_down`` compute them.
    settings : HarmonicBalance, optional
        The settings that the states were computed with.
    normal_forces : array of shape (joint, phase), optional
        The normal forces [N] that the states were computed with.
    progress : Progress, optional
        Called during the computation.

    Returns
    -------
    tuple of FloquetMultipliers
        One for every frequency. Where there is no steady state, or its periodic motion is not found again, its verdict
        is ``undecided``, with the reason.

    Raises
    ------
    InputError
        If the response has other DOFs or contacts than the model.

    References
    ----------
    .. [1] Seydel (2010), Practical Bifurcation and Stability Analysis, chapter 7.
    .. [2] von Groll and Ewins (2001), The harmonic balance method with arc-length continuation in rotor/stator contact
       problems, Journal of Sound and Vibration 241:223.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import Damping
    >>> from ema.examples import beam_model
    >>> from ema.simulate import frf
    >>> for ratio in (0.01, 0.0):
    ...     model = replace(beam_model(), damping=Damping(ratio=ratio))
    ...     response = frf(model, np.array([60.0]), force=1.0, at="1:+X", outputs=["1:+X"])
    ...     print(floquet_multipliers(model, response)[0].verdict)
    stable
    undecided
    """
    chosen = settings or HarmonicBalance()
    condensed = condense(
        model, response.force, response.driven, response.dofs, chosen.tolerance, chosen.modes, normal_forces
    )
    condensed.budget = chosen.budget
    condensed.keep(chosen.harmonics)
    contacts = condensed.problem.system.contacts.tangential
    if response.slips.shape[1] != contacts:
        raise InputError(
            "the steady states are those of another model",
            where=model.name,
            got=f"{response.slips.shape[1]} contacts",
            expected=f"{contacts} contacts",
            advice="give the model that the response was computed from",
        )
    multipliers: list[FloquetMultipliers] = []
    before: _Point | None = None
    for row in range(len(response.frequencies)):
        advance(progress, "multipliers", row, len(response.frequencies))
        point = _again(condensed, response, row, before) if response.converged[row] else None
        if point is None:
            multipliers.append(_open("there is no steady state" if not response.converged[row] else _NOT_AGAIN))
            continue
        multipliers.append(multipliers_of(condensed, point))
        before = point
    return tuple(multipliers)


def _again(condensed: Condensed, response: HarmonicResponse, row: int, before: _Point | None) -> _Point | None:
    """The solution of a row of a response, from its slips; of the neighbour where normal contacts move besides."""
    slips = response.slips[row]
    moving = np.flatnonzero(np.any(slips != 0, axis=0))
    count = int(moving[-1]) + 1 if len(moving) else 1
    start = np.zeros((len(condensed.limits), 2 * count))
    start[: len(slips), ::2], start[: len(slips), 1::2] = slips[:, :count].real, -slips[:, :count].imag
    # two numbers of harmonics are compared: begin with fewer than are needed
    guesses = [start[:, : 2 * max(1, (count + 1) // 2)], start]
    guesses += [] if before is None else [before.amplitudes]
    values = response.values[row][:, list(response.orders).index(1)]
    for guess in (*guesses, None):
        point = condensed.solve(float(response.frequencies[row]), guess)
        if point is None:
            continue
        away = float(np.linalg.norm(condensed.first(point) - values))
        allowed = response.error_estimate[row] if response.error_estimate[row] < 1 else condensed.tolerance
        if away <= (allowed + max(point.error, condensed.tolerance)) * float(np.linalg.norm(values)):
            return point
    return None


@dataclass(frozen=True)
class _Closed:
    """A periodic motion of a period map: its multipliers, by differences both ways, ahead and back."""

    period: PeriodMap
    begun: np.ndarray
    values: np.ndarray
    others: tuple[np.ndarray, ...]
    sticking: int


def _closed(condensed: Condensed, point: _Point, steps: int, begun: np.ndarray | None) -> _Closed | None:
    """The motion that closes over so many steps, from ``begun`` or the harmonic solution, where there is one."""
    period = PeriodMap(condensed, point, steps)
    coordinates = period.start if begun is None else begun
    size, moved = period.extent(coordinates)
    motion = _periodic(period, coordinates, period.nudges(size, moved), size)
    if motion is None:
        return None
    families = period.families(motion.begun, ~motion.free)
    values, *others = motion.leading(families)
    return _Closed(period, motion.begun, values, tuple(others), int((~motion.free).sum()) + families)


def _contradicted(decided: FloquetMultipliers, values: Complex[np.ndarray, "multiplier"]) -> bool:
    """Whether the largest of other multipliers is beyond what those of a decided state leave the largest one."""
    sizes, largest = np.abs(decided.multipliers), float(np.abs(values).max(initial=0.0))
    if decided.verdict == UNSTABLE:
        return largest < float((sizes - decided.errors).max())
    return largest > float((sizes + decided.errors).max(initial=0.0))


def _errors(
    distance: Callable[[np.ndarray, np.ndarray], np.ndarray], last: _Closed, half: _Closed, middle: _Closed
) -> Float[np.ndarray, "multiplier"]:
    """Errors by how far multipliers are apart of half as many steps, of three quarters of them, and of either side."""
    values = last.values
    changes = _SAFETY * distance(values, half.values), _BETWEEN[1] * distance(values, middle.values)
    sides = [distance(values, other) for other in last.others]
    return np.asarray(np.maximum(*changes) + np.maximum(*sides) + _LEAST_ERROR)


def multipliers_of(condensed: Condensed, point: _Point) -> FloquetMultipliers:
    """Floquet multipliers of a harmonic solution, with as many steps of the period as the verdict asks for.

    Every multiplier has as its error twice what half as many steps change, or six times what three quarters of them
    change where that is more, and what differences forward and backward differ by. Of one inside the unit circle that
    by this might be outside, it is the error of the magnitude: higher modes turn many times in a period, and the phase
    of their multipliers hangs on where within steps contacts begin to slip.

    Where a contact turns at the very end of a step, differences on its two sides are those of different motions, and
    the errors of this number of steps may be of any size. What fewer steps decided stays decided, as long as the
    largest multiplier of no number of steps after these is beyond what they leave it.
    """
    steps, last = _STEPS, None
    decided: FloquetMultipliers | None = None
    result = _open("the time solver has no periodic motion near the harmonic solution")
    known: dict[int, _Closed | None] = {}
    while steps <= _MOST_STEPS:
        between = int(_BETWEEN[0] * steps)
        for count in (between, steps) if steps > _STEPS else (steps,):
            last = known[count] = _closed(condensed, point, count, None if last is None else last.begun)
        half, middle = known.get(steps // 2), known.get(between)
        if last is not None and half is not None and middle is not None:
            values, errors = last.values, _errors(_matched, last, half, middle)
            # steps turn multipliers of higher modes by a phase that says nothing of whether they decay
            turned = (np.abs(values) < 1.0) & (np.abs(values) + errors >= 1.0)
            errors = np.where(turned, np.minimum(errors, _errors(_ranked, last, half, middle)), errors)
            result = _result(condensed, point, last.period, (last.begun, values, errors, last.sticking))
            margin = np.maximum(_ACCURATE, _OF_MARGIN * np.abs(np.abs(values) - 1.0))
            if np.all(errors <= margin) and result.verdict != UNDECIDED:
                break
            if result.verdict != UNDECIDED:
                decided = result
            elif decided is not None and any(_contradicted(decided, one.values) for one in (middle, last)):
                decided = None
        steps *= 2
    if result.verdict == UNDECIDED and not result.reason and decided is not None:
        return decided
    if result.verdict == UNDECIDED and not result.reason:
        return replace(result, reason=_NEAR_CIRCLE)
    return result


def _open(reason: str) -> FloquetMultipliers:
    return FloquetMultipliers(np.zeros(0, complex), np.zeros(0), reason=reason)


def _result(
    condensed: Condensed, point: _Point, period: PeriodMap, found: tuple[np.ndarray, np.ndarray, np.ndarray, int]
) -> FloquetMultipliers:
    """Multipliers in order, with what the motion has to do with the harmonic solution."""
    begun, values, errors, sticking = found
    unseen = _unseen(condensed, point.omega)
    if len(values) + sticking < len(begun):
        # the last ones may belong to others in the sets that were compared
        largest = np.argsort(-np.abs(values), kind="stable")[:_LEADING]
        values, errors = values[largest], errors[largest]
    values, errors = np.concatenate([values, unseen]), np.concatenate([errors, np.full(len(unseen), 1e-12)])
    order = np.argsort(-np.abs(values), kind="stable")
    harmonic = condensed.first(point)
    size = max(float(np.linalg.norm(harmonic)), 1e-300)
    distance = float(np.linalg.norm(period.first(begun, point) - harmonic)) / size
    reason = ""
    if distance > min(_SAME * max(point.error, condensed.tolerance), max(_FARTHEST, point.error)):
        reason = "the periodic motion of the time solver is another one than the harmonic solution"
    return FloquetMultipliers(values[order], errors[order], sticking, distance, reason)
