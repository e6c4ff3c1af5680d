"""How far a mode shape is from moving in phase, and the real shape nearest to it."""

import numpy as np
from jaxtyping import Float, Inexact

from ema.data import ModeQuality


def _principal(
    shapes: Inexact[np.ndarray, "dof mode"],
) -> tuple[Float[np.ndarray, "2 mode"], Float[np.ndarray, "mode"]]:
    """Unit vector (cos, sin) of the straight line through 0 nearest to each shape in the complex plane, by SVD, and the
    share ``s2 / s1`` of what does not lie on it."""
    lines, ratios = np.full((2, shapes.shape[1]), np.nan), np.full(shapes.shape[1], np.nan)
    for mode, shape in enumerate(np.asarray(shapes, complex).T):
        peak = np.max(np.abs(shape), initial=0.0)
        if not 0 < peak < np.inf:
            continue
        plane = np.column_stack([shape.real, shape.imag]) / peak
        _, values, directions = np.linalg.svd(plane, full_matrices=False)
        line = (
            directions[0]
            if directions[0, 0] > 0 or (directions[0, 0] == 0 and directions[0, 1] > 0)
            else -directions[0]
        )
        lines[:, mode] = line
        ratios[mode] = values[1] / values[0] if len(values) > 1 else 0.0
    return lines, ratios


def mean_phase(shapes: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "mode"]:
    """Compute the mean phase of each shape: the direction of its best straight line through 0 in the complex plane.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    array of shape (mode,)
        Mean phase [deg], from -90 (excluded) to 90; NaN for a shape of zeros.

    References
    ----------
    .. [1] Reynders, Houbrechts and De Roeck (2012), Mechanical Systems and Signal Processing 29:228, section 4.

    Examples
    --------
    >>> mean_phase(np.array([[1.0 + 1.0j], [-2.0 - 2.0j]])).round(6)
    array([45.])
    """
    line, _ = _principal(shapes)
    return np.asarray(np.degrees(np.arctan2(line[1], line[0])))


def mean_phase_deviation(shapes: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "mode"]:
    """Compute the mean deviation of the phases from the mean phase, weighted by amplitude.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    array of shape (mode,)
        Mean phase deviation [deg], 0 for a real shape; NaN for a shape of zeros.

    References
    ----------
    .. [1] Reynders, Houbrechts and De Roeck (2012), Mechanical Systems and Signal Processing 29:228, section 4.

    Examples
    --------
    >>> mean_phase_deviation(np.array([[1.0], [-2.0]]))
    array([0.])
    """
    line, _ = _principal(shapes)
    turned = np.asarray(shapes, complex) * (line[0] - 1j * line[1])
    amplitudes = np.abs(turned)
    # arctan2 of absolute parts is exact near 0, where the arc cosine loses half the digits
    deviations = np.degrees(np.arctan2(np.abs(turned.imag), np.abs(turned.real)))
    total = amplitudes.sum(axis=0)
    weighted = np.sum(amplitudes * deviations, axis=0)
    return np.asarray(np.divide(weighted, total, out=np.full(len(total), np.nan), where=total > 0))


def modal_phase_collinearity(shapes: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "mode"]:
    """Compute the modal phase collinearity (MPC): 1 when all points move in phase or in opposite phase.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    array of shape (mode,)
        ((s1^2 - s2^2) / (s1^2 + s2^2))^2 with the singular values s of (real, imaginary), 0 ... 1; NaN for a shape of
        zeros.

    References
    ----------
    .. [1] Pappa, Elliott and Schenk (1993), Journal of Guidance, Control, and Dynamics 16(5).

    Examples
    --------
    >>> modal_phase_collinearity(np.array([[1.0, 1.0], [1.0, 1.0j]])).round(6)
    array([1., 0.])
    """
    _, ratio = _principal(shapes)
    return np.asarray(((1 - ratio**2) / (1 + ratio**2)) ** 2)


def quality(shapes: Inexact[np.ndarray, "dof mode"]) -> ModeQuality:
    """Compute MPC, mean phase and mean phase deviation of each shape.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    ModeQuality
        The three indicators, NaN for a shape of zeros.

    Examples
    --------
    >>> quality(np.array([[1.0], [-2.0]])).modal_phase_collinearity
    array([1.])
    """
    return ModeQuality(modal_phase_collinearity(shapes), mean_phase(shapes), mean_phase_deviation(shapes))


def realise(shapes: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "dof mode"]:
    """Return the real shapes nearest to complex ones: turned by minus their mean phase, the imaginary part dropped.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    array of shape (dof, mode)
        Real shapes; those that were real come back as they are, a shape of zeros stays zero.

    Examples
    --------
    >>> realise(np.array([[1.0j], [-2.0j]]))
    array([[ 1.],
           [-2.]])
    """
    line, _ = _principal(shapes)
    turn = np.where(np.isfinite(line[0]), line[0] - 1j * line[1], 1.0)
    return np.real(np.asarray(shapes, complex) * turn)
