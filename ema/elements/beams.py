"""Bernoulli beams: axial and bending motion of a straight beam in the x-z plane."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Matrices
from ema.dof import Dof
from ema.errors import InputError


def element(
    length: float, width: float, height: float, youngs_modulus: float, density: float
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"]]:
    """Consistent mass and stiffness of a Bernoulli element with u, w, phi = dw/dx at both ends, all in SI."""
    area, inertia = width * height, width * height**3 / 12
    mass, stiffness = np.zeros((6, 6)), np.zeros((6, 6))
    axial, bending = np.array([0, 3]), np.array([1, 2, 4, 5])
    ell = length
    stiffness[np.ix_(axial, axial)] = youngs_modulus * area / ell * np.array([[1, -1], [-1, 1]])
    mass[np.ix_(axial, axial)] = density * area * ell / 6 * np.array([[2, 1], [1, 2]])
    stiffness[np.ix_(bending, bending)] = (
        youngs_modulus
        * inertia
        / ell**3
        * np.array(
            [
                [12, 6 * ell, -12, 6 * ell],
                [6 * ell, 4 * ell**2, -6 * ell, 2 * ell**2],
                [-12, -6 * ell, 12, -6 * ell],
                [6 * ell, 2 * ell**2, -6 * ell, 4 * ell**2],
            ]
        )
    )
    mass[np.ix_(bending, bending)] = (
        density
        * area
        * ell
        / 420
        * np.array(
            [
                [156, 22 * ell, 54, -13 * ell],
                [22 * ell, 4 * ell**2, 13 * ell, -3 * ell**2],
                [54, 13 * ell, 156, -22 * ell],
                [-13 * ell, -3 * ell**2, -22 * ell, 4 * ell**2],
            ]
        )
    )
    return mass, stiffness


def square_zeros(size: int, where: str) -> Float[np.ndarray, "n n"]:
    """Room for a matrix.

    Raises
    ------
    InputError : there is not so much memory.
    """
    try:
        return np.zeros((size, size))
    except (MemoryError, ValueError) as error:
        raise InputError(
            "the matrices do not fit the memory",
            where=where,
            got=f"{size} DOFs",
            expected="a few thousand",
            advice="take fewer elements",
        ) from error


@dataclass(frozen=True)
class Section:
    """A uniform stretch of a beam: ``length``, ``width``, ``height`` m, Pa, kg/m^3, and its number of elements."""

    length: float
    width: float
    height: float
    youngs_modulus: float = 210e9
    density: float = 7850.0
    elements: int = 20


def stepped_beam(sections: Sequence[Section], clamped: tuple[bool, bool] = (True, False), part: str = "") -> Matrices:
    """A straight Bernoulli beam along +X made of sections whose middle layers are in line, nodes 0, 1, ...

    The rotation is phi = dw/dx, which is ``-RY`` in a right-handed frame.

    Parameters
    ----------
    clamped : whether node 0 and the last node are fixed; their DOFs are left out.
    part : name of the part that the DOFs carry.

    Raises
    ------
    InputError : a dimension or material constant is not positive, or there is no element.
    """
    where = f"beam {part}".strip()
    for section in sections:
        for name in ("length", "width", "height", "youngs_modulus", "density"):
            value = getattr(section, name)
            if not value > 0 or not np.isfinite(value):
                raise InputError(
                    "not a positive number",
                    where=where,
                    got=f"{name} = {value}",
                    expected="above 0",
                    advice="lengths in m, E in Pa, density in kg/m^3",
                )
    numbers = [section.elements for section in sections]
    if not sections or min(numbers) < 1 or any(number != int(number) for number in numbers):
        raise InputError(
            "a beam needs elements",
            where=where,
            got=", ".join(map(str, numbers)) or "no sections",
            expected="1 or more, a whole number",
        )
    count = int(sum(numbers))
    size, first = 3 * (count + 1), 0
    mass, stiffness = square_zeros(size, where), square_zeros(size, where)
    for one in sections:
        blocks = element(one.length / one.elements, one.width, one.height, one.youngs_modulus, one.density)
        for _ in range(int(one.elements)):
            rows = slice(first, first + 6)
            mass[rows, rows] += blocks[0]
            stiffness[rows, rows] += blocks[1]
            first += 3
    dofs = [Dof(node, direction, part) for node in range(count + 1) for direction in ("+X", "+Z", "-RY")]
    keep = slice(3 if clamped[0] else 0, size - 3 if clamped[1] else size)
    return Matrices(mass[keep, keep], stiffness[keep, keep], tuple(dofs[keep]))


def beam(
    length: float,
    width: float,
    height: float,
    youngs_modulus: float = 210e9,
    density: float = 7850.0,
    elements: int = 20,
    clamped: tuple[bool, bool] = (True, False),
    part: str = "",
) -> Matrices:
    """A straight uniform Bernoulli beam along +X, nodes 0 ... ``elements``; see :func:`stepped_beam`.

    Parameters
    ----------
    length, width, height : m.
    youngs_modulus, density : Pa, kg/m^3.
    """
    return stepped_beam([Section(length, width, height, youngs_modulus, density, elements)], clamped, part)
