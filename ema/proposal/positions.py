"""What looks wrong in the positions of measured points: millimetres taken for metres, doubles, mirrored points."""

import numpy as np

from ema.data import Finding, Geometry

LARGEST = 30.0
"""Extent in m above which positions are questioned; at half of it a turbine blade of 20 m would be."""
SMALLEST = 0.005
"""Extent in m below which positions are questioned; at twice of it a small printed circuit board would be."""

ALONE = 0.1
"""Share of the points on one side of a coordinate plane up to which they are suspected of a wrong sign."""

_SAME = 1e-6
"""Of the extent: points nearer than this are one."""


def findings(geometry: Geometry, where: str, unit: str = "m") -> tuple[Finding, ...]:
    """Return what looks wrong in the positions of a geometry.

    Parameters
    ----------
    geometry : Geometry
        In m, as the stated unit makes it.
    where : str
        What the findings call it, such as the name of its file.
    unit : str, optional
        The unit in which the file is taken to be.

    Returns
    -------
    tuple of Finding
        Codes ``extent-implausible``, ``nodes-coincide`` and ``node-mirrored``; empty where nothing looks wrong.

    Examples
    --------
    >>> import numpy as np
    >>> plate = Geometry(np.arange(1, 4), np.array([[0.0, 0, 0], [900, 0, 0], [900, 500, 0]]))
    >>> [one.code for one in findings(plate, "plate.csv")]
    ['extent-implausible']
    """
    if len(geometry.nodes) < 2:
        return ()
    return (*_extent(geometry, where, unit), *_coincident(geometry, where), *_mirrored(geometry, where))


def _extent(geometry: Geometry, where: str, unit: str) -> tuple[Finding, ...]:
    extent = float(np.ptp(geometry.xyz, axis=0).max())
    if SMALLEST <= extent <= LARGEST:
        return ()
    other = "mm" if extent > LARGEST else "m"
    message = f"the points extend over {extent:.4g} m when read in {unit}; were they written in {other}?"
    advice = f'State unit = "{other}" in [geometry], or keep {unit} if the structure is that size.'
    limit = LARGEST if extent > LARGEST else SMALLEST
    return (Finding("warning", "extent-implausible", where, message, extent, limit, advice),)


def _coincident(geometry: Geometry, where: str) -> tuple[Finding, ...]:
    extent = float(np.ptp(geometry.xyz, axis=0).max()) or 1.0
    rounded = np.round(geometry.xyz / (_SAME * extent))
    _, first, counts = np.unique(rounded, axis=0, return_index=True, return_counts=True)
    if not (counts > 1).any():
        return ()
    doubled_row = first[counts > 1][0]
    same = geometry.nodes[(rounded == rounded[doubled_row]).all(axis=1)]
    nodes = " and ".join(str(int(node)) for node in same[:3])
    message = f"{int((counts - 1).sum())} nodes lie where another one does, first {nodes}."
    doubled = float((counts - 1).sum())
    return (Finding("warning", "nodes-coincide", where, message, doubled, 0.0, "Correct their positions."),)


def _mirrored(geometry: Geometry, where: str) -> tuple[Finding, ...]:
    """Few points on the other side of a coordinate plane, whose mirror images are free and in line with the others."""
    mirrored = []
    extent = float(np.ptp(geometry.xyz, axis=0).max())
    for axis, name in enumerate("xyz"):
        values = geometry.xyz[:, axis]
        for side in (1, -1):
            wrong = np.flatnonzero(side * values < -_SAME * extent)
            right = np.flatnonzero(side * values >= -_SAME * extent)
            if not 0 < len(wrong) <= ALONE * len(values) or not (side * values[right] > _SAME * extent).any():
                continue
            known = {round(float(abs(value)) / (1e-4 * extent)) for value in values[right]}
            taken = {tuple(np.round(row / (1e-4 * extent))) for row in geometry.xyz[right]}
            for place in wrong:
                image = geometry.xyz[place].copy()
                image[axis] *= -1
                if (
                    tuple(np.round(image / (1e-4 * extent))) not in taken
                    and round(float(abs(values[place])) / (1e-4 * extent)) in known
                ):
                    mirrored.append((int(geometry.nodes[place]), name, float(values[place])))
    if not mirrored:
        return ()
    listed = ", ".join(f"node {node} ({name} = {value:g} m)" for node, name, value in mirrored[:5])
    message = f"{listed}: alone on that side, and the mirrored position is free."
    advice = "Check the sign of the coordinate."
    return (Finding("warning", "node-mirrored", where, message, float(len(mirrored)), 0.0, advice),)
