"""Free orthotropic plate by the Ritz method: the shapes of the built-in table top."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_DEGREES = 9
"""Legendre polynomials in each direction."""


@dataclass(frozen=True)
class PlateModes:
    """Elastic modes of a free plate: ``natural_frequencies`` Hz and ``coefficients`` (mode, x-degree, y-degree) of
    Legendre products, scaled to unit modal mass."""

    length: float
    width: float
    natural_frequencies: Float[np.ndarray, "mode"]
    coefficients: Float[np.ndarray, "mode nx ny"]

    def shapes(self, x: Float[np.ndarray, "point"], y: Float[np.ndarray, "point"]) -> Float[np.ndarray, "point mode"]:
        """Deflections per unit modal coordinate at points given in m from a corner."""
        along = np.polynomial.legendre.legvander(2 * x / self.length - 1, self.coefficients.shape[1] - 1)
        across = np.polynomial.legendre.legvander(2 * y / self.width - 1, self.coefficients.shape[2] - 1)
        return np.asarray(np.einsum("pi,pj,rij->pr", along, across, self.coefficients))

    def slopes(self, x: Float[np.ndarray, "point"], y: Float[np.ndarray, "point"]) -> Float[np.ndarray, "point mode"]:
        """Slopes d/dx of the deflections, in 1/m per unit modal coordinate."""
        from numpy.polynomial import legendre

        derivative = legendre.legder(np.eye(self.coefficients.shape[1]))
        along = np.polynomial.legendre.legvander(2 * x / self.length - 1, len(derivative) - 1) @ derivative
        across = np.polynomial.legendre.legvander(2 * y / self.width - 1, self.coefficients.shape[2] - 1)
        return np.asarray((2 / self.length) * np.einsum("pi,pj,rij->pr", along, across, self.coefficients))


class BendingStiffness(NamedTuple):
    """Bending stiffness of an orthotropic plate: D_x in N m, D_y / D_x, torsional stiffness relative to that of the
    isotropic plate of the same mean stiffness, and Poisson's ratio."""

    along: float
    ratio: float = 1.0
    twist: float = 1.0
    poisson: float = 0.3


def free_plate(
    length: float,
    width: float,
    mass: float,
    stiffness: BendingStiffness,
    modes: int = 12,
) -> PlateModes:
    """Modes of a free rectangular orthotropic Kirchhoff plate, with 9 x 9 Legendre products (Ritz).

    Parameters
    ----------
    length, width : m; ``mass`` kg.

    Source: Leissa, Vibration of Plates (NASA SP-160, 1969), strain energy of the orthotropic plate.
    """
    from scipy.linalg import eigh

    inner = _products()
    sx, sy = 2 / length, 2 / width
    along, ratio, twist, poisson = stiffness
    mean = np.sqrt(ratio) * along
    area = length * width / 4
    stiffnesses = area * (
        along * sx**4 * np.kron(inner[2, 2], inner[0, 0])
        + ratio * along * sy**4 * np.kron(inner[0, 0], inner[2, 2])
        + poisson * mean * (sx * sy) ** 2 * (np.kron(inner[2, 0], inner[0, 2]) + np.kron(inner[0, 2], inner[2, 0]))
        + 2 * twist * (1 - poisson) * mean * (sx * sy) ** 2 * np.kron(inner[1, 1], inner[1, 1])
    )
    masses = area * mass / (length * width) * np.kron(inner[0, 0], inner[0, 0])
    eigenvalues, vectors = eigh(stiffnesses, masses, subset_by_index=(3, 2 + modes))
    signs = np.where(vectors[np.abs(vectors).argmax(0), np.arange(modes)] < 0, -1, 1)
    coefficients = (signs * vectors).T.reshape(modes, _DEGREES, _DEGREES)
    return PlateModes(length, width, np.sqrt(eigenvalues) / (2 * np.pi), coefficients)


def _products() -> Float[np.ndarray, "3 3 n n"]:
    """Integrals over [-1, 1] of products of Legendre polynomials and their first two derivatives."""
    from numpy.polynomial import legendre

    points, weights = legendre.leggauss(2 * _DEGREES)
    values = []
    for order in range(3):
        derivative = legendre.legder(np.eye(_DEGREES), order)
        values.append(legendre.legvander(points, len(derivative) - 1) @ derivative)
    tables = np.array(values)
    return np.asarray(np.einsum("api,bpj,p->abij", tables, tables, weights))
