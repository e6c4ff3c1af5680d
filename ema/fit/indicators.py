"""Mode indicator functions: peaks (or dips) at natural frequencies, before any model is fitted."""

import numpy as np
from jaxtyping import Float

from ema.data import FrfSet


def cmif(frfs: FrfSet) -> Float[np.ndarray, "freq value"]:
    """Compute the complex mode indicator function: squared singular values of the FRF matrix of each line.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.

    Returns
    -------
    array of shape (freq, value)
        Values, largest first.

    References
    ----------
    .. [1] Shih, Tsuei, Allemang and Brown (1988), Complex mode indication function and its applications to spatial
       domain parameter estimation, Mechanical Systems and Signal Processing 2:367.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set()
    >>> float(frfs.frequencies[np.argmax(cmif(frfs)[:60, 0])])  # the first mode
    40.0
    """
    return np.linalg.svd(np.asarray(frfs.values), compute_uv=False) ** 2


def mode_indicator(frfs: FrfSet) -> Float[np.ndarray, "freq"]:
    """Compute the ordinary mode indicator function: near 0 at a normal mode, near 1 elsewhere.

    The share of the in-phase part in the response (of receptance or accelerance the real part, of mobility the
    imaginary one), averaged over all FRFs.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.

    Returns
    -------
    array of shape (freq,)
        Indicator, 0 ... 1.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> frfs = frf_set()
    >>> bool(mode_indicator(frfs)[frfs.frequencies == 60.0][0] < 0.1)
    True
    """
    values = np.asarray(frfs.values)
    in_phase = values.imag if frfs.quantity == "mobility" else values.real
    size = np.abs(values)
    total = np.sum(size**2, axis=(1, 2))
    return np.asarray(np.sum(np.abs(in_phase) * size, axis=(1, 2)) / np.where(total > 0, total, 1))


def multivariate_mode_indicator(frfs: FrfSet) -> Float[np.ndarray, "freq in"]:
    """Compute the multivariate mode indicator function: eigenvalues of the in-phase share over force patterns.

    Dips of the first value show natural frequencies, of the second repeated ones. The shorter side of the FRF matrix
    serves as inputs.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.

    Returns
    -------
    array of shape (freq, in)
        Values, smallest first.

    References
    ----------
    .. [1] Williams, Crowley and Vold (1985), The multivariate mode indicator function in modal analysis, IMAC III.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> multivariate_mode_indicator(frf_set()).shape
    (201, 2)
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
