"""What one friction joint on one mode lets a hammer and a shaker test read, in closed form, for many joints at once.

One mode with a Masing spring: k' = (k/pi)(theta - sin(2 theta)/2) and k'' = 4 k y (1 - y)/pi with y = 1/s, theta =
arccos(1 - 2 y), s the slip over that at which the spring yields (Caughey 1960, Journal of Applied Mechanics 27:640).
A hammer gives the mode a slip that its impulse decides; the decay that follows is read as one linear mode. A shaker
holds the mode at the slip at which the power of the force is lost.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
_FREQUENCIES, _DAMPINGS, _REFINEMENTS = 5, 4, 3
"""Trial poles, from the sliding to the sticking frequency and from the least damping to the highest; refinements."""


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

    def ratio(self, forces: Float[np.ndarray, "force"]) -> Float[np.ndarray, "draw force"]:
        """Stiffness of the joint over that of the sliding mode at normal forces in N."""
        contact = self.stiffness[:, None] * (forces / 1000.0) ** self.exponent[:, None]
        return contact * self.rest[:, None] / (contact + self.rest[:, None])

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
    impulse : slip force [N] that yields at the slip an impact on the highest point gives: the highest slip over that at
        which a joint of normal force F_N yields is ``impulse`` times the stiffness ratio over F_N.
    """
    ratio = beam.ratio(forces)
    decay = _Decay.of(beam, ratio)
    highest = impulse[:, None] * ratio / forces
    slips = np.minimum(np.maximum(highest[..., None] * _LEVELS, 1e-9), 0.999 * _NODES[-1])
    poles = decay.best_pole(slips)
    size = np.abs(poles)
    return size / (2 * np.pi), -poles.real / size


@dataclass(frozen=True)
class _Decay:
    """The decay from the highest node down to the first, beyond which it is one pole ``linear`` [rad/s].

    ``pole`` [rad/s] and ``duration`` [s] of every piece between two nodes, ``trials`` [rad/s] to begin a search at.
    """

    pole: np.ndarray
    duration: np.ndarray
    linear: np.ndarray
    trials: np.ndarray

    @classmethod
    def of(cls, beam: Beam, ratio: Float[np.ndarray, "draw force"]) -> "_Decay":
        """The decay of the beams under their normal forces."""
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
        places = np.linspace(0, 1, _FREQUENCIES)
        trial_omega = low[..., None] + (high - low)[..., None] * places
        trial_zeta = np.exp(
            np.log(least)[..., None] + (np.log(most) - np.log(least))[..., None] * np.linspace(0, 1, _DAMPINGS)
        )
        trials = (trial_omega[..., :, None] * (1j - trial_zeta[..., None, :])).reshape(*ratio.shape, -1)
        return cls(-zeta * omega + 1j * omega, duration, linear, trials)

    def best_pole(self, slips: np.ndarray) -> np.ndarray:
        """The pole that explains most of the decays from these slips (draw, force, level) on."""
        worth = self._explained(self.trials, slips)
        best = np.take_along_axis(self.trials, worth.argmax(axis=-1)[..., None], -1)[..., 0]
        spread = np.abs(self.trials[..., _DAMPINGS] - self.trials[..., 0]) + 0.02 * np.abs(best.real)
        steps = [0.5 * spread, 0.3 * np.abs(best.real)]
        for _ in range(_REFINEMENTS):
            around = np.stack(
                [best, best + 1j * steps[0], best - 1j * steps[0], best + steps[1], best - steps[1]], axis=-1
            )
            around = np.minimum(around.real, 0.3 * best.real[..., None]) + 1j * around.imag
            found = np.log(self._explained(around, slips))
            moved = []
            for number, step in enumerate(steps):
                up, down, middle = found[..., 2 * number + 1], found[..., 2 * number + 2], found[..., 0]
                bend = up - 2 * middle + down
                newton = np.where(bend < 0, 0.5 * (down - up) / np.where(bend < 0, bend, -1.0), np.sign(up - down))
                moved.append(np.clip(newton, -1, 1) * step)
            best = np.minimum(best.real + moved[1], 0.3 * best.real) + 1j * (best.imag + moved[0])
            steps = [0.4 * step for step in steps]
        return best

    def _explained(self, poles: np.ndarray, slips: np.ndarray) -> np.ndarray:
        """What exponentials of poles (draw, force, pole) explain of all decays."""
        place = np.log(np.maximum(slips, _START) / _START) / np.log(_NODES[1] / _NODES[0])
        cell = np.minimum(place.astype(int), len(_NODES) - 2)
        levels, cells = (-1, slips.shape[-1]), (-1, self.pole.shape[-1])
        start = (cell.reshape(levels), (place - cell).reshape(levels), slips.reshape(levels))
        decay = (self.pole.reshape(cells), self.duration.reshape(cells), self.linear.ravel())
        found = explained(np.ascontiguousarray(poles.reshape(-1, poles.shape[-1])), start, decay, _COUNTS)
        return np.asarray(found).reshape(poles.shape)


def shaker(
    beam: Beam, force: Float[np.ndarray, "force"], normal: Float[np.ndarray, "force"], drive: Columns
) -> tuple[Float[np.ndarray, "draw force"], Float[np.ndarray, "draw force"]]:
    """Frequency [Hz] and damping ratio at resonance under pairs of force amplitude and normal force [N].

    Parameters
    ----------
    drive : shape at the shaker over the slip of the joint, over the friction coefficient.
    """
    ratio = beam.ratio(normal)
    wanted = drive[:, None] * np.asarray(force) / normal
    place = driven(ratio, np.stack([beam.damping, beam.loss]), wanted, (_SLIPS, _STIFFNESS, _LOSS))
    below = np.minimum(place.astype(int), len(_SLIPS) - 2)
    ends = [beam.curves(ratio, below + one) for one in (0, 1)]
    share = place - below
    return tuple(low + share * (high - low) for low, high in zip(*ends, strict=True))
