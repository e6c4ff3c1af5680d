"""Patches whose edges lift off: what is left of the normal springs of a joint that can press but not pull.

A patch of length l carries the normal force F_N as a pressure p(s) F_N, and k_N spread evenly. Where gap and rocking
open it with the amplitude a(s) about a mean d, a piece of stiffness k holds min(k w, p F_N ds) of w = d + a cos theta:
it is unloaded beyond r = (p F_N ds / k - d) / a. Of its stiffness the first harmonic keeps the share
1 - (acos r - r sqrt(1 - r^2)) / pi, and in the mean it holds k (d - a (sqrt(1 - r^2) - r acos r) / pi) (describing
function of a saturation on one side: Gelb and Vander Velde 1968, appendix B). The mean opening d is that at which the
patch carries F_N as before.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ema.data import BeamModel

PRESSURE = (0.0, 2.0)
"""Exponents of the pressure over a patch, from even to that under a bolt: drawn evenly, the middle where none is."""
_PIECES = 24
"""Pieces of a patch. Twice as many change what is left of a spring by less than 1 %."""
_STEPS = 8
"""Newton steps for the mean opening."""


class Patches(NamedTuple):
    """Joints whose contact has a length: F_N and length (joint,) in N and m, and the exponent of their pressure
    (1 - (2 s / l)^2)^exponent: 0 is even, 1/2 that of a round contact (Hertz), 1 and more that under a bolt.
    """

    pressed: Float[np.ndarray, "joint"]
    length: Float[np.ndarray, "joint"]
    exponent: float


def patches(model: BeamModel, exponent: float) -> Patches | None:
    """The patches of a model; ``None`` where a joint has no length, or several node pairs of its own."""
    if any(not joint.contact_length or len(joint.pairs) > 1 for joint in model.joints):
        return None
    pressed = np.array([joint.normal_force for joint in model.joints], float)
    return Patches(pressed, np.array([joint.contact_length for joint in model.joints]), exponent)


def softened(
    patch: Patches, flexibility: Complex[np.ndarray, "spring"], motion: Complex[np.ndarray, "spring"]
) -> Complex[np.ndarray, "spring"]:
    """Flexibilities of gaps, then of rockings, in a motion of both.

    ``flexibility`` of the patch at rest in m/N and rad/(N m), ``motion`` gaps in m and rotations in rad.
    """
    count = len(patch.pressed)
    places = (np.arange(_PIECES) + 0.5) / _PIECES - 0.5
    pressure = (1 - 4 * places**2) ** patch.exponent
    rocking = np.outer(motion[count:] * patch.length, places)
    # force of a piece at rest over its stiffness, and amplitude of its motion
    reach = np.outer(patch.pressed * _PIECES * flexibility[:count].real, pressure / pressure.sum())
    amplitude = np.maximum(np.abs(motion[:count, None] + rocking), 1e-12 * reach.max(axis=1, keepdims=True))
    opened = np.zeros((count, 1))
    for _ in range(_STEPS):
        # concave in the opening: Newton's steps come from below
        r = np.clip((reach - opened) / amplitude, -1, 1)
        away = np.arccos(r)
        carried = np.minimum(opened - amplitude * (np.sqrt(1 - r**2) - r * away) / np.pi, reach)
        slope = np.maximum(_PIECES - away.sum(axis=1, keepdims=True) / np.pi, 1e-3)
        opened = opened - carried.sum(axis=1, keepdims=True) / slope
    r = np.clip((reach - opened) / amplitude, -1, 1)
    kept = 1 - (np.arccos(r) - r * np.sqrt(1 - r**2)) / np.pi
    turning = kept @ places**2 / np.sum(places**2)
    return np.asarray(flexibility / np.maximum(np.concatenate([kept.mean(axis=1), turning]), 1e-6))
