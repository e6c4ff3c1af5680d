"""Leading directions of the rows of a matrix that is larger than memory, from two passes over it.

The rows (outputs) come in slabs. A random matrix W of columns is multiplied by the Gram matrix, ``G = A^H A``: a slab
adds ``A_s^H (A_s W)``, so that one pass is a whole step of block power iteration. With V an orthonormal basis of that,
the second pass collects ``Z = A V``, whose range is that of ``A A^H A W``, and ``T = A^H Z``; with ``Z = U S X^H`` the
compressed rows ``U^H A = S^-1 X^H T^H`` follow without a third one (Halko, Martinsson and Tropp 2011, algorithm 4.4
with one power iteration, arranged by rows). What is left out is stated as it is, ``|A|^2 - |U^H A|^2``.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Shaped

DIRECTIONS = 256
"""Rows up to which the matrix is decomposed as it is, and directions that are looked for at first where it has more.

Directions cost memory and time in proportion; of a structure with complex shapes each mode needs two.
"""
_ROUNDED = 1e-6
"""Singular value over the largest below which a direction is left out: products of columns hold it to 1e-4 (its square
over the rounding of doubles), and less beyond."""


@dataclass(frozen=True)
class Range:
    """Leading directions of the rows of a matrix.

    ``directions`` (row, k) are orthonormal, ``compressed`` (k, column) the matrix along them; ``energies`` (k,) fall.
    ``left_out`` is the energy beside them; ``exhausted`` says that a search for more would find the same.
    """

    directions: Shaped[np.ndarray, "row k"]
    compressed: Shaped[np.ndarray, "k column"]
    energies: Float[np.ndarray, "k"]
    left_out: float
    exhausted: bool = False

    @property
    def others(self) -> int:
        """Directions that what was left out is spread over: a matrix has as many as rows or columns, what is fewer."""
        return int(min(len(self.directions), self.compressed.shape[1]) - len(self.energies))

    @property
    def floor(self) -> float:
        """Energy of a direction of noise: the mean of what was left out, or the median where nothing was."""
        return self.left_out / self.others if self.others else float(np.median(self.energies))

    def above(self, margin: float) -> int:
        """Directions whose energy exceeds the floor, widened by the edge of a noise matrix of this size (Marchenko and
        Pastur 1967), by a ``margin``.
        """
        few, many = sorted((len(self.directions), self.compressed.shape[1]))
        edge = self.floor * (1 + np.sqrt(few / many)) ** 2
        return int(np.count_nonzero(self.energies > margin * edge))

    def leading(self, count: int) -> "Range":
        """The first directions alone."""
        left = self.left_out + float(np.sum(self.energies[count:]))
        return Range(self.directions[:, :count], self.compressed[:count], self.energies[:count], left, self.exhausted)


def range_finder(slabs: Callable[[], Iterable[np.ndarray]], rows: int, rank: int = DIRECTIONS) -> Range:
    """Leading directions of the rows of a matrix.

    Parameters
    ----------
    slabs : the matrix in slabs of rows, in order, real or complex; called once for each pass.
    rows : number of rows.
    rank : directions; with as many rows or fewer the decomposition is exact and takes one pass.

    Notes
    -----
    The random numbers are always the same, so that the same data give the same result.
    """
    if rows <= rank:
        return _exact(np.concatenate(list(slabs())))
    first, energy, start = None, 0.0, np.zeros((0, 0))
    for slab in slabs():
        if first is None:
            start = np.random.default_rng(0).standard_normal((slab.shape[1], min(rank, slab.shape[1])))
            first = np.zeros(start.shape, slab.dtype)
        first += slab.conj().T @ (slab @ start)
        energy += float(np.vdot(slab, slab).real)
    assert first is not None
    basis = np.linalg.qr(first)[0]
    along, products, done = np.zeros((rows, basis.shape[1]), basis.dtype), np.zeros_like(basis), 0
    for slab in slabs():
        own = slab @ basis
        along[done : done + len(slab)] = own
        products += slab.conj().T @ own
        done += len(slab)
    directions, strength, right = np.linalg.svd(along, full_matrices=False)
    kept = strength > _ROUNDED * max(float(strength[0]), np.finfo(float).tiny)
    compressed = (right[kept] @ products.conj().T) / strength[kept, None]
    return _sorted(directions[:, kept], compressed, energy, rank >= compressed.shape[1])


def growing(
    slabs: Callable[[], Iterable[np.ndarray]], rows: int, rank: int, above: Callable[[Range], int]
) -> tuple[Range, int]:
    """Leading directions, twice as many as long as all of them are ``above`` noise, and how many are.

    It ends where the matrix has no further directions: one of 365 rows and 66 columns has 66.
    """
    while True:
        found = range_finder(slabs, rows, rank)
        count = above(found)
        if count < len(found.energies) or found.exhausted:
            return found, count
        rank *= 2


def _exact(matrix: Shaped[np.ndarray, "row column"]) -> Range:
    """All directions of a matrix that has few rows."""
    count = min(matrix.shape)
    energies, directions = np.linalg.eigh(matrix @ matrix.conj().T)
    directions, energies = directions[:, ::-1][:, :count], np.maximum(energies[::-1][:count], 0)
    return Range(directions, directions.conj().T @ matrix, energies, 0.0, exhausted=True)


def _sorted(
    directions: Shaped[np.ndarray, "row k"], compressed: Shaped[np.ndarray, "k column"], energy: float, exhausted: bool
) -> Range:
    """The same directions, turned so that what lies along one of them has nothing in common with the others."""
    own, turn = np.linalg.eigh(compressed @ compressed.conj().T)
    turn, own = turn[:, ::-1], np.maximum(own[::-1], 0)
    left = max(energy - float(np.sum(own)), 0.0)
    return Range(directions @ turn, turn.conj().T @ compressed, own, left, exhausted)
