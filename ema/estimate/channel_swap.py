"""Whether the force and a response channel of a hammer test were exchanged."""

import numpy as np
from jaxtyping import Float

from ema.data import Recording
from ema.estimate.channels import Layout

REACH = 4096
"""Samples on both sides of the largest value that are looked at: many contact times, and many periods of a response."""

RINGS = 0.5
"""Surplus of power on one side of the mean below which a signal rings; see :func:`one_sided`.

Among 700 drawn records (:mod:`tests.bench.hammer_records`) responses had 0.29 and less, forces with the undershoot of
their sensors 0.80 and more; the five forces of a real test 0.998, their responses 0.01.
"""

PUSHES = 0.7
"""Surplus of power on one side of the mean above which a signal is a pulse."""


def probably_swapped(record: Recording, layout: Layout) -> str | None:
    """Name of the response that looks like the force of a hammer while the force looks like a response, if any."""
    if one_sided(record.signals[layout.references[0]]) > RINGS:
        return None
    surplus = [one_sided(record.signals[row]) for row in layout.responses]
    best = int(np.argmax(surplus))
    return record.channels[layout.responses[best]].name if surplus[best] > PUSHES else None


def one_sided(signal: Float[np.ndarray, "sample"]) -> float:
    """Surplus of the power on one side of the median around the largest value: 1 for a pulse, 0 for an oscillation."""
    offset = np.median(signal[:: max(len(signal) // REACH, 1)])
    top = int(np.argmax(np.abs(signal - offset)))
    near = signal[max(top - REACH, 0) : top + REACH] - offset
    power = float(near @ near)
    return abs(float(near @ np.abs(near))) / power if power > 0 else 0.0
