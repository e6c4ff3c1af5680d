"""Mode indicator functions: peaks (or dips) at natural frequencies, before any model is fitted."""

import numpy as np
from jaxtyping import Float

from ema.data import FrfSet


def cmif(frfs: FrfSet) -> Float[np.ndarray, "freq value"]:
    """Complex mode indicator function: squared singular values of the FRF matrix of each line, largest first.

    References
    ----------
    Shih, Tsuei, Allemang, Brown, Complex mode indication function and its applications, 1988.
    """
    return np.linalg.svd(np.asarray(frfs.values), compute_uv=False) ** 2


def mode_indicator(frfs: FrfSet) -> Float[np.ndarray, "freq"]:
    """Ordinary mode indicator function of receptance or accelerance: near 0 at a normal mode, near 1 elsewhere.

    The share of the in-phase part (imaginary, for mobility) in the response, averaged over all FRFs.
    """
    values = np.asarray(frfs.values)
    in_phase = values.imag if frfs.quantity == "mobility" else values.real
    size = np.abs(values)
    total = np.sum(size**2, axis=(1, 2))
    return np.sum(np.abs(in_phase) * size, axis=(1, 2)) / np.where(total > 0, total, 1)


def multivariate_mode_indicator(frfs: FrfSet) -> Float[np.ndarray, "freq in"]:
    """Multivariate mode indicator function: eigenvalues of the in-phase share over force patterns, smallest first.

    Dips of the first value show natural frequencies, of the second repeated ones (Williams, Crowley, Vold 1985). The
    shorter side of the FRF matrix serves as inputs.
    """
    values = np.asarray(frfs.values)
    if values.shape[1] < values.shape[2]:
        values = values.transpose(0, 2, 1)
    real, imaginary = (values.imag, values.real) if frfs.quantity == "mobility" else (values.real, values.imag)
    in_phase = np.einsum("koi,koj->kij", real, real)
    total = in_phase + np.einsum("koi,koj->kij", imaginary, imaginary)
    size = np.trace(total, axis1=1, axis2=2)
    total = total + (1e-12 * np.where(size > 0, size, 1))[:, None, None] * np.eye(total.shape[1])
    return np.sort(np.linalg.eigvals(np.linalg.solve(total, in_phase)).real, axis=1)
