"""Bernoulli beams: axial and bending motion of a straight beam in the x-z plane."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Matrices
from ema.deprecation import fields_as_arguments
from ema.dof import Dof
from ema.errors import InputError


def element(
    length: float, width: float, height: float, youngs_modulus: float, density: float
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"]]:
    """Return the consistent mass and stiffness matrix of a Bernoulli beam element.

    The DOFs are u, w and phi = dw/dx at the first node, then at the second.

    Parameters
    ----------
    length, width, height : float
        Dimensions [m].
    youngs_modulus : float
        Young's modulus [Pa].
    density : float
        Density [kg/m^3].

    Returns
    -------
    tuple of (array of shape (6, 6), array of shape (6, 6))
        Mass and stiffness matrix in SI.

    References
    ----------
    .. [1] Przemieniecki (1968), Theory of Matrix Structural Analysis, chapters 5 and 11.

    Examples
    --------
    >>> mass, stiffness = element(0.1, 0.02, 0.005, 210e9, 7850.0)
    >>> rigid = np.array([0, 1, 0, 0, 1, 0])  # translation across
    >>> round(float(rigid @ mass @ rigid), 6), float(abs(stiffness @ rigid).max())
    (0.0785, 0.0)
    """
    area, inertia = width * height, width * height**3 / 12
    mass, stiffness = np.zeros((6, 6)), np.zeros((6, 6))
    axial, bending = np.array([0, 3]), np.array([1, 2, 4, 5])
    ell = length
    # linear u and cubic (Hermite) w between the nodes: EA u'^2 and EI w''^2, rho A u^2 and rho A w^2, integrated
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
    """A uniform stretch of a beam.

    Parameters
    ----------
    length, width, height : float
        Dimensions [m].
    youngs_modulus : float, default 210000000000.0
        Young's modulus [Pa].
    density : float, default 7850.0
        Density [kg/m^3].
    elements : int, default 20
        Number of elements.

    Examples
    --------
    >>> Section(length=0.5, width=0.04, height=0.005).elements
    20
    """

    length: float
    width: float
    height: float
    youngs_modulus: float = 210e9
    density: float = 7850.0
    elements: int = 20


def stepped_beam(sections: Sequence[Section], clamped: tuple[bool, bool] = (True, False), part: str = "") -> Matrices:
    """Return the matrices of a straight Bernoulli beam along +X made of sections whose middle layers are in line.

    The nodes are 0, 1, ...; the rotation is phi = dw/dx, which is ``-RY`` in a right-handed frame.

    Parameters
    ----------
    sections : sequence of Section
        Stretches of the beam, from node 0 on.
    clamped : tuple of (bool, bool), default (True, False)
        Whether node 0 and the last node are fixed; their DOFs are left out.
    part : str, optional
        Name of the part that the DOFs carry.

    Returns
    -------
    Matrices
        Mass and stiffness matrix with the DOFs ``+X``, ``+Z`` and ``-RY`` of every node.

    Raises
    ------
    InputError
        If a dimension or material constant is not positive, there is no element, or the matrices do not fit the memory.

    Examples
    --------
    >>> thick, thin = Section(0.2, 0.04, 0.01, elements=4), Section(0.3, 0.04, 0.005, elements=6)
    >>> stepped_beam([thick, thin]).mass.shape
    (30, 30)
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


@fields_as_arguments("section", Section)
def beam(section: Section, clamped: tuple[bool, bool] = (True, False), part: str = "") -> Matrices:
    """Return the matrices of a straight uniform Bernoulli beam along +X, nodes 0 ... ``section.elements``.

    Parameters
    ----------
    section : Section
        The beam.
    clamped : tuple of (bool, bool), default (True, False)
        Whether node 0 and the last node are fixed; their DOFs are left out.
    part : str, optional
        Name of the part that the DOFs carry.

    Returns
    -------
    Matrices
        Mass and stiffness matrix with the DOFs ``+X``, ``+Z`` and ``-RY`` of every node.

    Raises
    ------
    InputError
        As :func:`stepped_beam`.

    Examples
    --------
    >>> from scipy.linalg import eigh
    >>> matrices = beam(Section(0.5, 0.04, 0.005))
    >>> omega = np.sqrt(eigh(matrices.stiffness, matrices.mass, eigvals_only=True)[0])
    >>> exact = 1.8751**2 * np.sqrt(210e9 * 0.005**2 / 12 / 7850.0) / 0.5**2  # clamped-free, first bending mode
    >>> round(float(omega / exact), 4)
    1.0
    """
    return stepped_beam([section], clamped, part)
