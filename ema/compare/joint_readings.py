"""What one friction joint on one mode lets a hammer and a shaker test read, for many joints at once.

One mode with a spring whose loop has the first harmonic k' + j k'' at a slip s (``ema.compare.joint_loops``). A hammer
gives the mode a slip that its impulse decides; the decay that follows is read as one linear mode. A shaker holds the
mode at the slip at which the power of the force is lost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.compare.decay_kernels import driven, explained
from ema.compare.joint_loops import LAWS, harmonic

_SLIPS = np.geomspace(1e-3, 1e4, 84)
"""Slip over that at which the spring of Masing yields."""
_STEP = float(np.log(_SLIPS[1] / _SLIPS[0]))
_STIFFNESS, _LOSS = (np.stack(each) for each in zip(*(harmonic(law, _SLIPS) for law in LAWS), strict=True))

Columns = Float[np.ndarray, "draw"]

_LEVELS = np.array([0.15, 0.3, 0.45, 0.6, 0.8, 1.0])
_COUNTS = np.array([17.0, 15.0, 15.0, 13.0, 12.0, 8.0])
"""Levels over the highest of 80 points struck on a free plate in bending, and how many points have about that level."""
_START = 0.03
"""Slip at which the decay over the nodes ends: below it the mode is linear, but for a loss factor of 0.013 (Dahl)."""
_NODES = np.geomspace(_START, 3e3, 44)
LARGEST_SLIP = float(0.999 * _NODES[-1])
"""Highest slip that a hammer test is read at; what is beyond counts as that one."""
_FREQUENCIES, _DAMPINGS, _REFINEMENTS = 9, 5, 4
"""Trial poles, from the sliding to the sticking frequency and from the least damping to the highest; refinements.

Of 5534 random decays that slip, another maximum than the highest of a fine grid is found in 2."""


@dataclass(frozen=True)
class Beam:
    """A friction beam on one mode, one number for every draw.

    Parameters
    ----------
    bare : frequency in Hz without the beam.
    drop : relative drop of the frequency with sliding joints.
    damping : damping ratio with the bolted beam, without the joints' friction.
    stiffness : stiffness of the contacts at 1 kN over that of the sliding mode.
    rest : the same of what is in series with the contacts, whatever the normal force.
    exponent : of the contact stiffness over the normal force.
    loss : loss factor of the sticking contacts.
    law : row of ``LAWS``, the first where it is left out.
    opens : lift-off force over the force of the shaker (:meth:`lifted`); without it the contact never opens.
    carried : share of the mass that the mode carries without a normal force, by weight, guides and bolts.
    """

    bare: float
    drop: Columns
    damping: Columns
    stiffness: Columns
    rest: Columns
    exponent: Columns
    loss: Columns
    law: Int[np.ndarray, "draw"] | None = None

    opens: Columns | None = None
    carried: Columns | None = None

    @property
    def laws(self) -> Int[np.ndarray, "draw"]:
        """Row of ``LAWS`` of every draw."""
        return np.zeros(len(self.drop), np.int64) if self.law is None else self.law

    def of(self, draws: np.ndarray) -> "Beam":
        """The beams of these draws."""
        columns = (self.drop, self.damping, self.stiffness, self.rest, self.exponent, self.loss, self.laws)
        return Beam(self.bare, *(one[draws] for one in columns))

    def lifted(
        self, force: Float[np.ndarray, "point"], normal: Float[np.ndarray, "point"]
    ) -> tuple[np.ndarray | float, np.ndarray]:
        """Share of the contact that is closed, and relative drop of the frequency, each (draw, point), under a shaker.

        The force N(t) of a contact that cannot pull is never negative and F_N in the mean over a period T, so that its
        first harmonic, (2/T) |int N(t) cos(wt) dt| <= (2/T) int N(t) dt, is at most 2 F_N. The beam follows by a force
        P = m a, which the force of the shaker decides at resonance: of mass and contact stiffness at most a share of
        2 F_N/P = F_N/F_0 is there, with the lift-off force F_0 = P/2. The model takes that bound.
        """
        if self.opens is None or self.carried is None:
            return 1.0, self.drop[:, None]
        closed = np.minimum(1.0, normal / (self.opens[:, None] * force))
        return closed, self.drop[:, None] * (self.carried[:, None] + (1 - self.carried[:, None]) * closed)

    def ratio(
        self, forces: Float[np.ndarray, "force"], closed: np.ndarray | float = 1.0
    ) -> Float[np.ndarray, "draw force"]:
        """Stiffness of the joint over that of the sliding mode at normal forces in N, of a ``closed`` share."""
        contact = closed * self.stiffness[:, None] * (forces / 1000.0) ** self.exponent[:, None]
        return np.asarray(contact / (1 + contact / self.rest[:, None]))

    def modal(
        self, ratio: np.ndarray, stiffness: np.ndarray, loss: np.ndarray, drop: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Frequency [Hz] of the loaded mode and damping ratio, of the joint's ratio, k'/k and k''/k (draw, ...)."""
        every = (-1, *(1,) * (ratio.ndim - 1))
        stuck, square = self.loss.reshape(every), 1 + ratio * stiffness
        root = np.sqrt(square)
        sliding = self.bare * (1 - (self.drop.reshape(every) if drop is None else drop))
        lost = ratio * (loss + stuck * stiffness)
        return sliding * root, self.damping.reshape(every) / root + lost / (2 * square)


def hammer(
    beam: Beam, forces: Float[np.ndarray, "force"], impulse: Columns
) -> tuple[Float[np.ndarray, "draw force"], Float[np.ndarray, "draw force"]]:
    """Frequency [Hz] and damping ratio that one linear mode fitted to all points of a hammer test reads.

    The decays of all points run along one curve, da/dt = -zeta w a, from their own slip on. The pole is the one with
    which exponentials of free amplitudes leave the least of all decays, in least squares over time (and so, after
    Parseval, over frequency).

    Parameters
    ----------
    beam : one beam for each draw of the parameters.
    forces : normal forces in N, above 0.
    impulse : slip force [N] that yields at the slip an impact on the highest point gives: the highest slip over that at
        which a joint of normal force F_N yields is ``impulse`` times the stiffness ratio over F_N.

    Returns
    -------
    Frequency [Hz] and damping ratio, each (draw, force). Where no point slips beyond ``_START`` they are those of the
    sticking joint; slips beyond the last of ``_NODES`` count as that one.
    """
    ratio = beam.ratio(forces)
    highest = impulse[:, None] * ratio / forces
    slips = np.minimum(np.maximum(highest[..., None] * _LEVELS, 1e-9), LARGEST_SLIP)
    frequency, damping = beam.modal(ratio, np.ones_like(ratio), np.zeros_like(ratio))  # joints that stick throughout
    draws, columns = np.nonzero(slips.max(axis=-1) > _START)
    poles = _Decay.of(beam.of(draws), ratio[draws, columns]).best_pole(slips[draws, columns])
    frequency[draws, columns] = np.abs(poles) / (2 * np.pi)
    damping[draws, columns] = -poles.real / np.abs(poles)
    return frequency, damping


@dataclass(frozen=True)
class _Decay:
    """The decay of every case from the highest node down to the first, beyond which it is one pole ``linear`` [rad/s].

    ``pole`` [rad/s] and ``duration`` [s] of every piece between two nodes; ``frequencies`` and ``rates`` [rad/s] of the
    trial poles to begin a search at.
    """

    pole: np.ndarray
    duration: np.ndarray
    linear: np.ndarray
    frequencies: np.ndarray
    rates: np.ndarray

    @classmethod
    def of(cls, beam: Beam, ratio: Float[np.ndarray, "case"]) -> "_Decay":
        """The decays of beams with these stiffness ratios."""
        middle = np.sqrt(_NODES[1:] * _NODES[:-1])
        step = np.log(_NODES[1] / _NODES[0])
        logs = np.log(_SLIPS)
        frequency, damping = beam.modal(ratio[..., None], _STIFFNESS[beam.laws], _LOSS[beam.laws])
        shape = (*ratio.shape, len(middle))
        place = np.clip((np.log(middle) - logs[0]) / _STEP, 0, len(_SLIPS) - 1.001)
        below, share = place.astype(int), place % 1
        omega, zeta = (
            (one[..., below] + share * (one[..., below + 1] - one[..., below])).reshape(shape)
            for one in (2 * np.pi * frequency, damping)
        )
        duration = step / (zeta * omega)
        low, high = 2 * np.pi * frequency[..., -1], 2 * np.pi * frequency[..., 0]
        linear = -damping[..., 0] * high + 1j * high
        least, most = damping[..., 0], 1.1 * damping.max(axis=-1)
        frequencies = low[..., None] + (high - low)[..., None] * np.linspace(0, 1, _FREQUENCIES)
        powers = np.linspace(0, 1, _DAMPINGS)
        rates = ((low + high) / 2 * least)[..., None] * (most / least)[..., None] ** powers
        return cls(-zeta * omega + 1j * omega, duration, linear, frequencies, rates)

    def best_pole(self, slips: Float[np.ndarray, "case level"]) -> Complex[np.ndarray, "case"]:
        """The pole that explains most of the decays from these slips on.

        Newton's step from nine poles around the best so far, no further than these.
        """
        worth = self._explained(self.frequencies, self.rates, slips).reshape(len(slips), _FREQUENCIES * _DAMPINGS)
        column, row = np.unravel_index(worth.argmax(axis=-1), (_FREQUENCIES, _DAMPINGS))
        cases = np.arange(len(slips))
        centre = np.stack([self.frequencies[cases, column], self.rates[cases, row]])
        step = np.stack([(self.frequencies[:, 1] - self.frequencies[:, 0]) / 2 + 0.01 * centre[1], 0.3 * centre[1]])
        for _ in range(_REFINEMENTS):
            around = centre[:, :, None] + step[:, :, None] * np.array([-1.0, 0.0, 1.0])
            gain = np.log(self._explained(*around, slips))  # type: ignore[call-arg]  # two rows: frequencies, rates
            centre = centre + _newton(gain) * step
            centre[1] = np.maximum(centre[1], around[1, :, 0] / 2)
            step = 0.4 * step
        return np.asarray(-centre[1] + 1j * centre[0])

    def _explained(self, frequencies: np.ndarray, rates: np.ndarray, slips: np.ndarray) -> np.ndarray:
        """What exponentials of frequencies and rates (case, one) explain of all decays (case, frequency, rate)."""
        node = np.log(np.maximum(slips, _START) / _START) / np.log(_NODES[1] / _NODES[0])
        cell = np.minimum(node.astype(int), len(_NODES) - 2)
        start, decay = (cell, node - cell, slips), (self.pole, self.duration, self.linear)
        return np.asarray(explained(frequencies, rates, start, decay, _COUNTS))


def _newton(values: Float[np.ndarray, "case 3 3"]) -> Float[np.ndarray, "2 case"]:
    """Place of the maximum from the middle of nine values, in steps, at most one step off.

    Where they do not bend downwards in all directions, each direction goes by itself, by its end where it rises.
    """
    middle = values[:, 1, 1]
    slope = np.stack([values[:, 2, 1] - values[:, 0, 1], values[:, 1, 2] - values[:, 1, 0]]) / 2
    bend = np.stack([values[:, 2, 1] + values[:, 0, 1], values[:, 1, 2] + values[:, 1, 0]]) - 2 * middle
    twist = (values[:, 2, 2] - values[:, 2, 0] - values[:, 0, 2] + values[:, 0, 0]) / 4
    det = bend[0] * bend[1] - twist**2
    is_peak = (bend < 0).all(axis=0) & (det > 0)
    joint = np.stack([twist * slope[1] - bend[1] * slope[0], twist * slope[0] - bend[0] * slope[1]])
    joint = joint / np.where(is_peak, det, 1.0)
    alone = np.where(bend < 0, -slope / np.where(bend < 0, bend, -1.0), np.sign(slope))
    return np.clip(np.where(is_peak, joint, alone), -1, 1)


def shaker(
    beam: Beam, force: Float[np.ndarray, "force"], normal: Float[np.ndarray, "force"], drive: Columns
) -> tuple[Float[np.ndarray, "draw force"], Float[np.ndarray, "draw force"]]:
    """Frequency [Hz] and damping ratio at resonance under pairs of force amplitude and normal force.

    Parameters
    ----------
    beam : one beam for each draw of the parameters.
    force : amplitude of the force of the shaker in N.
    normal : normal force in N of the same points, above 0.
    drive : shape at the shaker over the slip of the joint, over the friction coefficient.

    Returns
    -------
    Frequency [Hz] and damping ratio, each (draw, point); k' and k'' are interpolated between the slips of the table.
    """
    closed, drop = beam.lifted(force, normal)
    ratio = beam.ratio(normal, closed)
    wanted = drive[:, None] * np.asarray(force) / normal
    losses = np.stack([beam.damping, beam.loss])
    stiffness, loss = driven(ratio, losses, wanted, beam.laws, (_SLIPS, _STIFFNESS, _LOSS))
    return beam.modal(ratio, stiffness, loss, drop)
