"""Triangular factors of a matrix that serve for the matrices that follow it, as they differ from it by little.

From one Newton step to the next few contacts change from sticking to slipping. GMRES with the factors of an earlier
step as preconditioner (Saad and Schultz 1986) then takes a few products instead of a new elimination.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

LARGE, _MOST_TURNS = 400, 30
"""Unknowns from which on factors are worth it: below, an elimination takes less than a few products from Python. Turns
of GMRES after which new ones are made: that many solutions cost about half an elimination of 2500 unknowns."""


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
        from scipy.linalg import lu_factor, lu_solve
        from scipy.sparse.linalg import LinearOperator, gmres

        def inverse(vector: np.ndarray) -> Float[np.ndarray, "unknown"]:
            return np.asarray(lu_solve(self.triangles, vector, check_finite=False))

        if unknowns == self.unknowns:
            ahead = LinearOperator(
                (len(right), len(right)), matvec=lambda vector: product(inverse(vector)), dtype=float
            )
            found, failed = gmres(ahead, right, rtol=forcing, atol=0.0, restart=_MOST_TURNS, maxiter=1)
            if not failed:
                return inverse(found)
        self.unknowns, self.triangles = unknowns, lu_factor(matrix(), overwrite_a=True, check_finite=False)
        return inverse(right)
