"""What the modes of a structure above those known give way at the joints: their static flexibility.

Without it a structure is too stiff where a beam presses and pulls on it, and every frequency with the beam is predicted
too high, by up to some tenths of a percent where the joints stick.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from ema.data import ModalModel
from ema.dof import match
from ema.shapes import Surface, rigid_rows

_NEAR = math.sqrt(3.0)
"""Frequency of the modes that stand for the flexibility, over that where the unknown modes begin. With as many modes in
any band, their receptance is to that at rest as artanh(z)/z = 1 + z^2/3 + ... at z times this frequency."""
_RESOLVED = 0.5
"""Share of the modes of a Ritz basis, the lowest, that are those of the structure; the others are too stiff."""


class Flexibility(NamedTuple):
    """Flexibility of the unknown modes at some points, m/N and rad/(N m), and the rad/s of modes that stand for it."""

    deflection: Float[np.ndarray, "point"]
    slope: Float[np.ndarray, "point"]
    frequency: float


class _Known(NamedTuple):
    """Rows of the elastic modes that are known, by frequency, of those that continue them badly; rigid-body modes."""

    modes: np.ndarray
    others: np.ndarray
    rigid: int
    measured: bool


def flexibility(
    bare: ModalModel, surface: Surface, points: Float[np.ndarray, "point 2"], angle: float, length: float
) -> Flexibility | None:
    """Estimate it at points of the surface, turning about the normal to ``angle``; None where nothing lies above.

    The sums of phi_r^2 / omega_r^2 and phi'_r^2 / omega_r^2 over the unknown modes are taken for those of a plate
    (Cremer, Heckl, Petersson 2005, Structure-Borne Sound, ch. 5): the number of modes up to omega is
    a omega + b sqrt(omega), area and edges, fitted to the known modes; phi^2 is on the average as large as in these,
    and phi'^2 grows with omega, up to where half a bending wave is as long as the contact, ``length`` in m.

    Upper residual terms at driving points hold the same sum of phi_r^2 / omega_r^2 as measured: the estimate is scaled
    to it. A model without residual terms has no modes above its own, unless the modes of a plate continue the measured
    ones (``ema.shapes.with_plate``), those that its polynomials resolve are known modes, and what the others give way
    is taken off.
    """
    known = _known(bare, surface)
    if len(known.modes) < 2 or (known.measured and bare.residuals is None):
        return None
    omega = np.abs(bare.poles[known.modes])
    counted = known.rigid + np.arange(len(omega)) + 0.5
    (area, edge), _ = nnls(np.column_stack([omega, np.sqrt(omega)]), counted)
    begins = omega[-1] + 0.5 / (area + 0.5 * edge / np.sqrt(omega[-1]))
    over_squares = area / begins + edge / (3 * begins**1.5)
    shapes, slopes = surface.values(points), surface.values(points, 1, angle)
    square = np.mean(shapes[:, known.modes] ** 2, axis=1)
    bent = np.sum(slopes[:, known.modes] ** 2, axis=1) / np.sum(omega)
    if not bent.any():
        return None
    # waves of any direction: k^2 = 2 phi'^2/phi^2, which is 2 bent/square omega
    ends = (np.pi / length) ** 2 * np.mean(square) / (2 * np.mean(bent))
    over_first = 0.0
    if ends > begins:
        over_first = area * math.log(ends / begins) + edge * (begins**-0.5 - ends**-0.5)
    share = _measured_share(bare, known.modes, begins, over_squares) if known.measured else 1.0
    rest = np.abs(bare.poles[known.others])
    deflection = share * square * over_squares - np.sum((shapes[:, known.others] / rest) ** 2, axis=1)
    slope = share * bent * over_first - np.sum((slopes[:, known.others] / rest) ** 2, axis=1)
    if max(deflection.max(), slope.max()) <= 0:
        return None
    return Flexibility(np.maximum(deflection, 0.0), np.maximum(slope, 0.0), float(_NEAR * begins))


def flexibility_std(bare: ModalModel, surface: Surface) -> float:
    """Standard deviation of the logarithm of the true flexibility at a point over its estimate.

    The mean of K squares of normal numbers has a relative variance of 2/K. A sum of such squares with weights v has
    2 sum v^2/(sum v)^2: with v = omega^-2 and as many unknown modes in any band as known ones 2/(3 K). Together they
    are 8/(3 K).
    """
    return math.sqrt(8 / (3 * max(len(_known(bare, surface).modes), 1)))


def _known(bare: ModalModel, surface: Surface) -> _Known:
    """The elastic modes, measured or continued by those of a plate, which have no shape at the measured DOFs."""
    rigid = rigid_rows(bare, surface)
    elastic = np.setdiff1d(np.arange(len(bare.poles)), rigid)
    elastic = elastic[np.argsort(np.abs(bare.poles[elastic]))]
    measured = bare.shapes[:, elastic].any(axis=0)
    count = len(elastic)
    if not measured.all():
        count = max(int(np.sum(measured)), int(_RESOLVED * len(bare.poles)) - len(rigid))
    return _Known(elastic[:count], elastic[count:], len(rigid), bool(measured.all()))


def _measured_share(bare: ModalModel, elastic: np.ndarray, begins: float, over_squares: float) -> float:
    """Flexibility at the driving points by the residual terms, over the estimate there."""
    residuals = bare.residuals
    assert residuals is not None
    driving = match(bare.inputs, bare.dofs)
    if not driving:
        return 1.0
    above = np.abs(residuals.poles) > 0.5 * (begins + np.abs(bare.poles[elastic[-1]]))
    measured, estimated = 0.0, 0.0
    for column, row, sign in driving:
        flexibility = residuals.upper[row, column].real
        if residuals.residues is not None:
            # a residue R and its conjugate at rest: -2 Re(R/p)
            flexibility -= 2 * float(np.sum(np.real(residuals.residues[above, row, column] / residuals.poles[above])))
        measured += sign * flexibility
        estimated += float(np.mean(np.abs(bare.shapes[row, elastic]) ** 2)) * over_squares
    return max(measured / estimated, 0.0) if estimated > 0 else 1.0
