"""Rectangular Kirchhoff plate elements with nodes in the middle layer: bending (12 DOFs) and membrane (8 DOFs).

Bending: the twelve-term polynomial of Adini, Clough and Melosh; membrane: bilinear plane stress. Two such plates are
paired node to node in both tangential directions, as Gaul, Roseira and Becker (2008) generalise their beams.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Matrices
from ema.deprecation import fields_as_arguments
from ema.dof import Dof
from ema.elements.beams import square_zeros
from ema.errors import InputError

_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 1), (1, 3))
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
_DIRECTIONS = ("+X", "+Y", "+Z", "-RY", "+RX")


def _derivative(x: float, y: float, dx: int, dy: int) -> Float[np.ndarray, "12"]:
    """Derivatives of the twelve polynomial terms at one point."""
    row = np.zeros(12)
    for term, (i, j) in enumerate(_POWERS):
        if i >= dx and j >= dy:
            factor = np.prod(np.arange(i, i - dx, -1)) * np.prod(np.arange(j, j - dy, -1))
            row[term] = factor * x ** (i - dx) * y ** (j - dy)
    return row


def bending(
    a: float, b: float, height: float, youngs_modulus: float, poisson: float, density: float
) -> tuple[Float[np.ndarray, "12 12"], Float[np.ndarray, "12 12"]]:
    """Mass and stiffness of an element a x b (m) for w, dw/dx, dw/dy at its corners."""
    corners = [(a * i, b * j) for i, j in _CORNERS]
    nodal = np.array([_derivative(x, y, *order) for x, y in corners for order in ((0, 0), (1, 0), (0, 1))])
    # w = p(x, y) c with c = nodal^-1 (w, dw/dx, dw/dy at the corners)
    shape = np.linalg.inv(nodal)
    rigidity = youngs_modulus * height**3 / (12 * (1 - poisson**2))
    law = rigidity * np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    mass, stiffness = np.zeros((12, 12)), np.zeros((12, 12))
    points, weights = np.polynomial.legendre.leggauss(4)
    for x, wx in zip((points + 1) * a / 2, weights * a / 2, strict=True):
        for y, wy in zip((points + 1) * b / 2, weights * b / 2, strict=True):
            # (w_xx, w_yy, 2 w_xy): strain energy 1/2 curvature^T D curvature with D of a Kirchhoff plate
            curvature = np.array([_derivative(x, y, 2, 0), _derivative(x, y, 0, 2), 2 * _derivative(x, y, 1, 1)])
            deflection = _derivative(x, y, 0, 0)
            stiffness += wx * wy * curvature.T @ law @ curvature
            mass += wx * wy * density * height * np.outer(deflection, deflection)
    return shape.T @ mass @ shape, shape.T @ stiffness @ shape


def membrane(
    a: float, b: float, height: float, youngs_modulus: float, poisson: float, density: float
) -> tuple[Float[np.ndarray, "8 8"], Float[np.ndarray, "8 8"]]:
    """Mass and stiffness of an element a x b (m) for u, v at its corners."""
    tension = youngs_modulus * height / (1 - poisson**2)
    law = tension * np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    mass, stiffness = np.zeros((8, 8)), np.zeros((8, 8))
    points, weights = np.polynomial.legendre.leggauss(2)
    for s, ws in zip((points + 1) / 2, weights / 2, strict=True):
        for t, wt in zip((points + 1) / 2, weights / 2, strict=True):
            value = np.array([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
            by_x = np.array([-(1 - t), 1 - t, t, -t]) / a
            by_y = np.array([-(1 - s), -s, s, 1 - s]) / b
            strain = np.zeros((3, 8))
            strain[0, ::2], strain[1, 1::2], strain[2, ::2], strain[2, 1::2] = by_x, by_y, by_y, by_x
            field = np.zeros((2, 8))
            field[0, ::2] = field[1, 1::2] = value
            stiffness += ws * wt * a * b * strain.T @ law @ strain
            mass += ws * wt * a * b * density * height * field.T @ field
    return mass, stiffness


@dataclass(frozen=True)
class Plate:
    """A uniform rectangular plate.

    Parameters
    ----------
    length, width, height : float
        Dimensions [m].
    youngs_modulus : float, default 210000000000.0
        Young's modulus [Pa].
    poisson : float, default 0.3
        Poisson's ratio, above -1 and below 0.5.
    density : float, default 7850.0
        Density [kg/m^3].
    elements : tuple of (int, int), default (10, 2)
        Number of elements in x and y.

    Examples
    --------
    >>> Plate(length=0.3, width=0.2, height=0.004).elements
    (10, 2)
    """

    length: float
    width: float
    height: float
    youngs_modulus: float = 210e9
    poisson: float = 0.3
    density: float = 7850.0
    elements: tuple[int, int] = (10, 2)


@fields_as_arguments("plate", Plate)
def plate_matrices(plate: Plate, clamped: bool = True, part: str = "") -> Matrices:
    """Return the matrices of a rectangular Kirchhoff plate along +X and +Y.

    Node ``i * (ny + 1) + j`` is the i-th in x and the j-th in y. Bending and membrane motion are uncoupled: the nodes
    lie in the middle layer.

    Parameters
    ----------
    plate : Plate
        Dimensions, material and elements.
    clamped : bool, default True
        Whether the edge x = 0 is fixed; its DOFs are left out.
    part : str, optional
        Name of the part that the DOFs carry.

    Returns
    -------
    Matrices
        Mass and stiffness matrix with the DOFs ``+X +Y +Z -RY +RX`` of every node.

    Raises
    ------
    InputError
        If a dimension or material constant is not physical, or there is no element.

    Examples
    --------
    >>> free = plate_matrices(Plate(0.3, 0.2, 0.004, elements=(3, 2)), clamped=False)
    >>> across = np.array([dof.direction == "+Z" for dof in free.dofs], dtype=float)
    >>> round(float(across @ free.mass @ across), 6)  # 0.3 x 0.2 x 0.004 m of steel
    1.884
    """
    for name in ("length", "width", "height", "youngs_modulus", "density"):
        value = getattr(plate, name)
        if not value > 0 or not np.isfinite(value):
            raise InputError(
                "not a positive number",
                where=f"plate {part}".strip(),
                got=f"{name} = {value}",
                expected="above 0",
                advice="lengths in m, E in Pa, density in kg/m^3",
            )
    elements = plate.elements
    if not -1 < plate.poisson < 0.5 or min(elements) < 1 or any(number != int(number) for number in elements):
        raise InputError(
            "not a plate",
            where=f"plate {part}".strip(),
            got=f"nu {plate.poisson}, {elements} elements",
            expected="-1 < nu < 0.5, one element or more each way",
        )
    nx, ny = elements
    sizes = (plate.length / nx, plate.width / ny, plate.height)
    properties = (*sizes, plate.youngs_modulus, plate.poisson, plate.density)
    blocks = (bending(*properties), membrane(*properties))
    count = (nx + 1) * (ny + 1)
    mass, stiffness = (square_zeros(5 * count, f"plate {part}".strip()) for _ in range(2))
    for i in range(nx):
        for j in range(ny):
            nodes = [(i + s) * (ny + 1) + j + t for s, t in _CORNERS]
            bent = [5 * node + k for node in nodes for k in (2, 3, 4)]
            flat = [5 * node + k for node in nodes for k in (0, 1)]
            for rows, (m, k) in zip((bent, flat), blocks, strict=True):
                mass[np.ix_(rows, rows)] += m
                stiffness[np.ix_(rows, rows)] += k
    keep = slice(5 * (ny + 1) if clamped else 0, None)
    dofs = [Dof(node, direction, part) for node in range(count) for direction in _DIRECTIONS]
    return Matrices(mass[keep, keep], stiffness[keep, keep], tuple(dofs[keep]))
