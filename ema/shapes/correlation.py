"""How alike two sets of mode shapes, or two sets of FRFs, are."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Inexact

from ema.data import ModalModel
from ema.dof import Dof, match
from ema.errors import InputError


def _unit_columns(shapes: Inexact[np.ndarray, "row column"]) -> Inexact[np.ndarray, "row column"]:
    """Columns of length one; a column of zeros, which has no direction, becomes NaN."""
    if not np.all(np.isfinite(shapes)):
        raise InputError("shapes hold NaN or infinite values", advice="leave out the DOFs that were not measured")
    if not len(shapes):
        raise InputError("shapes without a DOF", got="0 rows", expected="at least one DOF in common")
    # dividing by the largest entry first keeps squares of tiny and huge shapes in the range of floats
    peak = np.max(np.abs(shapes), axis=0)
    scaled = np.divide(shapes, peak, out=np.full(shapes.shape, np.nan, shapes.dtype), where=peak > 0)
    return np.asarray(scaled / np.linalg.norm(scaled, axis=0))


def mac(
    a: Inexact[np.ndarray, "dof mode_a"] | ModalModel, b: Inexact[np.ndarray, "dof_b mode_b"] | ModalModel
) -> Float[np.ndarray, "mode_a mode_b"]:
    """Modal assurance criterion between every shape of ``a`` and every shape of ``b``.

    Parameters
    ----------
    a, b : array or ModalModel
        Two modal models: their shapes on the DOFs that both have, opposite senses turned. Or two arrays of shapes on
        the same DOFs in the same order and sense, shapes (dof, mode_a) and (dof, mode_b); any scale and phase.

    Returns
    -------
    array of shape (mode_a, mode_b)
        Between 0 and 1; NaN for a shape of zeros.

    Raises
    ------
    InputError
        If a value is not finite, the models have no DOF in common, the numbers of DOFs differ, or one is a model and
        the other an array.

    References
    ----------
    Allemang and Brown (1982): A correlation coefficient for modal vector analysis.

    Examples
    --------
    >>> import numpy as np
    >>> mac(np.array([[1.0], [1.0]]), np.array([[2.0, 1.0], [2.0, -1.0]])).round(6)
    array([[1., 0.]])
    """
    if isinstance(a, ModalModel) and isinstance(b, ModalModel):
        first, second, _ = _on_common_dofs(a, b)
        return mac(first, second)
    if isinstance(a, ModalModel) or isinstance(b, ModalModel):
        raise InputError(
            "one is a modal model and the other is not",
            got=f"{type(a).__name__} and {type(b).__name__}",
            expected="two models, or two arrays of shapes (dof, mode) on the same DOFs",
        )
    if len(a) != len(b):
        raise InputError(
            "shapes on different DOFs", got=f"{len(a)} and {len(b)} rows", expected="the same DOFs in both"
        )
    return np.asarray(np.minimum(np.abs(_unit_columns(a).conj().T @ _unit_columns(b)) ** 2, 1.0))


def _on_common_dofs(a: ModalModel, b: ModalModel) -> tuple[np.ndarray, np.ndarray, tuple[Dof, ...]]:
    """Shapes of both models on the DOFs that both have, in the sense of ``a``, and these DOFs.

    Raises
    ------
    InputError : the models have no DOF in common.
    """
    common = match(a.dofs, b.dofs)
    if not common:
        raise InputError(
            "the models have no DOF in common",
            got=f"{len(a.dofs)} and {len(b.dofs)} DOFs",
            advice="compare runs measured on the same points, or rename the nodes of one of them",
        )
    rows, places, signs = (np.array(column) for column in zip(*common, strict=True))
    return a.shapes[rows], b.shapes[places] * signs[:, None], tuple(a.dofs[row] for row in rows)


def auto_mac(shapes: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "mode mode"]:
    """Compute the MAC of a set of shapes with itself.

    Values off the diagonal are large where the points cannot distinguish two modes.

    Parameters
    ----------
    shapes : Inexact
        Mode shapes.

    Returns
    -------
    array of shape (mode, mode)
        MAC of every shape with every other one.

    Raises
    ------
    InputError
        If a value is not finite.

    References
    ----------
    .. [1] Allemang and Brown (1982), A correlation coefficient for modal vector analysis, IMAC I.

    Examples
    --------
    >>> auto_mac(np.array([[1.0, 1.0], [0.0, 1.0]])).round(3)
    array([[1. , 0.5],
           [0.5, 1. ]])
    """
    return mac(shapes, shapes)


def co_mac(a: Inexact[np.ndarray, "dof mode"], b: Inexact[np.ndarray, "dof mode"]) -> Float[np.ndarray, "dof"]:
    """Compute the coordinate MAC of paired shapes: how well each DOF agrees over all modes.

    Parameters
    ----------
    a, b : Inexact
        Paired shapes, column r of ``a`` belonging to column r of ``b``; each is taken with unit length.

    Returns
    -------
    array of shape (dof,)
        Co-MAC of every DOF, 0 ... 1; NaN where all shapes of ``a`` or of ``b`` vanish.

    Raises
    ------
    InputError
        If a value is not finite, or the arrays differ in shape.

    References
    ----------
    .. [1] Lieven and Ewins (1988), Spatial correlation of mode shapes, the coordinate modal assurance criterion, IMAC
       VI.

    Examples
    --------
    >>> co_mac(np.array([[1.0], [1.0]]), np.array([[2.0], [-2.0]])).round(6)
    array([1., 1.])
    """
    if a.shape != b.shape:
        raise InputError("shapes are not paired", got=f"{a.shape} and {b.shape}", expected="two arrays of one shape")
    left, right = np.abs(_unit_columns(a)), np.abs(_unit_columns(b))
    product, norms = np.sum(left * right, axis=1) ** 2, np.sum(left**2, axis=1) * np.sum(right**2, axis=1)
    return np.asarray(np.divide(product, norms, out=np.full(len(product), np.nan), where=norms > 0))


def frac(a: Inexact[np.ndarray, "freq *frf"], b: Inexact[np.ndarray, "freq *frf"]) -> Float[np.ndarray, "*frf"]:
    """Compute the frequency response assurance criterion of each FRF over the lines of the first axis.

    Parameters
    ----------
    a, b : complex arrays of shape (freq, ...)
        FRFs on the same lines.

    Returns
    -------
    array of shape (...)
        FRAC of every FRF, 0 ... 1; NaN for an FRF of zeros.

    Raises
    ------
    InputError
        If a value is not finite, or the arrays differ in shape.

    References
    ----------
    .. [1] Heylen and Lammens (1996), FRAC: a consistent way of comparing frequency response functions.

    Examples
    --------
    >>> frac(np.array([[1.0 + 1j], [2.0]]), np.array([[2.0 + 2j], [4.0]])).round(6)
    array([1.])
    """
    if a.shape != b.shape:
        raise InputError("FRFs do not correspond", got=f"{a.shape} and {b.shape}", expected="two arrays of one shape")
    left, right = _unit_columns(a.reshape(len(a), -1)), _unit_columns(b.reshape(len(b), -1))
    return np.asarray(np.minimum(np.abs(np.sum(left.conj() * right, axis=0)) ** 2, 1.0).reshape(a.shape[1:]))


_PER_FACTOR = 0.1
"""MAC that a change of frequency by the factor e weighs, and as much as larger ones. Where sensors are few, modes far
apart have one shape to the last digits of the MAC, and noise would join any with any; modes that change places within
10 % of frequency are 0.01 of MAC apart by it, and keep to their shapes."""
_SURE = 0.9
"""MAC from which on a shape is taken for that of the mode, if no other is as like to `_TIED`."""
_APART = 0.2
"""MAC of a pair lost by an exchange of partners from which on it is certain below `_SURE`: of two modes whose shapes a
stiffer joint turns into each other, both are certain up to a turn of 39 degrees."""
_TIED = 0.005
"""The same above `_SURE`, where differences of the MAC tell little: with equal shapes, frequencies have to be apart by
5 %."""


@dataclass(frozen=True)
class Comparison:
    """Two modal models over the DOFs that they share.

    Parameters
    ----------
    mac : array of shape (mode_a, mode_b)
        MAC of every mode of a with every mode of b.
    dofs : tuple of Dof
        Shared DOFs in the sense of the first model.
    pairs : tuple of tuple of (int, int)
        Best one-to-one pairing as (mode of a, mode of b), both from 0, in the order of a.
    rivals : tuple of tuple of int
        For each pair, the other modes of b that may be the partner: not empty where it is ambiguous, for shapes and
        frequencies are nearly as like after an exchange of partners: within 0.2 of MAC for each pair, and 0.005 where
        the MAC of the pair is above 0.9.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> comparison = compare(modal_model(), modal_model())
    >>> comparison.pairs, comparison.rivals
    (((0, 0), (1, 1), (2, 2)), ((), (), ()))
    """

    mac: Float[np.ndarray, "mode_a mode_b"]
    dofs: tuple[Dof, ...]
    pairs: tuple[tuple[int, int], ...]
    rivals: tuple[tuple[int, ...], ...]


def compare(a: ModalModel, b: ModalModel, threshold: float = 0.5) -> Comparison:
    """Pair the modes of two models by MAC over the DOFs that both have, opposite senses turned.

    The pairing is the one with the largest sum of MAC values; where shapes are as like, frequencies decide: a change by
    the factor e weighs as much as 0.1 of MAC.

    Parameters
    ----------
    a, b : ModalModel
        The models.
    threshold : float, default 0.5
        Smallest MAC of a pair.

    Returns
    -------
    Comparison
        MAC table, shared DOFs and pairs.

    Raises
    ------
    InputError
        If the models have no DOF in common.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> compare(modal_model(), modal_model(), threshold=0.9).pairs
    ((0, 0), (1, 1), (2, 2))
    """
    from scipy.optimize import linear_sum_assignment

    first, second, dofs = _on_common_dofs(a, b)
    table = mac(first, second)
    least = np.finfo(float).tiny  # rigid body modes at 0 Hz are as near as modes can be
    rows, columns = (np.log(np.maximum(one.natural_frequencies, least)) for one in (a, b))
    likeness = np.nan_to_num(table) - _PER_FACTOR * np.minimum(np.abs(columns[None, :] - rows[:, None]), 1.0)
    left, right = linear_sum_assignment(likeness, maximize=True)
    pairs = tuple((int(i), int(j)) for i, j in zip(left, right, strict=True) if table[i, j] >= threshold)
    return Comparison(table, dofs, pairs, _rivals(np.nan_to_num(table), likeness, pairs))


def _rivals(
    table: Float[np.ndarray, "mode_a mode_b"],
    likeness: Float[np.ndarray, "mode_a mode_b"],
    pairs: tuple[tuple[int, int], ...],
) -> tuple[tuple[int, ...], ...]:
    """As of `Comparison`."""
    partner = {j: i for i, j in pairs}

    def doubtful(i: int, j: int, k: int) -> bool:
        loss = likeness[i, j] - likeness[i, k]
        if k in partner:
            loss = 0.5 * (loss + likeness[partner[k], k] - likeness[partner[k], j])
        return bool(loss < (_TIED if table[i, j] >= _SURE else _APART))

    return tuple(tuple(k for k in range(table.shape[1]) if k != j and doubtful(i, j, k)) for i, j in pairs)
