"""Small finite elements of the bench: Kirchhoff plate with 12 degrees of freedom, Timoshenko beam. No code of ``ema``."""

from dataclasses import dataclass

import numpy as np

POWERS = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3), (3, 1), (1, 3)])
"""Monomials x^i y^j of the plate element (Adini and Clough 1961; Melosh 1963)."""


def monomials(x: np.ndarray, y: np.ndarray, along: int = 0, across: int = 0) -> np.ndarray:
    """Derivatives of the monomials at points, shape (point, 12)."""
    result = np.ones((len(x), len(POWERS)))
    for values, powers, order in ((x, POWERS[:, 0], along), (y, POWERS[:, 1], across)):
        factor = np.ones(len(POWERS))
        for step in range(order):
            factor *= powers - step
        result *= factor * values[:, None] ** np.maximum(powers - order, 0)
    return result


@dataclass(frozen=True)
class Plate:
    """A rectangular orthotropic plate: ``size`` m, ``cells``, kg/m^2, bending stiffnesses D11, D22, D12, D66 in N m."""

    size: tuple[float, float]
    cells: tuple[int, int]
    per_area: float
    stiffness: tuple[float, float, float, float]

    def nodes(self) -> np.ndarray:
        """Coordinates (node, 2) in m."""
        x, y = (np.linspace(0, length, cells + 1) for length, cells in zip(self.size, self.cells))
        return np.stack([part.ravel() for part in np.meshgrid(x, y, indexing="ij")], axis=1)

    @property
    def cell(self) -> tuple[float, float]:
        """Sides of an element in m."""
        return self.size[0] / self.cells[0], self.size[1] / self.cells[1]

    def interpolation(self) -> np.ndarray:
        """Coefficients of the monomials from (w, w_x, w_y) at the four corners."""
        a, b = self.cell
        x, y = np.array([0, a, a, 0]), np.array([0, 0, b, b])
        rows = np.stack([monomials(x, y), monomials(x, y, 1), monomials(x, y, 0, 1)], axis=1).reshape(12, 12)
        return np.linalg.inv(rows)

    def unknowns(self, column: int, row: int) -> np.ndarray:
        """Unknowns of an element."""
        count = self.cells[1] + 1
        corners = [column * count + row, (column + 1) * count + row, (column + 1) * count + row + 1]
        corners.append(column * count + row + 1)
        return np.concatenate([3 * node + np.arange(3) for node in corners])

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Consistent mass and stiffness."""
        a, b = self.cell
        inverse = self.interpolation()
        at, weights = np.polynomial.legendre.leggauss(4)
        x, y = (part.ravel() for part in np.meshgrid(0.5 * a * (at + 1), 0.5 * b * (at + 1), indexing="ij"))
        area = np.outer(weights, weights).ravel() * a * b / 4
        d11, d22, d12, d66 = self.stiffness
        law = np.array([[d11, d12, 0], [d12, d22, 0], [0, 0, d66]])
        bent = np.stack([monomials(x, y, 2), monomials(x, y, 0, 2), 2 * monomials(x, y, 1, 1)], axis=1) @ inverse
        moved = monomials(x, y) @ inverse
        stiffness = np.einsum("p,pia,ij,pjb->ab", area, bent, law, bent)
        mass = self.per_area * np.einsum("p,pa,pb->ab", area, moved, moved)
        size = 3 * (self.cells[0] + 1) * (self.cells[1] + 1)
        total_mass, total_stiffness = np.zeros((size, size)), np.zeros((size, size))
        for column in range(self.cells[0]):
            for row in range(self.cells[1]):
                rows = np.ix_(*[self.unknowns(column, row)] * 2)
                total_mass[rows] += mass
                total_stiffness[rows] += stiffness
        return total_mass, total_stiffness

    def rows(self, points: np.ndarray, along: int = 0, across: int = 0) -> np.ndarray:
        """What the unknowns are multiplied with to get a derivative of the deflection at points (point, 2) in m."""
        inverse, sides = self.interpolation(), np.array(self.cell)
        result = np.zeros((len(points), 3 * (self.cells[0] + 1) * (self.cells[1] + 1)))
        for number, point in enumerate(points):
            column, row = np.clip((point / sides).astype(int), 0, np.array(self.cells) - 1)
            local = point - np.array([column, row]) * sides
            values = monomials(local[:1], local[1:], along, across) @ inverse
            result[number, self.unknowns(column, row)] = values[0]
        return result


@dataclass(frozen=True)
class Bar:
    """A straight beam of rectangular section, free: ``spacing`` m between its joints, ``overhang`` beyond either."""

    spacing: float
    overhang: float
    width: float
    height: float
    elements: int = 12
    modulus: float = 210e9
    density: float = 7850.0

    @property
    def mass(self) -> float:
        """Kg."""
        return (self.spacing + 2 * self.overhang) * self.width * self.height * self.density

    def matrices(self) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
        """Lumped mass and stiffness of (u, w, section rotation) per node, and the nodes of the two joints.

        Source: Przemieniecki (1968), Theory of Matrix Structural Analysis, section 5.6 (shear deformation).
        """
        part = self.spacing / self.elements
        ends = max(round(self.overhang / part), 1)
        lengths = np.concatenate([np.full(ends, self.overhang / ends), np.full(self.elements, part)])
        lengths = np.concatenate([lengths, np.full(ends, self.overhang / ends)])
        area, inertia = self.width * self.height, self.width * self.height**3 / 12
        shear = self.modulus / 2.6 * area * 5 / 6
        size = 3 * (len(lengths) + 1)
        mass, stiffness = np.zeros(size), np.zeros((size, size))
        for n, length in enumerate(lengths):
            phi = 12 * self.modulus * inertia / (shear * length**2)
            bend = self.modulus * inertia / (length**3 * (1 + phi))
            rows = slice(3 * n, 3 * n + 6)
            block = np.zeros((6, 6))
            block[np.ix_([0, 3], [0, 3])] = self.modulus * area / length * np.array([[1, -1], [-1, 1]])
            near, far = (4 + phi) * length**2, (2 - phi) * length**2
            block[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = bend * np.array(
                [
                    [12, 6 * length, -12, 6 * length],
                    [6 * length, near, -6 * length, far],
                    [-12, -6 * length, 12, -6 * length],
                    [6 * length, far, -6 * length, near],
                ]
            )
            stiffness[rows, rows] += block
            lump = self.density * length / 2 * np.array([area, area, inertia])
            mass[3 * n : 3 * n + 3] += lump
            mass[3 * n + 3 : 3 * n + 6] += lump
        return np.diag(mass), stiffness, (ends, ends + self.elements)
