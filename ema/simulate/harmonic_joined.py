"""Steady states where slip forces change or directions hang together: contacts are followed through samples.

That are isotropic friction in two directions, normal contact that parts or stiffens, and normal forces that change with
the period of the exciting force. Where normal forces change, the motion is no longer odd in time: its mean and its even
harmonics are kept too. How many samples a period has is decided by what twice as many would change.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from ema.contact.laws import Couplings
from ema.data import Finding, HarmonicResponse
from ema.errors import InputError
from ema.simulate.harmonic import LEAST_ERROR, SAFETY, Condensed, _Point
from ema.simulate.transient import _State
from ema.simulate.verification import settled_from_rest

_MOST_PERIODS = 40
"""Periods within which the states of a law have to close: a bound on the work."""
_STEEPEST = 4.0
"""Largest factor on the exciting force, or on the slip forces, in a step towards them."""
_SHARE = 0.02
"""Share of the budget for a start, and for each number of harmonics that begins with the motion in time."""
_TIME_STARTS = (7, 14, 28)
"""Harmonics with which a motion in time is a start, the next one where the one before leads nowhere."""
_FINER, _SETTLED_FINE = 4, 4
"""Factor on the steps of a motion in time that judges it, and on the samples of its forces."""
_LOOSE = 0.03
"""Weight of the error of sampling against that of the quadrature of single contacts."""


@dataclass
class JoinedCondensed(Condensed):
    """A model seen from its contacts, with those that hang together.

    ``pressing`` (joint, phase): normal forces in N at even phases of a period, or ``None`` for those of the model.

    Raises
    ------
    InputError : a motion of the structure is not held, but the contacts load it with a mean force.
    """

    pressing: np.ndarray | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        from ema.simulate import joined_period_kernels

        self.periodic: Any = joined_period_kernels
        contacts, laws = self.problem.system.contacts, self.problem.laws
        count, ties = len(self.limits), laws.couplings
        if ties is None:
            alone = np.full(count, -1)
            ties = Couplings(alone, alone, np.zeros(count), np.zeros((0, 8)), np.zeros((3, 2)))
        self.ties, self.laws = ties, laws.one_by_one()
        self.bounds = np.count_nonzero(laws.flexibility, axis=1), laws.capacity, laws.approach(), laws.rates
        self.exact, self.odd = False, contacts.normals == 0 and _mirrored(self.pressing)
        frequencies = self.problem.base.frequencies
        if not self.odd and frequencies.min() <= 1e-6 * frequencies.max():
            raise InputError(
                "the structure is not held",
                where=self.problem.system.name,
                got="a rigid-body motion",
                expected="a support: normal forces that change bring a mean force",
                advice="clamp it, or use ema.simulate.respond",
            )
        self.members = np.array([np.arange(count), ties.partner, ties.pressed_by]).T.copy()
        self._tables: dict[tuple[int, int], np.ndarray] = {}

    def _fewest_samples(self, count: int) -> int:
        """Samples of a period from which on they are made finer."""
        return max(64, 8 * int(self.orders(count)[-1]))

    def fineness(self, count: int, more: int) -> int:
        """About as many samples as before: kinks ask for them, whatever the number of harmonics."""
        share = self.fine * self._fewest_samples(count) / self._fewest_samples(more)
        return int(2 ** max(0, round(np.log2(share))))

    def _samples(self, count: int, fine: int) -> Float[np.ndarray, "sample size"]:
        """cos and sin of the harmonics at even samples of a period."""
        if (count, fine) not in self._tables:
            orders = self.orders(count)
            samples = fine * self._fewest_samples(count)
            angle = 2 * np.pi * np.arange(samples)[:, None] / samples * orders
            self._tables[count, fine] = np.stack([np.cos(angle), np.sin(angle)], -1).reshape(samples, -1)
        return self._tables[count, fine]

    def _tops(self, shares: Float[np.ndarray, "sample"]) -> Float[np.ndarray, "friction sample"]:
        """Slip forces in N at shares of a period, where they do not follow a normal contact."""
        contacts = self.problem.system.contacts
        first = contacts.tangential
        if self.pressing is None:
            return np.broadcast_to(self.limits[:first, None], (first, len(shares)))
        phases = np.arange(self.pressing.shape[1] + 1) / self.pressing.shape[1]
        force = np.array([np.interp(shares % 1.0, phases, np.append(row, row[0])) for row in self.pressing])
        return np.asarray(force[list(contacts.joint[:first])] * contacts.friction[:first, None])

    def _forces(
        self, amplitudes: np.ndarray, omega: float, fine: int, derive: bool, level: float = 1.0
    ) -> tuple[np.ndarray, ...]:
        count = amplitudes.shape[1] // 2
        basis = self._samples(count, fine)
        ties = self.ties
        result: tuple[np.ndarray, ...] = self.periodic.joined_forces(
            np.ascontiguousarray(amplitudes),
            (self.orders(count), basis, _MOST_PERIODS, omega),
            level * self._tops(np.arange(len(basis)) / len(basis)),
            self.laws,
            (ties.partner, ties.pressed_by, level * ties.friction),
            self.bounds,
            derive,
        )
        return result

    def contact_forces(
        self, amplitudes: np.ndarray, omega: float, fine: int = 1, level: float = 1.0, derive: bool = True
    ) -> tuple[np.ndarray, ...]:
        """Deviations (contact, 2 H), their Jacobian, losses and who deviates; slip forces raised by ``level``."""
        return self._forces(amplitudes, omega, fine, derive, level)[:4]

    def room(self) -> Float[np.ndarray, "contact"]:
        """Forces in N below which contacts stick, and normal contacts stay closed."""
        from ema.contact.normal_kernels import FORCE

        return np.append(self._tops(np.arange(64) / 64).min(axis=1), self.ties.normals[:, FORCE])

    def _cold_start(self, omega: float, gains: np.ndarray) -> tuple[Any, ...] | None:
        """From a small exciting force, under which nothing slips or parts, to the whole one.

        Where that path ends, as friction holds the structure up to some force and then lets it go, the other one begins
        without friction.
        """
        start = self.drive(omega, gains.shape[1])
        reach = self.stiffness * np.hypot(start[:, ::2], start[:, 1::2]).sum(axis=1)
        room = self.room()
        share = min(1.0, 0.5 / max(float((reach[room > 0] / room[room > 0]).max(initial=0.0)), 1e-300))

        def pushed(share: float, start: np.ndarray) -> tuple[Any, ...] | None:
            """Newton's method with that share of the exciting force; amplitudes over the share."""
            self.share = share
            found = self._newton(omega, share * start, gains)
            self.share = 1.0
            return None if found is None else (found[0], found[1] / share, *found[2:])

        found = self._raised(pushed, share, start, _STEEPEST)
        return self._raised(partial(self._levelled, omega, gains), 0.01, start, _STEEPEST) if found is None else found

    def _tried(self, frequency: float, start: np.ndarray | None) -> _Point | None:
        """The solution from the start, or from the motion in time; from wider starts where neither leads to one.

        Where contacts part in every period the path from a small force to the whole one has many corners, and takes
        longer than a motion from rest takes to settle.
        """
        budget = self.left
        self.left = int(_SHARE * budget)
        point = self._solved(frequency, start)
        if point is None or point.error > self.tolerance:
            settled = self._from_time(frequency)
            if point is None or (settled is not None and settled.error < point.error):
                point = settled
        self.left += budget - int(_SHARE * budget)
        return super()._tried(frequency, start) if point is None else point

    def _from_time(self, frequency: float) -> _Point | None:
        """The solution reached from a motion from rest, or that motion where it settles and Newton's method fails."""
        omega = 2 * np.pi * frequency
        motion = settled_from_rest(self, omega)
        if motion is None:
            return None
        path, has_settled = motion
        best: _Point | None = None
        for count in [self.harmonics] if self.harmonics else _TIME_STARTS:
            self.left, self.fine = int(_SHARE * self.budget), 1
            found = self._newton(omega, self._spectrum(path, count), self.gains(omega, count))
            point = None if found is None else self._solved(frequency, found[1])
            if point is not None and (best is None or point.error < best.error):
                best = point
            if best is not None and best.error <= self.tolerance:
                return best
        finer = settled_from_rest(self, omega, _FINER * path.shape[1]) if has_settled else None
        settled = self._as_settled(omega, path, finer[0]) if finer is not None and finer[1] else None
        return min((point for point in (best, settled) if point is not None), key=lambda one: one.error, default=None)

    def _as_settled(self, omega: float, path: np.ndarray, finer: np.ndarray) -> _Point:
        """A motion in time as a solution; its error is what finer steps and the balance of harmonics change."""
        count, self.fine = self.harmonics or self.most_orders, _SETTLED_FINE
        coarse, amplitudes = (self._spectrum(motion, count) for motion in (path, finer))
        forces, _, lost, _ = self.contact_forces(amplitudes, omega, self.fine, derive=False)
        point, other = (_Point(omega, motion, forces, lost, 1.0, fine=self.fine) for motion in (amplitudes, coarse))
        drive, gains = self.drive(omega, count), self.gains(omega, count)
        balanced = replace(point, amplitudes=amplitudes - self.kernels.residual(amplitudes, drive, gains, forces))
        change = self._change(point, other) + self._change(point, balanced)
        point.error = float(min(1.0, max(SAFETY * change, LEAST_ERROR * self.tolerance)))
        return point

    def _spectrum(self, path: Float[np.ndarray, "contact sample"], count: int) -> Float[np.ndarray, "contact size"]:
        """Amplitudes of the first ``count`` harmonics of a path over a period."""
        orders, out = self.orders(count), np.zeros((len(path), 2 * count))
        waves = np.fft.rfft(path, axis=1)
        kept = orders < waves.shape[1]
        values = np.zeros((len(path), count), complex)
        values[:, kept] = waves[:, orders[kept]] * np.where(orders[kept] == 0, 1.0, 2.0) / path.shape[1]
        out[:, ::2], out[:, 1::2] = values.real, -values.imag
        return out

    def refined(
        self, amplitudes: np.ndarray, forces: np.ndarray, lost: np.ndarray, omega: float
    ) -> tuple[Float[np.ndarray, "contact"], float]:
        """Losses from twice the samples, and how much they, the forces and the work of the harmonics differ."""
        better, blur = super().refined(amplitudes, forces, lost, omega)
        orders = self.orders(amplitudes.shape[1] // 2)
        to_and_fro = np.pi * (forces[:, ::2] * amplitudes[:, 1::2] - forces[:, 1::2] * amplitudes[:, ::2]) * orders
        scale = max(float(better.sum()), 1e-3 * float(np.abs(to_and_fro).sum()), 1e-300)
        return better, max(_LOOSE * blur, _LOOSE * abs(float(to_and_fro.sum() - better.sum())) / scale)

    def pressed(self, point: _Point) -> Float[np.ndarray, "normal 4"]:
        """Least and greatest normal force in N, share of the period open, widest gap in m of the normal contacts."""
        return np.asarray(self._forces(point.amplitudes, point.omega, point.fine, False)[4])

    def start_in_time(self, point: _Point, steps: int) -> tuple[_State, float]:
        """State of a solution at its last sample, where following the contacts has left them, and the phase in rad."""
        from ema.contact.call_kernels import FORCE

        self._forces(point.amplitudes, point.omega, point.fine, False)
        exchange, states = self.laws[3:]
        phase = -2 * np.pi / len(self._samples(point.count, point.fine))
        q, p = self.state_at(point, phase)
        return _State(q, p, self.problem.base.slip @ q, exchange[FORCE].copy(), states[0].copy()), phase

    def slip_forces(self, phases: Float[np.ndarray, "step"]) -> Float[np.ndarray, "row contact"]:
        """Slip forces in N at phases of the exciting force in rad, one row where they stay."""
        if self.pressing is None:
            return self.limits[None]
        limits = np.tile(self.limits, (len(phases), 1))
        limits[:, : self.problem.system.contacts.tangential] = self._tops(phases / (2 * np.pi)).T
        return limits

    def completed(self, response: HarmonicResponse, points: Sequence[_Point | None]) -> HarmonicResponse:
        """The response with the slips of the friction contacts alone, and a finding where pairs part."""
        contacts, normals = self.problem.system.contacts, self.problem.system.normals
        findings = list(response.findings)
        pressed = {place: self.pressed(point) for place, point in enumerate(points) if point is not None}
        parted = [place for place, extremes in pressed.items() if np.any(extremes[:, 2] > 0)]
        if parted:
            worst = max(parted, key=lambda place: float(pressed[place][:, 2].max()))
            longest = int(np.argmax(pressed[worst][:, 2]))
            open_share, pairs = float(pressed[worst][longest, 2]), int((pressed[worst][:, 2] > 0).sum())
            findings.append(
                Finding(
                    "warning",
                    "lift-off",
                    response.name,
                    f"pairs part at {len(parted)} of {len(points)} frequencies; at "
                    f"{response.frequencies[worst]:.5g} Hz "
                    f"{pairs} of {contacts.normals}, {normals.pairs[normals.followed[longest]]} for "
                    f"{open_share:.0%} of "
                    "the time.",
                    open_share,
                    0.0,
                    "Press harder there, or read the result as one of a rattling joint.",
                )
            )
        return replace(response, slips=response.slips[:, : contacts.tangential], findings=tuple(findings))


def _mirrored(pressing: np.ndarray | None) -> bool:
    """Whether the normal forces repeat after half a period, which keeps the motion odd."""
    if pressing is None:
        return True
    half, odd = divmod(pressing.shape[1], 2)
    return not odd and bool(np.allclose(pressing[:, :half], pressing[:, half:], rtol=1e-12, atol=0))
