"""Where a beam may go: all places on a measured surface that are not kept out."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ema.data import Finding
from ema.data.placement import Candidates, FrictionBeam
from ema.errors import InputError
from ema.shapes import Surface

ROUNDING = 1e-9
"""Distance [m] by which rounding may move a coordinate of a few metres: what is that near touches."""


def grid(
    surface: Surface,
    catalogue: Sequence[FrictionBeam],
    step: float,
    angles: Sequence[float] = (0.0, np.pi / 2),
    keep_out: Sequence[Float[np.ndarray, "corner 2"]] = (),
    margin: float = 0.0,
) -> Candidates:
    """Lay candidate locations on a grid over the measured rectangle, where all joints of the beam lie on it.

    Beyond its outer joints, by its overhang, a beam may stick out.

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
        Polygons (corner, 2) [m] in the surface that no part of the beam, with its width, may touch.
    margin : float, default 0.0
        Distance [m] that the joints keep from the edge of the measured rectangle.

    Returns
    -------
    Candidates
        The locations.

    Raises
    ------
    InputError
        If there is no beam, no step, a keep-out area that is no polygon, or no location is left.

    Examples
    --------
    >>> from ema.data import FrictionBeam
    >>> from ema.examples import plate
    >>> from ema.shapes import smooth
    >>> surface = smooth(*plate())
    >>> len(grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.1, angles=[0.0]))
    20
    """
    if not len(catalogue) or not len(angles) or not step > 0:
        raise InputError(
            "nothing to place",
            where="placement",
            got=f"{len(catalogue)} beams, {len(angles)} angles, step {step} m",
            expected="one or more beams, one or more angles and a positive step",
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
    areas = [_polygon(area) for area in keep_out]
    centres, turned, kinds = [], [], []
    for kind, beam in enumerate(catalogue):
        for angle in angles:
            direction = np.array([np.cos(angle), np.sin(angle)])
            joints = points[:, None, :] + beam.places[None, :, None] * direction
            good = np.all((joints >= low - ROUNDING) & (joints <= high + ROUNDING), axis=(1, 2))
            for area in areas:
                good &= ~touch(points, angle, (beam.length, beam.width), area)
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


def about_keep_out(surface: Surface, keep_out: Sequence[Float[np.ndarray, "corner 2"]]) -> tuple[Finding, ...]:
    """Keep-out areas that lie beside the measured rectangle: their coordinates are likely those of other axes."""
    low, high = surface.extent.T
    findings = []
    for number, area in enumerate(keep_out, 1):
        if touch(0.5 * (low + high)[None], 0.0, high - low, _polygon(area))[0]:
            continue
        findings.append(
            Finding.of(
                "warning",
                "keep-out-beside",
                f"keep_out {number}",
                "the area lies beside the measured points, which reach from ({x_low}, {y_low}) to ({x_high}, {y_high}) "
                "m: it keeps nothing out.",
                advice="Give its corners in the coordinates of the geometry, along the axes of the measured plane.",
                x_low=f"{low[0]:.3g}",
                y_low=f"{low[1]:.3g}",
                x_high=f"{high[0]:.3g}",
                y_high=f"{high[1]:.3g}",
            )
        )
    return tuple(findings)


def _polygon(area: Float[np.ndarray, "corner 2"]) -> Float[np.ndarray, "corner 2"]:
    """Corners of a keep-out area.

    Raises
    ------
    InputError : fewer than three corners, or other than two numbers each.
    """
    corners = np.asarray(area, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.all(np.isfinite(corners)):
        raise InputError(
            "not a keep-out area",
            where="placement",
            got=f"shape {corners.shape}",
            expected="three or more corners (x, y) in m",
        )
    return corners


def touch(
    centres: Float[np.ndarray, "p 2"],
    angle: float,
    sides: tuple[float, float] | Float[np.ndarray, "2"],
    corners: Float[np.ndarray, "corner 2"],
) -> Bool[np.ndarray, "p"]:
    """Whether rectangles about ``centres``, turned by ``angle``, share a point with a polygon.

    A side of the polygon meets the rectangle, or the whole rectangle lies within the polygon.
    """
    half = 0.5 * np.asarray(sides) + ROUNDING
    cosine, sine = np.cos(angle), np.sin(angle)
    starts = (corners - centres[:, None]) @ np.array([[cosine, -sine], [sine, cosine]])
    steps = np.roll(starts, -1, axis=1) - starts
    # part of each side, from 0 to 1, between both pairs of edges of the rectangle (Liang and Barsky 1984)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = (np.array([-half, half])[:, None, None] - starts) / steps
    first, last = crossings.min(axis=0).max(axis=-1), crossings.max(axis=0).min(axis=-1)
    meets = np.any(np.maximum(first, 0) <= np.minimum(last, 1), axis=1)
    return np.asarray(meets | _inside(centres, corners))


def _inside(points: Float[np.ndarray, "p 2"], corners: Float[np.ndarray, "corner 2"]) -> Bool[np.ndarray, "p"]:
    """Whether points lie inside a polygon (crossings of a ray)."""
    inside = np.zeros(len(points), bool)
    for (x1, y1), (x2, y2) in zip(corners, np.roll(corners, -1, axis=0)):
        crosses = (y1 > points[:, 1]) != (y2 > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= crosses & (points[:, 0] < x1 + (points[:, 1] - y1) * (x2 - x1) / (y2 - y1))
    return inside
