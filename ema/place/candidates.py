"""Where a beam may go: all places on a measured surface that are not kept out."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ema.data.placement import Candidates, FrictionBeam
from ema.errors import InputError
from ema.shapes import Surface

_ALONG_BEAM = 9
"""Points along a beam that must lie on the surface and off the keep-out areas."""


def grid(
    surface: Surface,
    catalogue: Sequence[FrictionBeam],
    step: float,
    angles: Sequence[float] = (0.0, np.pi / 2),
    keep_out: Sequence[Float[np.ndarray, "corner 2"]] = (),
    margin: float = 0.0,
) -> Candidates:
    """Lay candidate locations on a grid over the measured rectangle, where the whole beam lies on it.

    Parameters
    ----------
    surface : Surface
        Smooth shapes of the structure.
    catalogue : sequence of FrictionBeam
        Beams to choose from.
    step : float
        Least distance between neighbouring centres [m]; they are spread evenly, from edge to edge.
    angles : sequence of float, optional
        Directions of the beam [rad] from the first axis of the surface.
    keep_out : sequence of array of shape (corner, 2), optional
        Polygons (corner, 2) [m] in the surface that no part of the beam's axis may touch.
    margin : float, default 0.0
        Distance [m] that the joints keep from the edge of the measured rectangle.

    Returns
    -------
    Candidates
        The locations.

    Raises
    ------
    InputError
        If there is no beam, no step, or no location is left.

    Examples
    --------
    >>> from ema.data import FrictionBeam
    >>> from ema.examples import plate
    >>> from ema.shapes import smooth
    >>> surface = smooth(*plate())
    >>> len(grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.1, angles=[0.0]))
    20
    """
    if not catalogue or not step > 0:
        raise InputError(
            "nothing to place",
            where="placement",
            got=f"{len(catalogue)} beams, step {step} m",
            expected="one or more beams and a positive step",
        )
    low, high = surface.extent[:, 0] + margin, surface.extent[:, 1] - margin
    if np.any(high < low):
        raise InputError(
            "the margin leaves no surface",
            where="placement",
            got=f"{margin} m",
            expected=f"below {(surface.extent[:, 1] - surface.extent[:, 0]).min() / 2:.3g} m",
        )
    axes = [np.linspace(a, b, max(int((b - a) / step) + 1, 1)) if b > a else np.array([a]) for a, b in zip(low, high)]
    points = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=1)
    centres, turned, kinds = [], [], []
    for kind, beam in enumerate(catalogue):
        for angle in angles:
            direction = np.array([np.cos(angle), np.sin(angle)])
            along = np.linspace(-0.5, 0.5, _ALONG_BEAM) * beam.length
            axis = points[:, None, :] + along[None, :, None] * direction
            joints = points[:, None, :] + beam.places[None, :, None] * direction
            good = np.all((joints >= low - 1e-9) & (joints <= high + 1e-9), axis=(1, 2))
            for area in keep_out:
                good &= ~np.any(_inside(axis.reshape(-1, 2), np.asarray(area)).reshape(axis.shape[:2]), axis=1)
            centres.append(points[good])
            turned.append(np.full(good.sum(), angle))
            kinds.append(np.full(good.sum(), kind))
    candidates = Candidates(np.concatenate(centres), np.concatenate(turned), np.concatenate(kinds), tuple(catalogue))
    if not len(candidates):
        sides = surface.extent[:, 1] - surface.extent[:, 0]
        lengths = ", ".join(f"{beam.length:.3g} m" for beam in catalogue)
        raise InputError(
            "no place for the beam",
            where="placement",
            got=f"beams of {lengths}",
            expected=f"beams that fit on {sides[0]:.3g} m x {sides[1]:.3g} m beside what is kept out",
            advice="shorter beams, smaller keep-out areas, or a finer step",
        )
    return candidates


def _inside(points: Float[np.ndarray, "p 2"], corners: Float[np.ndarray, "corner 2"]) -> Bool[np.ndarray, "p"]:
    """Whether points lie inside a polygon (crossings of a ray) or on its edge."""
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InputError(
            "not a keep-out area",
            where="placement",
            got=f"shape {corners.shape}",
            expected="three or more corners (x, y) in m",
        )
    inside, edge = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0)):
        crosses = (y1 > points[:, 1]) != (y2 > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            at = x1 + (points[:, 1] - y1) * (x2 - x1) / (y2 - y1)
        inside ^= crosses & (points[:, 0] < at)
        side, start = np.array([x2 - x1, y2 - y1]), points - [x1, y1]
        along = np.clip(start @ side / max(float(side @ side), 1e-300), 0, 1)
        edge |= np.hypot(*(start - along[:, None] * side).T) < 1e-9
    return inside | edge
