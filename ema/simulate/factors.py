"""Triangular factors of a matrix that serve for the matrices that follow it, as they differ from it by little.

From one Newton step to the next few contacts change from sticking to slipping. GMRES with the factors of an earlier
step as preconditioner (Saad and Schultz 1986) then takes a few products instead of a new elimination.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

_LARGE, _MOST_TURNS = 400, 30
"""Unknowns from which on factors are kept: below, an elimination takes less than a few products from Python. Turns of
GMRES after which new ones are made: that many solutions cost about half an elimination of 2500 unknowns."""


@dataclass
class Factors:
    """The factors that were made last, and of which unknowns."""

    unknowns: tuple[int, ...] = ()
    triangles: Any = field(default=None, repr=False)

    def solve(
        self,
        unknowns: tuple[int, ...],
        product: Callable[[np.ndarray], np.ndarray],
        matrix: Callable[[], np.ndarray],
        right: Float[np.ndarray, "unknown"],
        forcing: float,
    ) -> Float[np.ndarray, "unknown"]:
        """Solve ``product(x) = right`` to the share ``forcing`` of the right side, or exactly by ``matrix``.

        ``unknowns`` says which they are: factors serve for the same ones only.
        """
        if len(right) < _LARGE:
            return np.asarray(np.linalg.solve(matrix(), right))
        from scipy.linalg import lu_factor, lu_solve

        if unknowns == self.unknowns:
            close = _gmres(product, lambda vector: lu_solve(self.triangles, vector, check_finite=False), right, forcing)
            if close is not None:
                return close
        self.unknowns, self.triangles = unknowns, lu_factor(matrix(), overwrite_a=True, check_finite=False)
        return np.asarray(lu_solve(self.triangles, right, check_finite=False))


def _gmres(
    product: Callable[[np.ndarray], np.ndarray],
    inverse: Callable[[np.ndarray], np.ndarray],
    right: Float[np.ndarray, "unknown"],
    forcing: float,
) -> Float[np.ndarray, "unknown"] | None:
    """Solution by GMRES, preconditioned from the right; ``None``: it takes too many turns."""
    size = float(np.linalg.norm(right))
    turned, solved = [right / size], []
    table = np.zeros((_MOST_TURNS + 1, _MOST_TURNS))
    target = np.zeros(_MOST_TURNS + 1)
    target[0] = size
    for n in range(_MOST_TURNS):
        solved.append(inverse(turned[n]))
        new = product(solved[n])
        for m, known in enumerate(turned):
            table[m, n] = new @ known
            new = new - table[m, n] * known
        table[n + 1, n] = np.linalg.norm(new)
        square = table[: n + 2, : n + 1]
        weights = np.linalg.lstsq(square, target[: n + 2], rcond=None)[0]
        if np.linalg.norm(target[: n + 2] - square @ weights) <= forcing * size:
            return np.asarray(weights @ np.array(solved))
        if not table[n + 1, n] > 0.0:
            return None
        turned.append(new / table[n + 1, n])
    return None
