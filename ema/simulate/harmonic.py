"""Steady states under a harmonic force: harmonic balance at the contacts, friction forces in the time domain.

The structure is condensed on the relative displacements of the contacts, harmonic by harmonic; the unknowns are their
Fourier coefficients alone. Friction laws without preference of a direction give odd harmonics only. How many are kept
is decided point by point by what the last ones changed and what a step with more of them would change. Forces of Masing
springs over a period are integrated in closed form; those of other laws by quadrature, refined until it no longer
matters.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import BeamModel, HarmonicResponse
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate.checks import positive
from ema.simulate.factors import LARGE, Factors
from ema.simulate.transient import Problem, _State, prepare, sampled_normal_forces

_CONVERGED, _CONVERGED_ROUGHLY, _GOOD_ENOUGH, _DENSE = 1e-9, 1e-6, 1000.0, 80
"""Residual over the size of the amplitudes, the same where only places are sought, and how much larger than the first
it may stay where no step lowers it; unknowns above which steps are found by GMRES."""
QUADRATURE, _SPARE = 1e-6, 256.0
"""Relative error of losses and forces over a period up to which more nodes are of no use, and how far below it half of
them do: rules of order 7 and 8 gain 2^7 to 2^8 by twice the nodes."""
FINEST = 32
"""Largest factor on the number of nodes: a bound on the work."""
_YIELDING, _MOST_SHAPES, _MOST_SEEN, _MANY_TURNS = 0.2, 8, 9, 14
"""Compliance over that of a contact from which on the coarse inverse holds a shape, how many of them, and at how many
harmonics; turns of GMRES, besides one for every other harmonic, after which that inverse is made anew."""
_FORCING, _ROUGHLY = 1e-3, 0.05
"""How far GMRES solves for a step, and where only the size of the step matters."""
_KEPT = 4
"""Frequencies whose unit motions are kept: that of a point, and those between which a peak is sought."""
_LOW = 9
"""Harmonics that are solved for alone before many are, and with which it is seen first whether two solutions lie on one
branch: they bend the curve."""
SAFETY, LEAST_ERROR = 4.0, 0.8
"""Factor on what more harmonics change; the least error that is stated where contacts slip, over the tolerance."""
FEWEST_HARMONICS, WIDER_STARTS = 3, (5, 9, 14)
"""Harmonics of the first try, and of those after it failed."""
BUDGET, EVALUATION, _ROUGH_SHARE, _JUDGING = 4_000_000, 200, 0.04, 40
"""Unknowns, summed over the evaluations of the contact forces, that the search at one frequency may take; as how many
an evaluation counts besides; the share of a search where a neighbour would do as well; and evaluations that remain to
judge the best solution of a search that was ended. Of 379 cold starts (:mod:`tests.bench.cold_starts`) the one that is
found last takes 2.1 million: the budget is twice that. One contact is given up after some 19,000 evaluations."""
_ALONG_THE_ARC, _FINE_START, _STUCK = 0.95, 4, 1e6
"""Ratio of neighbouring slip forces from which on a solution is sought with more nodes or along the arc, and the factor
on the nodes up to which it is sought with more of them: from 4 on steps were found at every place that was tried. Slip
forces, over those that the stuck motion asks for, at which every law is stuck: one that yields in proportion to the
force deviates there by the rounding of places that are sought roughly."""
_SLIDING, _RISE, _SHORTEST_RISE = 1e-3, 10.0, 1.003
"""Slip forces over those of the model, and over what the sliding motion asks for, at which it begins; the largest and
the smallest factor on them in a step."""
_ASIDE, _SHORTEST = (0.003, -0.003, 0.01, -0.01, 0.03), 0.05
"""Where a steady state is looked for beside a frequency that shows none, relative, and the share of the way back below
which no step is tried. Half a bandwidth of lightly damped modes is 0.003 and more."""


@dataclass
class _Point:
    """A solution at one frequency: amplitudes (contact, 2 H) m, forces alike in N, losses (contact,) in J per cycle."""

    omega: float
    amplitudes: np.ndarray
    forces: np.ndarray
    lost: np.ndarray
    error: float
    height: tuple[float, float] = (np.nan, np.nan)
    """Force amplitude in N, and the size of the first output under it, where it is known."""
    slope: np.ndarray | None = None
    """Derivative of the amplitudes by the angular frequency in m s, where it is known."""
    fine: int = 1
    """Factor on the number of nodes with which its forces are in balance."""

    @property
    def count(self) -> int:
        """Number of harmonics."""
        return int(self.amplitudes.shape[1] // 2)


@dataclass
class _Coarse:
    """Shapes (contact, shape), weights with weights @ shapes = I, and the coarse inverse near a frequency in rad/s.

    ``inverse``: of the lowest orders together, and of the higher ones one by one; empty where there is none yet.
    """

    omega: float
    shapes: np.ndarray
    weights: np.ndarray
    inverse: tuple[np.ndarray, ...] = ()


@dataclass
class Condensed:
    """A prepared model seen from its contacts and one driving force of amplitude ``force`` N.

    ``harmonics`` fixes the number of harmonics; by default the ``tolerance`` decides. ``budget``: unknowns and
    ``EVALUATION`` more, summed over the evaluations of the contact forces, after which the search at a frequency ends.
    """

    problem: Problem
    driven: Dof
    force: float
    tolerance: float = 5e-3
    most_orders: int = 64
    harmonics: int | None = None
    budget: int = BUDGET
    limits: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        from ema.simulate import harmonic_kernels

        self.kernels: Any = harmonic_kernels
        base, contacts = self.problem.base, self.problem.system.contacts
        self.coupled = np.flatnonzero(base.coupled | (base.damping is not None))
        self.slip = np.ascontiguousarray(base.slip[:, self.coupled])
        self.squares, self.decay = base.frequencies[self.coupled] ** 2, base.decay[self.coupled]
        self.load = self.force * base.row(self.problem.system, self.driven)
        self.limits, self.stiffness = np.ascontiguousarray(contacts.limits), np.ascontiguousarray(contacts.stiffness)
        self.springs, self.rates = self.problem.laws.springs(), self.problem.laws.rates
        self.exact = bool((self.springs[0] > 0).all())
        self.members = np.arange(len(self.limits))[:, None].copy()
        self.odd, self.fine, self.left, self.share = True, 1, self.budget, 1.0
        self.accuracy = _CONVERGED
        self.rows = np.array([base.row(self.problem.system, dof) for dof in self.problem.outputs])
        self._orders: dict[tuple[bool, int], np.ndarray] = {}
        self._bases: dict[int, np.ndarray] = {}
        self._coarse: dict[int, _Coarse] = {}
        self._factors = Factors()
        self._motions: dict[float, np.ndarray] = {}
        self._loads = np.column_stack([base.slip.T, self.load / self.force])

    @cached_property
    def quadrature(self) -> tuple[Any, Any]:
        """What the kernels take for laws that are no Masing springs: those without rates, and those with."""
        laws = self.problem.laws
        smooth = (self.springs[0] == 0) & ~self.rates
        bristles = (self.rates, laws.parameters) if self.rates.any() else None
        return laws.one_by_one() if smooth.any() else None, bristles

    def orders(self, count: int) -> Int[np.ndarray, "harmonic"]:
        """The first harmonics: 1, 3, 5 ... of an odd motion, else 0, 1, 2 ..."""
        known = self._orders.get((self.odd, count))
        if known is None:
            known = 2 * np.arange(count) + 1 if self.odd else np.arange(count)
            self._orders[self.odd, count] = known
        return known

    def keep(self, highest: int | None) -> None:
        """Keep the harmonics up to ``highest``, whatever the tolerance.

        Raises
        ------
        InputError : there is no such harmonic.
        """
        if highest is None:
            return
        if not isinstance(highest, int | np.integer) or highest < 1:
            raise InputError(
                "not a harmonic", where=self.problem.system.name, got=highest, expected="a whole number, 1 or more"
            )
        self.harmonics = int(np.searchsorted(self.orders(highest + 1), highest, side="right"))

    def basis(self, count: int) -> Float[np.ndarray, "2 size sample"]:
        """First and second derivative of cos and sin of odd harmonics over half a period, to find turning points."""
        if count not in self._bases:
            orders = self.orders(count)[:, None]
            angle = orders * np.linspace(0.0, np.pi, 4 * int(orders[-1, 0]) + 5)
            rate = np.stack([-orders * np.sin(angle), orders * np.cos(angle)], 1)
            bend = np.stack([-(orders**2) * np.cos(angle), -(orders**2) * np.sin(angle)], 1)
            self._bases[count] = np.array([rate, bend]).reshape(2, 2 * count, -1)
        return self._bases[count]

    @property
    def excited(self) -> int:
        """Index of the harmonic that the force excites."""
        return 0 if self.odd else 1

    def _unit_motions(
        self, damping: Float[np.ndarray, "mode mode"], omega: float, count: int
    ) -> Complex[np.ndarray, "harmonic mode load"]:
        """Amplitudes of all modes under forces of 1 N at every contact, then at the driven DOF, where ``damping``
        couples them: one factorisation per harmonic, kept while the frequency stays."""
        squares = self.problem.base.frequencies**2
        known = self._motions.pop(omega, np.zeros((0, *self._loads.shape), complex))
        if len(known) < count:
            w = omega * self.orders(count)[len(known) :]
            matrices = 1j * w[:, None, None] * damping
            diagonal = np.arange(len(squares))
            matrices[:, diagonal, diagonal] += squares - w[:, None] ** 2
            more = np.linalg.solve(matrices, np.broadcast_to(self._loads, (len(w), *self._loads.shape)))
            known = np.concatenate([known, more])
        if len(self._motions) >= _KEPT:
            self._motions.pop(next(iter(self._motions)))
        self._motions[omega] = known
        return known[:count]

    def motions(
        self, omega: float, forces: Complex[np.ndarray, "harmonic contact"]
    ) -> Complex[np.ndarray, "harmonic mode"]:
        """Amplitudes of all modes under the exciting force and friction deviations ``forces``, which act against."""
        base, at = self.problem.base, self.excited
        if base.damping is None:
            w = omega * self.orders(len(forces))[:, None]
            load = -forces @ base.slip
            load[at] += self.load
            return np.asarray(load / (base.frequencies**2 - w**2 + 1j * w * base.decay))
        units = self._unit_motions(base.damping, omega, len(forces))
        out = -np.matmul(units[:, :, :-1], forces[:, :, None])[:, :, 0]
        out[at] += self.force * units[at, :, -1]
        return np.asarray(out)

    def drive(self, omega: float, count: int) -> Float[np.ndarray, "contact size"]:
        """Relative displacements of stuck contacts under the force alone."""
        at, base = self.excited, self.problem.base
        if base.damping is None:
            w = omega * self.orders(at + 1)[at]
            response = base.slip @ (self.load / (base.frequencies**2 - w * w + 1j * w * base.decay))
        else:
            response = base.slip @ self.motions(omega, np.zeros((at + 1, len(base.slip)), complex))[at]
        out = np.zeros((len(response), 2 * count))
        out[:, 2 * at], out[:, 2 * at + 1] = response.real, -response.imag
        return out

    def contact_forces(
        self, amplitudes: np.ndarray, omega: float, fine: int = 1, level: float = 1.0, derive: bool = True
    ) -> tuple[np.ndarray, ...]:
        """Friction deviations (contact, 2 H), their Jacobian, losses and who slips; slip forces raised by ``level``.

        The Jacobian is of no use without ``derive``.
        """
        count = amplitudes.shape[1] // 2
        result: tuple[np.ndarray, ...] = self.kernels.contact_forces(
            np.ascontiguousarray(amplitudes),
            (self.orders(count), amplitudes @ self.basis(count), fine, omega),
            (self.stiffness, level * self.limits, self.members),
            self.springs,
            *self.quadrature,
            derive,
        )
        return result

    def gains(self, omega: float, count: int) -> Float[np.ndarray, "2 harmonic contact contact"]:
        """Real and imaginary receptances of the contacts at the harmonics."""
        damping = self.problem.base.damping
        if damping is not None:
            whole = np.matmul(self.slip, self._unit_motions(damping, omega, count)[:, :, :-1])
            return np.ascontiguousarray([whole.real, whole.imag])
        w = omega * self.orders(count)[:, None]
        gain = 1 / (self.squares - w**2 + 1j * w * self.decay)
        return np.asarray(np.matmul(np.stack([gain.real, gain.imag])[:, :, None, :] * self.slip, self.slip.T))

    def coarse(self, omega: float, gains: np.ndarray) -> _Coarse:
        """The few shapes of the contacts that the structure yields to most, for all harmonics in ``gains``."""
        count = gains.shape[1]
        known = self._coarse.get(count)
        if known is None or abs(omega / known.omega - 1) > 0.1:
            root = np.sqrt(self.stiffness)
            scaled = root[:, None] * gains * root
            values, vectors = np.linalg.eigh(np.einsum("khij,khlj->il", scaled, scaled) / count)
            keep = vectors[:, values > _YIELDING**2][:, -_MOST_SHAPES:]
            known = _Coarse(
                omega, np.ascontiguousarray(keep / root[:, None]), np.ascontiguousarray((keep * root[:, None]).T)
            )
            self._coarse[count] = known
        return known

    def _newton(self, omega: float, start: np.ndarray, gains: np.ndarray, level: float = 1.0) -> tuple[Any, ...] | None:
        """Newton's method with slip forces raised by ``level``; ``None`` where it fails."""
        if self.left < 0:
            return None
        found = self._run(omega, start, gains, level, 25)
        return found if found[0] >= 0 else None

    def _run(
        self, omega: float, start: np.ndarray, gains: np.ndarray, level: float, most: int, forcing: float = _FORCING
    ) -> tuple[Any, ...]:
        """Solve u - u_drive + Z G(u) = 0 from a start, with step halving; slip forces are raised by ``level``.

        Returns the number of steps (-1: failed), amplitudes, forces, Jacobian, losses, who slips. With ``most`` of 0 a
        single step is made, and its result is in the amplitudes though it counts as failed.
        """
        drive = self.share * self.drive(omega, gains.shape[1])
        amplitudes = trial = np.ascontiguousarray(start)
        step, norm, length, steps = np.zeros_like(trial), np.inf, 1.0, 0
        while True:
            self.left -= trial.size + EVALUATION
            forces, jacobian, lost, slips = self.contact_forces(trial, omega, self.fine, level)
            rest = self.kernels.residual(trial, drive, gains, forces)
            new, size = _norm(rest), _norm(trial)
            if new <= self.accuracy * size:
                return steps, trial, forces, jacobian, lost, slips
            if not new < (1 - 0.1 * length) * norm:
                # a contact that rolls over a tiny wave may leave no better place than this one
                if new <= _GOOD_ENOUGH * _CONVERGED * size:
                    return steps, trial, forces, jacobian, lost, slips
                length *= 0.5
                if length < 0.005 or not np.isfinite(new):
                    break
                trial = amplitudes - length * step
                continue
            amplitudes, norm, length, steps = trial, new, 1.0, steps + 1
            step = self.newton_step(omega, gains, (jacobian, slips), rest, forcing=forcing)
            trial = amplitudes - step
            if steps > most or self.left < 0:
                break
        return -1, trial, forces, jacobian, lost, slips

    def newton_step(
        self,
        omega: float,
        gains: np.ndarray,
        tangents: tuple[np.ndarray, np.ndarray],
        rest: np.ndarray,
        *,
        forcing: float = _FORCING,
    ) -> Float[np.ndarray, "contact size"]:
        """Newton's step, (I + Z dG/dU) step = rest: by GMRES where many contacts slip, else by elimination.

        ``tangents``: the Jacobian and who slips, as ``contact_forces`` returns them.
        """
        jacobian, slips = tangents
        if np.count_nonzero(slips) * rest.shape[1] > _DENSE:
            coarse = self.coarse(omega, gains)
            system, shapes = (gains, jacobian, self.members, slips), (coarse.shapes, coarse.weights)
            step, turns = rest, -1
            if coarse.inverse:
                step, turns = self.kernels.krylov_step(system, rest, (*shapes, *coarse.inverse), forcing)
            if coarse.shapes.shape[1] and turns < 0:
                coarse.inverse = self._coarse_inverse(coarse, gains, jacobian, slips)
                step, turns = self.kernels.krylov_step(system, rest, (*shapes, *coarse.inverse), forcing)
            if turns > _MANY_TURNS + gains.shape[1] // 2:
                coarse.inverse = ()  # of no use any more: the next step makes a new one
            if turns >= 0:
                return np.asarray(step)
        return self._dense_step(gains, jacobian, slips, rest)

    def _dense_step(
        self, gains: np.ndarray, jacobian: np.ndarray, slips: np.ndarray, rest: np.ndarray
    ) -> Float[np.ndarray, "contact size"]:
        """The slipping contacts, and those on whose motion they depend, by elimination; the stuck ones follow."""
        moving = slips
        if self.members.shape[1] > 1:
            on = self.members[slips]
            moving = np.zeros(len(slips), dtype=bool)
            moving[on[on >= 0]] = True
        places = np.flatnonzero(moving)
        if not len(places):
            return rest
        solved = self._eliminated(gains, jacobian, slips, rest, places)
        if len(places) == len(slips):
            return solved
        step = np.zeros_like(rest)
        step[moving] = solved
        pushed = self.kernels.linear_change(step, jacobian, self.members, slips)
        step[~moving] = -self.kernels.residual(np.zeros_like(rest), rest, gains, pushed)[~moving]
        return step

    def _eliminated(
        self, gains: np.ndarray, jacobian: np.ndarray, slips: np.ndarray, rest: np.ndarray, places: np.ndarray
    ) -> Float[np.ndarray, "moving size"]:
        """Newton's step of the contacts at ``places``; the others have no part in it."""

        def matrix() -> np.ndarray:
            return np.asarray(self.kernels.newton_matrix(gains, jacobian, self.members, slips, places))

        right = rest[places]
        if right.size < LARGE:
            return np.linalg.solve(matrix(), right.ravel()).reshape(right.shape)
        zero, change = np.zeros_like(rest), np.zeros_like(rest)

        def product(vector: np.ndarray) -> np.ndarray:
            change[places] = vector.reshape(right.shape)
            pushed = self.kernels.linear_change(change, jacobian, self.members, slips)
            return np.asarray(self.kernels.residual(change, zero, gains, pushed)[places].ravel())

        unknowns = (rest.shape[1], *map(int, places))
        return self._factors.solve(unknowns, product, matrix, right.ravel(), _FORCING).reshape(right.shape)

    def _coarse_inverse(
        self, coarse: "_Coarse", gains: np.ndarray, jacobian: np.ndarray, slips: np.ndarray
    ) -> tuple[Float[np.ndarray, "seen seen"], Float[np.ndarray, "high pair pair"]]:
        """Inverses of (I + Z dG/dU) seen by few shapes of the contacts: low orders together, higher ones one by one."""
        held = slips[:, None] & (self.members >= 0)
        lever = np.where(held[:, :, None], coarse.shapes[self.members], 0.0)
        contacts, count = coarse.shapes.shape
        seen, low = np.matmul(coarse.weights, gains), min(gains.shape[1], _MOST_SEEN)
        change = np.einsum("jwb,jwrc->rjbc", lever, jacobian[:, :, : 2 * low, : 2 * low])
        matrix = _yielding(seen[:, :low], change.reshape(2 * low, contacts, -1)).reshape(low, 2, count, -1)
        whole = matrix.transpose(2, 0, 1, 3).reshape(2 * low * count, -1)
        orders = np.arange(low, gains.shape[1])[:, None]
        own = jacobian[:, :, 2 * orders[:, :, None] + [[0], [1]], 2 * orders[:, :, None] + [[0, 1]]]
        own = np.einsum("jwb,jwhrc->hrjbc", lever, own).reshape(-1, contacts, 2 * count)
        blocks = _yielding(seen[:, low:], own).transpose(0, 2, 1, 3).reshape(-1, 2 * count, 2 * count)
        return np.linalg.inv(np.eye(len(whole)) + whole), np.linalg.inv(np.eye(2 * count) + blocks)

    def room(self) -> Float[np.ndarray, "contact"]:
        """Forces in N below which contacts stick, and normal contacts stay closed."""
        return self.limits

    def _cold_start(self, omega: float, gains: np.ndarray) -> tuple[Any, ...] | None:
        """From the stuck state; where that path ends, as stiff contacts let go all at once, from free sliding."""
        found = self._lowered(omega, gains)
        return self._from_sliding(omega, gains) if found is None else found

    def _from_sliding(self, omega: float, gains: np.ndarray) -> tuple[Any, ...] | None:
        """From the motion without friction: slip forces are raised to their size in steps that adapt."""
        at, start = self.excited, np.zeros((len(self.limits), 2 * gains.shape[1]))
        drive = self.drive(omega, at + 1)[:, 2 * at :] @ [1, -1j]
        free = np.eye(len(drive)) - (gains[0, at] + 1j * gains[1, at]) * self.stiffness
        motion = np.linalg.lstsq(free, drive, rcond=None)[0]
        start[:, 2 * at], start[:, 2 * at + 1] = motion.real, -motion.imag
        slipping = self.limits > 0
        reach = (self.stiffness * np.abs(motion))[slipping] / self.limits[slipping]
        level = min(_SLIDING, _SLIDING * float(reach.min(initial=np.inf)))
        return self._raised(partial(self._levelled, omega, gains), level, start, _RISE)

    def _levelled(self, omega: float, gains: np.ndarray, level: float, start: np.ndarray) -> tuple[Any, ...] | None:
        """Newton's method with slip forces raised by ``level``."""
        return self._newton(omega, start, gains, level)

    def _raised(
        self,
        solve: Callable[[float, np.ndarray], tuple[Any, ...] | None],
        first: float,
        start: np.ndarray,
        steepest: float,
    ) -> tuple[Any, ...] | None:
        """What ``solve`` finds at 1, with a level raised from ``first`` on by factors up to ``steepest`` that adapt."""
        wanted, ratio, reached = first, np.sqrt(steepest), None
        while self.left >= 0:
            found = solve(wanted, start)
            if found is not None:
                if wanted == 1.0:
                    return found
                start, reached, ratio = found[1], wanted, min(ratio**1.5, steepest)
            else:
                ratio = np.sqrt(ratio)
                if reached is None or ratio < _SHORTEST_RISE:
                    return None
            wanted = min(reached * ratio, 1.0)
        return None

    def _lowered(self, omega: float, gains: np.ndarray) -> tuple[Any, ...] | None:
        """From the stuck state: slip forces are lowered from where nothing slips, in steps that adapt.

        Smooth laws yield below their slip forces too: these are first raised to where the stuck state is a start.
        Where these become short the nodes may be too few for Newton's method, as forces jump by the error of quadrature
        where the number of nodes changes. If more of them do not help, the curve turns back to higher slip forces: from
        there on along its arc.
        """
        from ema.simulate.continuation import lowered_slip_forces

        start = self.drive(omega, gains.shape[1])
        reach = self.stiffness * np.hypot(start[:, ::2], start[:, 1::2]).sum(axis=1)
        slipping = self.limits > 0
        level = max(1.0, 1.001 * float((reach[slipping] / self.limits[slipping]).max(initial=0.0)))
        ratio, wanted = 0.5, level
        known: list[tuple[float, np.ndarray]] = []
        while True:
            found = self._newton(omega, start, gains, wanted)
            if found is not None:
                start, level = found[1], wanted
                known = [*known[-1:], (level, start)]
                if level == 1.0:
                    return found
                ratio = max(ratio**1.5, 0.1)
            elif self.left < 0:
                return None
            elif not known and wanted < _STUCK * level:
                wanted *= 10.0
                continue
            else:
                ratio = np.sqrt(ratio)
            if ratio > _ALONG_THE_ARC:
                if self.exact or self.fine >= _FINE_START:
                    break
                self.fine, ratio = 2 * self.fine, 0.5
            wanted = max(level * ratio, 1.0)
        if len(known) < 2:
            return None
        bent = lowered_slip_forces(self, omega, gains, known)
        return None if bent is None else self._newton(omega, bent, gains)

    def _reached(self, omega: float, start: np.ndarray | None, gains: np.ndarray) -> tuple[Any, ...] | None:
        """Solution with the harmonics of ``gains``: from the start, from one with half of them, or from nothing."""
        count = gains.shape[1]
        found = None if start is None else self._newton(omega, with_harmonics(start, count), gains)
        if found is None and count >= 2 * FEWEST_HARMONICS:
            fewer = self._reached(omega, start, np.ascontiguousarray(gains[:, : count // 2]))
            if fewer is not None:
                found = self._newton(omega, with_harmonics(fewer[1], count), gains)
        return self._cold_start(omega, gains) if found is None and count <= WIDER_STARTS[-1] else found

    def at(self, force: float, limits: Float[np.ndarray, "contact"]) -> "Condensed":
        """The same structure under another force amplitude in N and with other slip forces (contact,) in N."""
        other = copy(self)
        other.force, other.load, other.limits = force, self.load * (force / self.force), limits
        return other

    def with_tolerance(self, tolerance: float) -> "Condensed":
        """The same with another tolerance."""
        other = copy(self)
        other.tolerance = tolerance
        return other

    def rough(self, frequency: float, start: np.ndarray | None, count: int) -> _Point | None:
        """Solution with ``count`` harmonics and without an error estimate, to see where the response is large."""
        omega, self.accuracy = 2 * np.pi * frequency, _CONVERGED_ROUGHLY
        self.left = int(_ROUGH_SHARE * self.budget)
        found = self._reached(omega, start, self.gains(omega, count))
        self.accuracy = _CONVERGED
        return None if found is None else _Point(omega, found[1], found[2], found[4], np.nan, fine=self.fine)

    def solve(self, frequency: float, start: np.ndarray | None = None) -> _Point | None:
        """Solution at one frequency in Hz with as many harmonics as the tolerance asks for; ``None``: none found.

        ``start`` (contact, 2 H): amplitudes of a neighbour. Its number of harmonics is where the search begins. Where
        the budget ends the search, ``self.left`` is negative, and the best solution is judged besides.
        """
        self.left = self.budget
        point = self._tried(frequency, start)
        if point is None and self.harmonics is None:
            point = self._from_aside(frequency)
        if self.left < 0 and point is not None and point.error == 1.0:
            over, self.left = self.left, _JUDGING * (2 * point.amplitudes.size + EVALUATION)
            point.error = self.judged(point)
            self.left = over
        return point

    def _tried(self, frequency: float, start: np.ndarray | None) -> _Point | None:
        """The solution from the start, or from wider ones where there is none."""
        point = self._solved(frequency, start)
        for count in WIDER_STARTS:
            # forces that hardly follow the displacement may have no solution with few harmonics
            if point is None and self.harmonics is None and self.left >= 0:
                wider = np.zeros((len(self.limits), 2 * count)) if start is None else with_harmonics(start, count)
                point = self._solved(frequency, wider)
        return point

    def _from_aside(self, frequency: float) -> _Point | None:
        """The solution reached from one at a frequency beside, in steps that are halved where one of them fails."""
        for aside in _ASIDE:
            if self.left < 0:
                break
            place, share = frequency * (1 + aside), 1.0
            point = self._tried(place, None)
            while point is not None and share > _SHORTEST:
                target = frequency if share == 1.0 else place + share * (frequency - place)
                start = with_harmonics(point.amplitudes, max(FEWEST_HARMONICS, point.count // 2))
                near = self._solved(target, start)
                if near is None:
                    share *= 0.5
                elif share == 1.0:
                    return near
                else:
                    place, point, share = target, near, 1.0
        return None

    def _solved(self, frequency: float, start: np.ndarray | None) -> _Point | None:
        """As ``solve``, with no fewer harmonics than those of the start."""
        omega = 2 * np.pi * frequency
        count = self.harmonics or max(FEWEST_HARMONICS, 0 if start is None else start.shape[1] // 2)
        point: _Point | None = None
        coarser: tuple[Any, ...] | None = None
        finest = FINEST
        if start is not None and count > _LOW:
            start = self._near(omega, start)
        while True:
            # a number that is given is judged by many more: of few, the next one or two tell little
            all_gains = self.gains(omega, count + max(6 if self.harmonics else min(count, 6), count // 2))
            gains = np.ascontiguousarray(all_gains[:, :count])
            if coarser is None or start is None:
                found = self._reached(omega, start, gains)
            else:
                found = self._newton(omega, start, gains)
                if found is None:  # a law with kinks may balance on few nodes only: keep what there is
                    self.fine = finest = self.fine // 2
                    found = coarser
            if found is None:
                if point is not None and point.error == 1.0:
                    point.error = self.judged(point)
                return point
            _, amplitudes, forces, _, lost, slips = found
            fine = self.fine
            if not slips.any():
                return _Point(omega, amplitudes, forces, lost, 0.0, fine=fine)
            if not self.exact:
                lost, blur = self.refined(amplitudes, forces, lost, omega)
                if blur > QUADRATURE and self.fine < finest:
                    self.fine, start, coarser = 2 * self.fine, amplitudes, found
                    continue
                if _SPARE * blur <= QUADRATURE:
                    self.fine = max(1, self.fine // 2)
            coarser = None
            before, point = point, _Point(omega, amplitudes, forces, lost, 1.0, fine=fine)
            start = amplitudes
            if self.harmonics:
                point.error = self._doubt(point, self._again(point, all_gains))
                return point
            if before is not None:
                point.error = self._doubt(point, before)
            if point.error <= self.tolerance:
                start, change = self._widened(point, all_gains)
                point.error = max(point.error, SAFETY * change)
            if count >= self.most_orders and before is None:
                point.error = self.judged(point)
            if point.error <= self.tolerance or count >= self.most_orders:
                return point
            before_count, count = count, min(count + max(1, count // 2), self.most_orders)
            self.fine = self.fineness(before_count, count)

    def _near(self, omega: float, start: np.ndarray) -> Float[np.ndarray, "contact size"]:
        """A start whose low harmonics are those of a solution with these alone, where there is one."""
        found = self._newton(omega, with_harmonics(start, _LOW), self.gains(omega, _LOW))
        return start if found is None else np.hstack([found[1], start[:, 2 * _LOW :]])

    def _doubt(self, point: _Point, other: _Point | None) -> float:
        """Error estimate of the first harmonic, relative, from a solution with another number of harmonics.

        Small differences come about by chance: never less than a part of the tolerance is stated, and 1 where there is
        nothing to compare with.
        """
        return 1.0 if other is None else max(SAFETY * self._change(point, other), LEAST_ERROR * self.tolerance)

    def _change(self, point: _Point, other: _Point) -> float:
        """How far the first harmonics of the outputs or of the contacts are apart, relative."""
        place = slice(0, 2) if self.odd else slice(2, 4)
        pairs = ((self.first(point), self.first(other)), (point.amplitudes[:, place], other.amplitudes[:, place]))
        return max(float(np.linalg.norm(a - b)) / max(float(np.linalg.norm(a)), 1e-300) for a, b in pairs)

    def _again(self, point: _Point, gains: np.ndarray, omega: float | None = None) -> _Point | None:
        """The solution with the harmonics of ``gains``, from one with more or fewer, or at another frequency."""
        start, place = with_harmonics(point.amplitudes, gains.shape[1]), omega or point.omega
        found = self._newton(place, start, gains)
        return None if found is None else _Point(place, found[1], found[2], found[4], 1.0, fine=self.fine)

    def joins(self, point: _Point, other: _Point) -> bool:
        """Whether two solutions seem to lie on one branch: from neither a second one is found where the other is.

        Both are sought with the harmonics that the other one has, so that on one branch they differ by rounding. What
        bends a curve is in the low harmonics: solutions with these alone are looked at first, where truncating moves
        both by less than they are apart.
        """
        self.left = int(_ROUGH_SHARE * self.budget)
        fewer = self._truncated(point, other)
        return (fewer is not None and self._meet(*fewer)) or self._meet(point, other)

    def _meet(self, point: _Point, other: _Point) -> bool:
        """Whether none of two solutions, each started from the other one, is a third one."""
        for here, there in ((point, other), (other, point)):
            again = self._again(here, self.gains(there.omega, there.count), there.omega)
            if again is not None and self._change(there, again) > max(there.error, LEAST_ERROR * self.tolerance):
                return False
        return True

    def _truncated(self, *points: _Point) -> list[_Point] | None:
        """Two solutions with the low harmonics alone, where that moves both by less than they are apart."""
        if max(point.count for point in points) <= _LOW:
            return None
        near, apart = list[_Point](), self._change(*points)
        for point in points:
            fewer = self._again(point, self.gains(point.omega, min(point.count, _LOW)))
            if fewer is None or self._change(point, fewer) >= apart:
                return None
            near.append(replace(fewer, error=point.error))
        return near

    def judged(self, point: _Point) -> float:
        """Error estimate of a solution, from one with fewer harmonics and a step with more."""
        if not np.any(np.abs(point.forces) > 0):
            return 0.0
        fewer = self.gains(point.omega, max(1, int(0.7 * point.count)))
        error = self._doubt(point, self._again(point, fewer) if point.count > 1 else None)
        if error <= self.tolerance:
            more = self.gains(point.omega, point.count + max(1, point.count // 2))
            error = max(error, SAFETY * self._widened(point, more)[1])
        return error

    def _widened(self, point: _Point, gains: np.ndarray) -> tuple[Float[np.ndarray, "contact size"], float]:
        """A Newton step with all harmonics of ``gains``, and how much it changes the first one, relative.

        Where the structure yields little to the forces of the contacts, the outputs may move far when their motion
        hardly does.
        """
        start = with_harmonics(point.amplitudes, gains.shape[1])
        wide = self._run(point.omega, start, gains, 1.0, 0, _ROUGHLY)[1]
        forces, _, lost, _ = self.contact_forces(wide, point.omega, self.fine, derive=False)
        return wide, self._change(point, _Point(point.omega, wide, forces, lost, 1.0))

    def refined(
        self, amplitudes: np.ndarray, forces: np.ndarray, lost: np.ndarray, omega: float
    ) -> tuple[Float[np.ndarray, "contact"], float]:
        """Losses from twice the nodes, and how much they and the forces differ from before, relative."""
        better, _, lost_better, _ = self.contact_forces(amplitudes, omega, 2 * self.fine, derive=False)
        force = np.linalg.norm(better - forces) / max(float(np.linalg.norm(better)), 1e-300)
        loss = abs(lost_better.sum() - lost.sum()) / max(abs(float(lost_better.sum())), 1e-300)
        return lost_better, float(max(force, loss))

    def fineness(self, count: int, more: int) -> int:
        """Factor on the nodes with ``more`` harmonics to begin with, where ``self.fine`` was enough for ``count``."""
        return self.fine

    def modal(self, point: _Point) -> Complex[np.ndarray, "harmonic mode"]:
        """Complex amplitudes of all modes at all harmonics of a solution."""
        return self.motions(point.omega, (point.forces[:, ::2] - 1j * point.forces[:, 1::2]).T)

    def first(self, point: _Point) -> Complex[np.ndarray, "dof"]:
        """Complex amplitudes of the first harmonic of the model's outputs."""
        size = 2 * self.excited + 2
        forces = point.forces[:, :size:2] - 1j * point.forces[:, 1:size:2]
        return np.asarray(self.rows @ self.motions(point.omega, forces.T)[self.excited])

    def outputs(self, point: _Point, rows: np.ndarray) -> Complex[np.ndarray, "dof harmonic"]:
        """Complex amplitudes of output DOFs (dof, mode)."""
        return np.asarray(rows @ self.modal(point).T)

    def state_at(self, point: _Point, phase: float) -> tuple[Float[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
        """Modal displacements and velocities of a solution at a phase of the exciting force in rad."""
        orders = self.orders(point.count)[:, None]
        waves = self.modal(point) * np.exp(1j * phase * orders)
        return waves.real.sum(axis=0), (1j * point.omega * orders * waves).real.sum(axis=0)

    def start_in_time(self, point: _Point, steps: int) -> tuple[_State, float]:
        """State of a solution, as so many steps in a period see it, and the phase in rad at which it is that."""
        q, p = self.state_at(point, 0.0)
        orders, laws = self.orders(point.count), self.problem.laws
        spectrum = np.zeros((len(self.limits), steps // 2 + 1), complex)
        # so many steps do not see the higher ones
        kept = orders <= steps // 2
        waves = 0.5 * steps * (point.amplitudes[:, ::2] - 1j * point.amplitudes[:, 1::2])
        spectrum[:, orders[kept]] = waves[:, kept]
        period = np.fft.irfft(spectrum, steps, axis=1)
        path = np.column_stack([np.zeros(len(period)), period, period, period[:, :1]])
        limits = np.broadcast_to(self.limits[:, None], path.shape)
        forces, memory = laws.followed(path, limits, 2 * np.pi / point.omega / steps)
        return _State(q, p, self.problem.base.slip @ q, forces[:, -1], memory), 0.0

    def slip_forces(self, phases: Float[np.ndarray, "step"]) -> Float[np.ndarray, "row contact"]:
        """Slip forces in N at phases of the exciting force in rad, one row where they stay."""
        return self.limits[None]

    def completed(self, response: HarmonicResponse, points: Sequence[_Point | None]) -> HarmonicResponse:
        """The response with what the contacts have to tell besides."""
        return response

    def powers(self, point: _Point) -> tuple[float, float, float]:
        """Mean input, friction and damping power in W."""
        q = self.modal(point)
        speed = 1j * point.omega * self.orders(point.count)[:, None] * q
        supplied = 0.5 * float(np.real(np.conj(speed[self.excited]) @ self.load))
        base = self.problem.base
        lossy = base.decay * speed if base.damping is None else speed @ base.damping
        damping = 0.5 * float(np.real(np.sum(np.conj(speed) * lossy)))
        return supplied, float(point.lost.sum()) * point.omega / (2 * np.pi), damping

    def power_rounding(self, point: _Point) -> float:
        """Power in W that counts as none: where the residual ends, of what goes to and fro."""
        speed = point.omega * self.orders(point.count)
        moved = np.hypot(point.amplitudes[:, ::2], point.amplitudes[:, 1::2])
        springs = 0.5 * float((self.stiffness[:, None] * moved**2 * speed).sum())
        driven = 0.5 * point.omega * float(abs(self.modal(point)[self.excited] @ self.load))
        return _CONVERGED * (springs + driven)


def _yielding(
    seen: Float[np.ndarray, "2 order shape contact"], change: Float[np.ndarray, "row contact column"]
) -> Float[np.ndarray, "order 2 shape column"]:
    """Cos and sin amplitudes that forces (cos and sin of every order are rows) bring about, seen by shapes."""
    return np.stack(
        [
            np.matmul(seen[0], change[::2]) + np.matmul(seen[1], change[1::2]),
            np.matmul(seen[0], change[1::2]) - np.matmul(seen[1], change[::2]),
        ],
        axis=1,
    )


def _norm(table: np.ndarray) -> float:
    flat = table.ravel()
    return float(np.sqrt(flat @ flat))


def with_harmonics(amplitudes: np.ndarray, count: int) -> Float[np.ndarray, "contact size"]:
    """The first ``count`` harmonics, filled up with zeros."""
    out = np.zeros((len(amplitudes), 2 * count))
    size = min(2 * count, amplitudes.shape[1])
    out[:, :size] = amplitudes[:, :size]
    return out


class Branch:
    """Starts for solutions along a curve of slowly changing frequency: extrapolated from the last two."""

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self.last: list[_Point] = []

    def add(self, point: _Point | None) -> None:
        """Take a solution; a hole ends the branch."""
        self.last = [] if point is None else [*self.last[-1:], point]

    def start(self, frequency: float) -> Float[np.ndarray, "contact size"] | None:
        """Amplitudes to begin with at a frequency in Hz, with fewer harmonics where fewer would have done."""
        if not self.last:
            return None
        point = self.last[-1]
        # two numbers of harmonics are compared: begin with fewer than are needed
        count = max(FEWEST_HARMONICS, int((0.5 if point.error <= LEAST_ERROR * self.tolerance else 0.7) * point.count))
        guess = with_harmonics(point.amplitudes, count)
        if len(self.last) == 2 and self.last[0].omega != point.omega:
            before = self.last[0]
            ratio = (2 * np.pi * frequency - point.omega) / (point.omega - before.omega)
            if abs(ratio) <= 2:
                guess += ratio * (guess - with_harmonics(before.amplitudes, count))
        return guess


def condense(
    model: BeamModel,
    force: float,
    at: Dof | str,
    outputs: Sequence[Dof | str],
    tolerance: float,
    modes: int | None = None,
    normal_forces: Float[np.ndarray, "joint phase"] | None = None,
) -> Condensed:
    """A model seen from its contacts, ready for harmonic balance.

    Raises
    ------
    InputError : the force or the tolerance is not positive, the normal forces are none.
    """
    driven = Dof.parse(at)
    problem = prepare(model, outputs, modes, [driven], plane=True, normal=normal_forces is None)
    pressing = None
    if normal_forces is not None:
        phases = max((1, *np.shape(normal_forces)[-1:]))
        pressing = sampled_normal_forces(model, normal_forces, np.arange(phases) / phases)
    return condensed_problem(problem, driven, force, tolerance, pressing)


def condensed_problem(
    problem: Problem,
    driven: Dof,
    force: float,
    tolerance: float,
    pressing: Float[np.ndarray, "joint phase"] | None = None,
) -> Condensed:
    """A prepared problem seen from its contacts; ``pressing`` N are normal forces over a period of the force.

    Raises
    ------
    InputError : the force or the tolerance is not positive.
    """
    from ema.simulate.harmonic_joined import JoinedCondensed

    positive(problem.system.name, force=force, tolerance=tolerance)
    if pressing is None and problem.laws.couplings is None:
        return Condensed(problem, driven, force, tolerance)
    return JoinedCondensed(problem, driven, force, tolerance, pressing=pressing)
