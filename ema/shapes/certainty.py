"""How sure a MAC is: what the uncertainty of two shapes makes of the criterion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float, Int

from ema.data import ModalModel
from ema.data._arrays import freeze
from ema.dof import match
from ema.errors import InputError


@dataclass(frozen=True)
class MacUncertainty:
    """MAC of pairs of modes with its uncertainty by the noise of the shapes.

    Parameters
    ----------
    mac : array of shape (pair,)
        MAC of each pair.
    std : array of shape (pair,)
        Standard uncertainty of the MAC.
    lowered : array of shape (pair,)
        By how much the noise lowers the MAC on average: between two estimates of one and the same shape it is 1 -
        ``lowered`` and not 1.

    Examples
    --------
    >>> MacUncertainty(mac=[0.98], std=[0.01], lowered=[0.015]).std
    array([0.01])
    """

    mac: Float[np.ndarray, "pair"]
    std: Float[np.ndarray, "pair"]
    lowered: Float[np.ndarray, "pair"]

    def __post_init__(self) -> None:
        freeze(self, mac=np.float64, std=np.float64, lowered=np.float64)


def mac_uncertainty(a: ModalModel, b: ModalModel, pairs: Sequence[tuple[int, int]]) -> MacUncertainty:
    """Compute the uncertainty of the MAC of pairs of modes from that of their shapes, to second order.

    The first order alone gives zero for equal shapes, where the criterion has its maximum; the second order gives its
    scatter and its mean there. Errors of the two models are taken as independent. A model without uncertainty, such as
    a simulation, counts as exact.

    Parameters
    ----------
    a, b : ModalModel
        The models; at least one with the uncertainty of its shapes.
    pairs : sequence of tuple of (int, int)
        (mode of a, mode of b), from 0.

    Returns
    -------
    MacUncertainty
        MAC, standard uncertainty and mean loss of every pair.

    Raises
    ------
    InputError
        If the models have no DOF in common, a mode does not exist, or neither model states an uncertainty.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from ema.data import ModalUncertainty
    >>> from ema.examples import modal_model
    >>> model = modal_model()
    >>> noise = ModalUncertainty(
    ...     values=np.zeros((6, 6)), shapes=np.tile(1e-4 * np.eye(2), (3, 4, 1, 1)), common=np.zeros((3, 4, 0)),
    ...     participation=np.zeros((3, 2, 2, 2)), residues=np.zeros((3, 4, 2, 2, 2)), modal_mass=np.zeros(3),
    ... )
    >>> mac_uncertainty(replace(model, uncertainty=noise), model, [(0, 0)]).mac.round(6)
    array([1.])
    """
    common = match(a.dofs, b.dofs)
    where = f"MAC of {a.name or 'a'} and {b.name or 'b'}"
    if not common:
        raise InputError("the models have no DOF in common", where=where, advice="compare runs on the same points")
    if a.uncertainty is None and b.uncertainty is None:
        raise InputError("neither model states an uncertainty", where=where, expected="a model of ema.fit.modes")
    if any(not (0 <= i < len(a.poles) and 0 <= j < len(b.poles)) for i, j in pairs):
        raise InputError(
            "no such mode", where=where, got=str(list(pairs)), expected=f"modes below {len(a.poles)} and {len(b.poles)}"
        )
    rows, places, signs = (np.array(column) for column in zip(*common, strict=True))
    moments = [_moments(*_shape(a, i, rows), *_shape(b, j, places, signs)) for i, j in pairs]
    mac, std, lowered = np.array(moments, dtype=np.float64).reshape(-1, 3).T
    return MacUncertainty(mac, std, lowered)


def _shape(
    model: ModalModel, mode: int, rows: Int[np.ndarray, "row"], signs: Int[np.ndarray, "row"] | None = None
) -> tuple[Complex[np.ndarray, "row"], Float[np.ndarray, "component component"]]:
    """A shape of length one and the covariance of its real and imaginary parts (first all real ones)."""
    turn = np.ones(len(rows)) if signs is None else signs.astype(np.float64)
    shape = turn * model.shapes[rows, mode]
    size = float(np.linalg.norm(shape)) or 1.0
    count = len(rows)
    covariance = np.zeros((2, count, 2, count))
    if model.uncertainty is not None:
        common = turn[:, None] * model.uncertainty.common[mode][rows]
        parts = np.concatenate([common.real, common.imag])
        covariance = (parts @ parts.T).reshape(2, count, 2, count)
        own = np.arange(count)
        # what is not shared by DOFs is what is left of the variance of each
        covariance[:, own, :, own] = model.uncertainty.shapes[mode][rows]
    return shape / size, covariance.reshape(2 * count, 2 * count) / size**2


def _moments(
    a: Complex[np.ndarray, "row"],
    covariance_a: Float[np.ndarray, "component component"],
    b: Complex[np.ndarray, "row"],
    covariance_b: Float[np.ndarray, "component component"],
) -> tuple[float, float, float]:
    """MAC, its standard deviation and its mean loss, from the Taylor series to second order and Gaussian errors."""
    inner = np.vdot(b, a)
    mac = float(abs(inner) ** 2)
    slope_a, bend_a = _derivatives(a, b, inner, mac)
    slope_b, bend_b = _derivatives(b, a, inner.conjugate(), mac)
    # change of the slope over a with b, column by column of real and imaginary parts
    step = np.concatenate([np.eye(len(b)), 1j * np.eye(len(b))], axis=1)
    towards = inner * step + np.outer(b, (a.conj() @ step).conj()) - 2 * np.outer(b * inner, (b.conj() @ step).real)
    mixed = 2 * (np.concatenate([towards.real, towards.imag]) - np.outer(_real(a), slope_b))
    # Gaussian errors with covariance C: var M = M'^T C M' + 1/2 tr(M'' C M'' C), mean of M - M0 = 1/2 tr(M'' C)
    of_a, of_b = bend_a @ covariance_a, bend_b @ covariance_b
    first = slope_a @ covariance_a @ slope_a + slope_b @ covariance_b @ slope_b
    second = 0.5 * (np.sum(of_a * of_a.T) + np.sum(of_b * of_b.T))
    second += np.sum((mixed @ covariance_b @ mixed.T) * covariance_a)
    # the slopes are those at the estimates: their own noise adds twice the second order to the first, on average
    variance = max(first - second, second)
    return mac, float(np.sqrt(variance)), float(-0.5 * (np.trace(of_a) + np.trace(of_b)))


def _derivatives(
    a: Complex[np.ndarray, "row"], b: Complex[np.ndarray, "row"], inner: complex, mac: float
) -> tuple[Float[np.ndarray, "component"], Float[np.ndarray, "component component"]]:
    """Slope and second derivative of the MAC over the real and imaginary parts of ``a``; both vectors of length one."""
    # M = N / D with N = |b^H a|^2 and D = a^H a = x^T x, at D = 1:  M' = N' - 2 M x with N' = 2 real(b b^H a)
    x = _real(a)
    slope = 2 * (_real(b * inner) - mac * x)
    # M'' = N'' - 2 M - 2 (M' x^T + x M'^T), N'' = 2 (u u^T + w w^T): u and w are b and j b as real vectors
    first, second = _real(b), _real(1j * b)
    bend = 2 * (np.outer(first, first) + np.outer(second, second) - mac * np.eye(len(x)))
    return slope, bend - 2 * (np.outer(slope, x) + np.outer(x, slope))


def _real(values: Complex[np.ndarray, "row"]) -> Float[np.ndarray, "component"]:
    return np.concatenate([values.real, values.imag])
