"""What one friction joint on one mode lets a hammer and a shaker test read, in closed form, for many joints at once.

One mode with a Masing spring: k' = (k/pi)(theta - sin(2 theta)/2) and k'' = 4 k y (1 - y)/pi with y = 1/s, theta =
arccos(1 - 2 y), s the slip over that at which the spring yields (Caughey 1960, Journal of Applied Mechanics 27:640).
A hammer gives the mode a slip that its impulse decides; the decay that follows is read as one linear mode. A shaker
holds the mode at the slip at which the power of the force is lost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ema.compare.decay_kernels import driven, explained

_SLIPS = np.geomspace(1e-2, 1e4, 72)
"""Slip over that at which the spring yields."""
_STEP = float(np.log(_SLIPS[1] / _SLIPS[0]))
_THETA = np.arccos(1 - 2 / np.maximum(_SLIPS, 1.0))
_STIFFNESS = (_THETA - np.sin(2 * _THETA) / 2) / np.pi
_LOSS = 4 / np.maximum(_SLIPS, 1.0) * (1 - 1 / np.maximum(_SLIPS, 1.0)) / np.pi

Columns = Float[np.ndarray, "draw"]

_LEVELS = np.array([0.15, 0.3, 0.45, 0.6, 0.8, 1.0])
_COUNTS = np.array([17.0, 15.0, 15.0, 13.0, 12.0, 8.0])
"""Levels over the highest of 80 points struck on a free plate in bending, and how many points have about that level."""
_START = 1.0
"""Slip at which the decay over the nodes ends: below it the mode is linear."""
_NODES = np.geomspace(_START, 3e3, 31)
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
    """

    bare: float
    drop: Columns
    damping: Columns
    stiffness: Columns
    rest: Columns
    exponent: Columns
    loss: Columns

    def of(self, draws: np.ndarray) -> "Beam":
        """The beams of these draws."""
        columns = (self.drop, self.damping, self.stiffness, self.rest, self.exponent, self.loss)
        return Beam(self.bare, *(one[draws] for one in columns))

    def ratio(self, forces: Float[np.ndarray, "force"]) -> Float[np.ndarray, "draw force"]:
        """Stiffness of the joint over that of the sliding mode at normal forces in N."""
        contact = self.stiffness[:, None] * (forces / 1000.0) ** self.exponent[:, None]
        return np.asarray(contact * self.rest[:, None] / (contact + self.rest[:, None]))

    def curves(self, ratio: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frequency [Hz] and damping ratio at rows of the slips, of stiffness ratios (draw, ...) of the same shape."""
        drop, damping, loss = (
            each.reshape(-1, *(1,) * (ratio.ndim - 1)) for each in (self.drop, self.damping, self.loss)
        )
        square = 1 + ratio * _STIFFNESS[rows]
        lost = ratio * (_LOSS[rows] + loss * _STIFFNESS[rows])
        return self.bare * (1 - drop) * np.sqrt(square), (2 * damping * np.sqrt(square) + lost) / (2 * square)


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
    slips = np.minimum(np.maximum(highest[..., None] * _LEVELS, 1e-9), 0.999 * _NODES[-1])
    frequency, damping = beam.curves(ratio, np.array(0))  # joints that stick throughout
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
        frequency, damping = beam.curves(ratio[..., None], np.arange(len(_SLIPS)))
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
    Frequency [Hz] and damping ratio, each (draw, point), interpolated between the slips of the table.
    """
    ratio = beam.ratio(normal)
    wanted = drive[:, None] * np.asarray(force) / normal
    row = driven(ratio, np.stack([beam.damping, beam.loss]), wanted, (_SLIPS, _STIFFNESS, _LOSS))
    below = np.minimum(row.astype(int), len(_SLIPS) - 2)
    ends = [beam.curves(ratio, below + step) for step in (0, 1)]
    share = row - below
    return tuple(low + share * (high - low) for low, high in zip(*ends, strict=True))
