"""Where the curve of steady states over frequency turns back between two frequencies at which they were computed.

A whole fold may lie between two lines: from either line Newton's method then reaches the other one. The slopes of the
curve at both of them do not explain how far they are apart, and the curve is followed along its arc (Keller 1977).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.simulate.continuation import Arcs, ForcedMotion, along
from ema.simulate.harmonic import Condensed, _Point, with_harmonics

_UNEXPLAINED = 0.4
"""Distance of two states less what the mean of the slopes at both makes of it, over the largest of the three, from
which on the curve between them is followed. At a cusp, where a fold begins, it is 2/3; where a grid is fine, near 0."""
SMOOTH = 0.1
"""The same up to which two states lie on one branch: another one would be closer by far than they are apart."""
_NUDGE, _SHARE = 1e-6, 0.1
"""Relative change of the frequency for the slope; the share of the budget of a line that following takes at most."""
_MOST_HARMONICS = 9
"""Of those with which the curve is followed: what bends it is in the low ones."""
_ARCS = Arcs(first=0.02, longest=0.1, shortest=1e-5, most=400, bend=0.9)
"""Lengths over the size of the motion and the distance of the lines."""


@dataclass(frozen=True)
class ForcedCurve(ForcedMotion):
    """Forced motion at a frequency that is the unknown: 0 at the first line, 1 at the second, ``band`` rad/s."""

    band: tuple[float, float]

    def frequency(self, unknowns: np.ndarray) -> float:
        """Angular frequency in rad/s."""
        return float(self.band[0] + unknowns[0] * (self.band[1] - self.band[0]))


def slope(condensed: Condensed, point: _Point) -> Float[np.ndarray, "contact size"]:
    """Derivative of the amplitudes (contact, 2 H) by the angular frequency in m s."""
    if point.slope is not None:
        return point.slope
    count, omega = point.count, point.omega
    gains, nudged = condensed.gains(omega, count), omega * (1 + _NUDGE)
    forces, jacobian, _, slips = condensed.contact_forces(point.amplitudes, omega, point.fine)
    moved = forces
    if condensed.rates.any():
        moved = condensed.contact_forces(point.amplitudes, nudged, point.fine, derive=False)[0]
    there, here = (
        condensed.kernels.residual(point.amplitudes, condensed.drive(place, count), seen, pushed)
        for place, seen, pushed in ((nudged, condensed.gains(nudged, count), moved), (omega, gains, forces))
    )
    point.slope = -condensed.newton_step(omega, gains, (jacobian, slips), (there - here) / (omega * _NUDGE))
    return point.slope


def unexplained(condensed: Condensed, here: _Point, there: _Point) -> float:
    """Distance of two solutions less what the mean of the slopes at both makes of it, over the largest of the three."""
    size = min(point.amplitudes.shape[1] for point in (here, there))
    secant = (there.amplitudes[:, :size] - here.amplitudes[:, :size]) / (there.omega - here.omega)
    ends = [slope(condensed, point)[:, :size] for point in (here, there)]
    largest = max(float(np.linalg.norm(part)) for part in (secant, *ends))
    return float(np.linalg.norm(secant - 0.5 * (ends[0] + ends[1]))) / max(largest, 1e-300)


def hidden_turns(condensed: Condensed, here: _Point, there: _Point) -> list[float]:
    """Frequencies in Hz between two solutions at which the curve turns back; none where their slopes explain it."""
    condensed.left = int(_SHARE * condensed.budget)
    if unexplained(condensed, here, there) <= _UNEXPLAINED:
        return []
    return turning_points(condensed, here, there) or []


def turning_points(condensed: Condensed, here: _Point, there: _Point) -> list[float] | None:
    """Frequencies in Hz at which the curve turns back on its way from one solution towards another.

    ``None`` where it cannot be followed to the frequency of the other one, or back beyond its own.
    """
    count = min(max(here.count, there.count), _MOST_HARMONICS)
    begun = condensed._again(here, condensed.gains(here.omega, count))
    if begun is None:
        return None
    size = max(float(np.linalg.norm(point.amplitudes)) for point in (here, there))
    band = here.omega, there.omega
    place = np.append(begun.amplitudes.ravel() / size, 0.0)
    tangent = np.append(with_harmonics(slope(condensed, begun), count).ravel() * (band[1] - band[0]) / size, 1.0)
    tangent /= np.linalg.norm(tangent)
    shares, turned = [0.0], list[float]()
    for point in along(lambda plane: ForcedCurve(condensed, plane, band), place, tangent, size, _ARCS):
        shares.append(float(point[-1]))
        if len(shares) > 2 and (shares[-1] - shares[-2]) * (shares[-2] - shares[-3]) < 0:
            turned.append((band[0] + shares[-2] * (band[1] - band[0])) / (2 * np.pi))
        if not 0.0 <= shares[-1] <= 1.0:
            return turned
    return None
