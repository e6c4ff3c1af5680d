"""Random joints in one mode, simulated by laws that no candidate of ``ema.compare`` can reproduce; imports no ``ema``.

Sliders with distributed limits are pushed through the cycle sample by sample; the first harmonic of their force gives
frequency and damping of the mode. Four families: sliders of two groups under a pressure that moves with the motion
(rocking), sliders whose friction falls with the velocity, sliders beside a gap that closes, and sliders whose number in
contact falls with the amplitude.
"""

from dataclasses import dataclass

import numpy as np

FAMILIES = ("rocking", "weakening", "gap", "opening")
_SAMPLES, _CYCLES, _SLIDERS = 256, 2, 60


@dataclass(frozen=True)
class SyntheticJoint:
    """What a test would measure, and the truth beyond: amplitude, frequency, damping; their noise; factors beyond."""

    family: str
    amplitude: np.ndarray
    frequency: np.ndarray
    damping: np.ndarray
    frequency_std: np.ndarray
    damping_std: np.ndarray
    beyond: np.ndarray
    true_frequency: np.ndarray
    true_damping: np.ndarray


def draw(seed: int) -> SyntheticJoint:
    """A random joint with 5 to 10 levels over a factor of 3 to 10, and the truth at 1.25, 1.5 and 2 times the highest."""
    rng = np.random.default_rng(seed)
    family = FAMILIES[seed % len(FAMILIES)]
    count, span = int(rng.integers(5, 11)), np.exp(rng.uniform(np.log(3), np.log(10)))
    levels = np.geomspace(1 / span, 1.0, count) * np.exp(rng.uniform(-0.05, 0.05, count))
    levels = np.sort(levels / levels.max())
    factors = np.array([1.25, 1.5, 2.0])
    at = np.concatenate([levels, factors])
    limits = np.concatenate(
        [
            np.exp(rng.normal(rng.uniform(-1.5, 1.5), rng.uniform(0.3, 1.2), _SLIDERS // 2)),
            np.exp(rng.normal(rng.uniform(-0.5, 2.5), rng.uniform(0.3, 1.2), _SLIDERS - _SLIDERS // 2)),
        ]
    )
    weights = rng.dirichlet(np.full(_SLIDERS, 3.0))
    share = np.exp(rng.uniform(np.log(0.004), np.log(0.15)))
    background = np.exp(rng.uniform(np.log(0.0005), np.log(0.005)))
    extra = rng.uniform(0.2, 1.0)
    storage, loss = np.array([_harmonic(family, a, limits, weights, extra) for a in at]).T
    squared = 1 + share * (storage - 1)
    f0 = rng.uniform(30, 300)
    true_f, true_zeta = f0 * np.sqrt(squared), background + share * loss / (2 * squared)
    noise_zeta, noise_f = rng.uniform(0.005, 0.03), rng.uniform(0.02, 0.1)
    std_zeta, std_f = noise_zeta * true_zeta[:count], noise_f * true_zeta[:count] * true_f[:count]
    return SyntheticJoint(
        family,
        levels,
        true_f[:count] + std_f * rng.standard_normal(count),
        true_zeta[:count] + std_zeta * rng.standard_normal(count),
        std_f,
        std_zeta,
        factors,
        true_f[count:],
        true_zeta[count:],
    )


def _harmonic(
    family: str, amplitude: float, limits: np.ndarray, weights: np.ndarray, extra: float
) -> tuple[float, float]:
    """Storage and loss over the stiffness of all sliders, of the last of some cycles."""
    angle = 2 * np.pi * np.arange(_SAMPLES * _CYCLES) / _SAMPLES
    x, speed = amplitude * np.sin(angle), np.abs(np.cos(angle)) * amplitude
    side = np.linspace(-1, 1, len(limits))  # where along the joint a slider lies
    anchor, force = np.zeros(len(limits)), np.empty(len(x))
    active = np.ones(len(limits))
    if family == "opening":
        active = 1 / (1 + (amplitude * extra / 1.5) ** 2 * (side + 1) / 2)
    for n, position in enumerate(x):
        limit = limits
        if family == "rocking":
            limit = limits * np.maximum(1 + 0.6 * extra * side * np.tanh(position), 0.05)
        elif family == "weakening":
            limit = limits * (1 - 0.5 * extra * speed[n] / (speed[n] + 1.0))
        stretch = np.clip(position - anchor, -limit, limit)
        anchor = position - stretch
        force[n] = weights * active @ stretch
        if family == "gap":
            force[n] += 0.6 * extra * (np.maximum(position - 0.7, 0) + np.minimum(position + 0.7, 0))
    last, turn = force[-_SAMPLES:], angle[-_SAMPLES:]
    return 2 * np.mean(last * np.sin(turn)) / amplitude, 2 * np.mean(last * np.cos(turn)) / amplitude
