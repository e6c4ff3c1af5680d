"""How well a mode is told from noise and from its neighbours, by linearisation at the optimum."""

import numpy as np
import scipy.linalg
from jaxtyping import Float

from ema.fit import likelihood
from ema.fit.likelihood import ModalFit, Observations


def inverse_information(fit: ModalFit, factor: float) -> Float[np.ndarray, "unknown unknown"]:
    """Covariance of the nonlinear unknowns."""
    scale = 1 / np.sqrt(np.maximum(np.diag(fit.information), 1e-300))
    scaled = fit.information * np.outer(scale, scale)
    try:
        inverse = scipy.linalg.inv(scaled + 1e-13 * np.eye(len(scaled)), check_finite=False)
    except scipy.linalg.LinAlgError:
        inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
    result: np.ndarray = factor * inverse * np.outer(scale, scale)
    return result


def shape_scatter(data: Observations, fit: ModalFit, factor: float, outputs: int) -> Float[np.ndarray, "mode"]:
    """Variance of each shape over its energy, without what only rescales or turns it.

    The MAC of the shape with the true one is expected near ``1 / (1 + scatter)``. Noise reaches the shapes directly
    (``outputs`` of them, before any rotation) and through the errors of all poles and participations.
    """
    modes = len(fit.poles)
    if not modes:
        return np.zeros(0)
    owner = np.array([*range(modes), *(mode for mode, _ in fit.free)], int)
    projector, direct = _projector(data, fit)
    shapes = fit.coefficients[: 2 * modes].reshape(modes, 2, -1)
    x, y = shapes[:, 0], shapes[:, 1]
    turned = np.stack([np.stack([x, y], 1), np.stack([-y, x], 1)], 1).reshape(4 * modes, -1)
    products = (turned @ turned.T).reshape(modes, 2, 2, modes, 2, 2)
    count = len(owner)
    covariance = inverse_information(fit, factor).reshape(count, 2, count, 2)
    spread = np.einsum("apcbqd,apbq->acbd", products[owner][:, :, :, owner], covariance, optimize=True)
    spread = spread.reshape(2 * count, 2 * count)
    energy = np.maximum(np.einsum("mao,mao->m", shapes, shapes), 1e-300)
    result = np.empty(modes)
    for mode in range(modes):
        rows = slice(2 * mode, 2 * mode + 2)
        through = projector[rows]
        # Component along the shape itself: what rescales and turns it.
        along = np.einsum("pdkqc,dkc->pkq", products[mode][:, :, owner], through.reshape(2, count, 2)).reshape(2, -1)
        indirect = np.einsum("ij,jk,ik->", through, spread, through, optimize=True)
        indirect -= (
            np.einsum("pi,ij,pj->", along, covariance.reshape(2 * count, -1), along, optimize=True) / energy[mode]
        )
        result[mode] = (max(indirect, 0.0) + factor * np.trace(direct[rows, rows]) * (outputs - 1)) / energy[mode]
    return result


def _projector(
    data: Observations, fit: ModalFit
) -> tuple[Float[np.ndarray, "column unknown"], Float[np.ndarray, "column column"]]:
    """Change of the linear unknowns with the derivative functions, and the inverse of their Gram matrix."""
    gram, linear = likelihood.full_gram(data, fit), len(fit.coefficients)
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    gram = gram * np.outer(scale, scale)
    inverse = scipy.linalg.inv(gram[:linear, :linear] + 1e-12 * np.eye(linear), check_finite=False)
    projector = (inverse @ gram[:linear, linear:]) * np.outer(scale[:linear], 1 / scale[linear:])
    return projector, inverse * np.outer(scale[:linear], scale[:linear])
