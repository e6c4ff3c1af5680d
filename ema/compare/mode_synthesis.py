"""Single nonlinear mode synthesis: the response of a mode whose frequency and damping depend on its amplitude.

Near the resonance of a mode whose frequency w_r and damping ratio zeta depend on the amplitude, the displacement x
under a force F follows (Szemplinska-Stupnicka 1979; Krack 2015)

    m [w_r(x)^2 - w^2 + 2j zeta(x) w_r(x) w] x = F,

m the modal mass for a shape of 1 at the response. The force that keeps up x at w is the size of the left side: a
surface over (w, x), which response-controlled tests measure (Karaagacli and Ozguven 2021). Its cut at a force is closed
in w^2 = u for a given x, since w_r and zeta are known there:

    u^2 - 2 w_r^2 (1 - 2 zeta^2) u + w_r^4 - (F / (m x))^2 = 0,

which gives all responses, folded ones too. Force and displacement are in quadrature where F = 2 zeta m w_r^2 x (phase
resonance; Kerschen 2009). Where the surface falls with x at constant w a response is not stable: more amplitude needs
less force. A response swept through such a fold moves to the next stable one, up where the force exceeds what its
amplitude needs, else down.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ema.compare.predictive_draws import at_amplitudes, derivative, modal_masses
from ema.data import AmplitudeDraws

_FINE = 400
"""Amplitudes at which curves are computed, geometric over the draws: neighbours are about 1 % apart; between them the
logarithm of the force is a straight line."""

DISTINCT = 0.1
"""Distance in log amplitude from which on two responses, or resonances, are two: a tenth. Nearer ones are no
jump that a test would show. Halved, the share of folded draws of the Brake-Reuss beam does not change, doubled it falls
by a third."""


@dataclass(frozen=True)
class Curves:
    """Of every draw, over rising displacements ``x`` [m]: w_r^2 and c = 2 zeta w_r: F = m x |w_r^2 - w^2 + jcw|.

    Displacements of a draw are those of its amplitudes at resonance, a = w_r^p x.
    """

    x: Float[np.ndarray, "draw fine"]
    w2: Float[np.ndarray, "draw fine"]
    c: Float[np.ndarray, "draw fine"]
    mass: Float[np.ndarray, "draw"]

    @classmethod
    def of(cls, draws: AmplitudeDraws, lowest: float = np.inf) -> "Curves":
        """The curves of draws, continued below them from a displacement ``lowest`` on with what they are there."""
        knots, power = np.log(draws.amplitude[[0, -1]]), derivative(draws.quantity)
        start = np.log(lowest) + power * np.log(2 * np.pi * float(draws.frequency.min()))
        below = np.linspace(start, knots[0], _FINE // 2)[:-1] if start < knots[0] else np.zeros(0)
        logs = np.concatenate([below, np.linspace(knots[0], knots[1], _FINE)])
        frequency, damping = at_amplitudes(draws, logs)
        angular = 2 * np.pi * frequency
        # x rises with the amplitude as long as w_r changes by less than the amplitude does; what does not is cut level
        x = np.maximum.accumulate(np.exp(logs) / angular**power, axis=1)
        return cls(x, angular**2, 2 * damping * angular, modal_masses(draws))

    def median(self) -> "Curves":
        """One curve of the medians of displacement, frequency and loss at each amplitude."""
        x, w2, c = (np.median(values, axis=0)[None] for values in (self.x, self.w2, self.c))
        return Curves(x, w2, c, np.median(self.mass)[None])

    def at(self, x: Float[np.ndarray, "line"]) -> tuple[Float[np.ndarray, "draw line"], Float[np.ndarray, "draw line"]]:
        """w_r^2 and c at displacements; NaN beyond the last, level below the first."""
        logs = np.log(x)
        own = np.log(self.x)
        w2, c = (
            np.array([np.interp(logs, at, row, right=np.nan) for at, row in zip(own, values, strict=True)])
            for values in (self.w2, self.c)
        )
        return w2, c

    def needed(self, angular: float) -> Float[np.ndarray, "draw fine"]:
        """Force at the displacements and one frequency [rad/s]."""
        return np.asarray(self.mass[:, None] * self.x * np.hypot(self.w2 - angular**2, self.c * angular))

    def sweep(
        self, angular: Float[np.ndarray, "line"], force: Float[np.ndarray, "line"]
    ) -> tuple[Float[np.ndarray, "draw line"], Float[np.ndarray, "draw line"], float]:
        """Displacement and phase of every draw along lines in the order of a sweep that begins at rest, and the share
        of draws with several stable responses at a line. Infinite where the response leaves the draws."""
        draws, fine = self.x.shape
        rows, order = np.arange(draws), np.arange(fine - 1)
        segment = np.zeros(draws, dtype=int)
        log_x, out = np.log(self.x), np.empty((2, draws, len(angular)))
        reached = log_x[:, 0].copy()
        several = np.zeros(draws, dtype=np.bool_)
        for n, (w, f) in enumerate(zip(angular, force, strict=True)):
            off = np.log(self.needed(float(w)) / f)
            stable = (off[:, :-1] < 0) & (off[:, 1:] >= 0)
            lowest, last = stable.argmax(axis=1), order[-1] - stable[:, ::-1].argmax(axis=1)
            several |= stable.any(axis=1) & (log_x[rows, last] - log_x[rows, lowest] > DISTINCT)
            left, right = log_x[rows, segment], log_x[rows, segment + 1]
            share = np.clip((reached - left) / np.maximum(right - left, 1e-300), 0, 1)
            here = off[rows, segment] + share * (off[rows, segment + 1] - off[rows, segment])
            # at the stable response itself the rounded force may be on either side: both look from its own segment on
            above = np.where(stable & (order >= segment[:, None]), order, fine).min(axis=1)
            below = np.where(stable & (order <= segment[:, None]), order, -1).max(axis=1)
            target = np.where(here < 0, above, np.where(below >= 0, below, above))
            beyond = target >= fine - 1
            segment = np.minimum(target, fine - 2)
            ends = off[rows, segment], off[rows, segment + 1]
            share = np.where(beyond, 1.0, np.clip(-ends[0] / np.where(beyond, 1.0, ends[1] - ends[0]), 0, 1))
            left, right = log_x[rows, segment], log_x[rows, segment + 1]
            reached = left + share * (right - left)
            w2, c = (
                values[rows, segment] + share * (values[rows, segment + 1] - values[rows, segment])
                for values in (self.w2, self.c)
            )
            out[0, :, n] = np.where(beyond, np.inf, np.exp(reached))
            out[1, :, n] = -np.arctan2(c * w, w2 - w**2)
        return out[0], out[1], float(several.mean())

    def solutions(
        self, angular: Float[np.ndarray, "line"], force: Float[np.ndarray, "line"]
    ) -> Int[np.ndarray, "line"]:
        """Number of responses of the first curve at each line."""
        return np.array(
            [
                int(np.count_nonzero(np.diff(np.sign(np.log(self.needed(float(w))[0] / f)))))
                for w, f in zip(angular, force, strict=True)
            ]
        )

    def cut(self, force: float) -> Float[np.ndarray, "2 point"]:
        """All responses of the first curve to a force: frequency [rad/s] and displacement along it.

        u = w_r^2 - c^2 / 2 -+ sqrt((F / (m x))^2 - c^2 w_r^2 + c^4 / 4), with c = 2 zeta w_r: from the lower frequency
        up to where the root vanishes, and back along the higher one. Separate curves are parted by NaN.
        """
        x, w2, c2 = self.x[0], self.w2[0], self.c[0] ** 2
        x, w2, c2 = _closer(x, w2, c2, lambda x, w2, c2: (force / (self.mass[0] * x)) ** 2 - c2 * w2 + c2**2 / 4)
        root = (force / (self.mass[0] * x)) ** 2 - c2 * w2 + c2**2 / 4
        size = np.sqrt(np.maximum(root, 0.0))
        real = root >= -1e-12 * w2**2
        parts = []
        for run in _runs(real):
            low, high = (w2 - c2 / 2 - size)[run], (w2 - c2 / 2 + size)[run]
            u, along = np.concatenate([low, high[::-1]]), np.concatenate([x[run], x[run][::-1]])
            u, along = u[u > 0], along[u > 0]
            parts += [np.stack([np.sqrt(u), along]), np.full((2, 1), np.nan)]
        return np.concatenate(parts[:-1], axis=1) if parts else np.zeros((2, 0))


def _closer(
    x: Float[np.ndarray, "point"],
    w2: Float[np.ndarray, "point"],
    c2: Float[np.ndarray, "point"],
    root: Callable[..., np.ndarray],
) -> tuple[Float[np.ndarray, "finer"], Float[np.ndarray, "finer"], Float[np.ndarray, "finer"]]:
    """The curve with points ever closer to where ``root`` vanishes, on which frequencies follow its square root."""
    signs = root(x, w2, c2)
    rows = np.flatnonzero((signs[:-1] > 0) != (signs[1:] > 0))
    logs, extra = np.log(x), []
    for row in rows:
        low, high = logs[row], logs[row + 1]
        for _ in range(50):
            middle = 0.5 * (low + high)
            at = [np.interp(middle, logs, values) for values in (w2, c2)]
            side = root(np.exp(middle), *at) > 0
            low, high = (middle, high) if side == (signs[row] > 0) else (low, middle)
        end = low if signs[row] > 0 else high
        inner = logs[row] if signs[row] > 0 else logs[row + 1]
        extra.append(end + (inner - end) * np.linspace(0, 1, 12)[:-1] ** 2)
    every = np.sort(np.concatenate([logs, *extra]))
    return np.exp(every), np.interp(every, logs, w2), np.interp(every, logs, c2)


def _runs(real: Bool[np.ndarray, "point"]) -> list[slice]:
    """Stretches of neighbouring points that are real."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], real, [False]]).astype(int)))
    return [slice(int(first), int(last)) for first, last in edges.reshape(-1, 2)]
