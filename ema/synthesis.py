"""FRFs of a modal model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Complex, Float

from ema.data import FrfSet, ModalModel
from ema.dof import Dof, match
from ema.errors import InputError
from ema.units import DERIVATIVE_ORDER, FRF_UNIT, UNSTATED, FrfQuantity


def pole_basis(
    frequencies: Float[np.ndarray, "freq"], poles: Complex[np.ndarray, "mode"]
) -> tuple[Complex[np.ndarray, "freq mode"], Complex[np.ndarray, "freq mode"]]:
    """Return ``1 / (j w - p)`` and ``1 / (j w - conj(p))`` on frequency lines.

    Parameters
    ----------
    frequencies : array of shape (freq,)
        Frequency lines [Hz].
    poles : complex array of shape (mode,)
        Poles [rad/s].

    Returns
    -------
    tuple of (complex array of shape (freq, mode), complex array of shape (freq, mode))
        The two terms of every pole [s].

    Examples
    --------
    >>> direct, mirrored = pole_basis(np.array([0.0]), np.array([-3.0 + 4.0j]))
    >>> bool(np.isclose(direct[0, 0], mirrored[0, 0].conj()))
    True
    """
    s = 2j * np.pi * frequencies[:, None]
    return 1 / (s - poles[None, :]), 1 / (s - poles.conj()[None, :])


def receptance(
    model: ModalModel, frequencies: Float[np.ndarray, "freq"], residuals: bool = True
) -> Complex[np.ndarray, "freq dof in"]:
    """Return the receptance between all DOFs and inputs of a model (ISO 7626-1), with or without its residual terms.

    ``sum_r [R_r / (j w - p_r) + conj(R_r) / (j w - conj(p_r))] + lower / (j w)^2 + upper``; the lower residual term is
    left out at 0 Hz.

    Parameters
    ----------
    model : ModalModel
        Modes.
    frequencies : array of shape (freq,)
        Frequency lines [Hz].
    residuals : bool, default True
        Whether the residual terms are added.

    Returns
    -------
    complex array of shape (freq, dof, in)
        Receptances [m/N] where the model is scaled.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> static = receptance(modal_model(), np.array([0.0]))[0, 0, 0]
    >>> shape, omega = modal_model().shapes[0].real, 2 * np.pi * modal_model().natural_frequencies
    >>> round(float(static.real / np.sum(shape**2 / omega**2)), 9)  # sum of the modal flexibilities
    1.0
    """
    blocks = [(model.poles, model.residues())]
    rest = model.residuals if residuals else None
    if rest is not None and rest.residues is not None and len(rest.poles):
        blocks.append((rest.poles, np.asarray(rest.residues)))
    values = np.zeros((len(frequencies), len(model.dofs), len(model.inputs)), complex)
    for poles, matrices in blocks:
        direct, mirrored = pole_basis(frequencies, poles)
        flat = matrices.reshape(len(poles), values[0].size)
        values += (direct @ flat + mirrored @ flat.conj()).reshape(values.shape)
    if rest is not None:
        squares = (2j * np.pi * frequencies) ** 2
        inverse = np.divide(1, squares, out=np.zeros_like(squares), where=squares != 0)
        values += inverse[:, None, None] * rest.lower[None] + rest.upper[None]
    return values


def frfs(
    model: ModalModel,
    frequencies: Float[np.ndarray, "freq"],
    quantity: FrfQuantity = "receptance",
    outputs: Sequence[Dof] | None = None,
    inputs: Sequence[Dof] | None = None,
    residuals: bool = True,
) -> FrfSet:
    """Return FRFs of a modal model, by reciprocity also with its DOFs as inputs and its references as outputs.

    Parameters
    ----------
    model : ModalModel
        Modes.
    frequencies : array of shape (freq,)
        Frequency lines [Hz].
    quantity : {"receptance", "mobility", "accelerance", "unstated"}, default "receptance"
        Kind of the FRFs.
    outputs, inputs : sequence of Dof, optional
        DOFs of responses and forces; by default those of the model.
    residuals : bool, default True
        Whether the residual terms are added.

    Returns
    -------
    FrfSet
        FRFs; their unit is unstated where the model is not scaled to unit modal mass.

    Raises
    ------
    InputError
        If a DOF is not in the model.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> frfs(modal_model(), np.array([30.0, 50.0]), "mobility").unit
    '(m/s)/N'
    """
    outputs = tuple(model.dofs if outputs is None else outputs)
    inputs = tuple(model.inputs if inputs is None else inputs)
    values = _arranged(receptance(model, frequencies, residuals), model, outputs, inputs)
    values = values * ((2j * np.pi * frequencies) ** DERIVATIVE_ORDER[quantity])[:, None, None]
    unit = FRF_UNIT[quantity] if model.scaling == "unit modal mass" else UNSTATED
    return FrfSet(
        frequencies=frequencies,
        values=values,
        outputs=outputs,
        inputs=inputs,
        quantity=quantity,
        unit=unit,
        estimator="synthesis",
        condition=model.condition,
        name=model.name,
    )


def residues(model: ModalModel, outputs: Sequence[Dof], inputs: Sequence[Dof]) -> Complex[np.ndarray, "mode out in"]:
    """Return the residue matrices of the receptance between DOFs, by reciprocity in either order.

    Parameters
    ----------
    model : ModalModel
        Modes.
    outputs, inputs : sequence of Dof
        DOFs of responses and forces.

    Returns
    -------
    complex array of shape (mode, out, in)
        Residues of every mode.

    Raises
    ------
    InputError
        If a DOF is not in the model.

    Examples
    --------
    >>> from ema.examples import modal_model
    >>> residues(modal_model(), [Dof(4, "+Z")], [Dof(1, "+Z")]).shape
    (3, 1, 1)
    """
    return _arranged(model.residues(), model, outputs, inputs)


def _arranged(
    values: Complex[np.ndarray, "any dof reference"], model: ModalModel, outputs: Sequence[Dof], inputs: Sequence[Dof]
) -> Complex[np.ndarray, "any out in"]:
    """What a model says between its DOFs and references, between other ones of either side."""
    rows, columns = match(outputs, model.dofs), match(inputs, model.inputs)
    if len(rows) < len(outputs) or len(columns) < len(inputs):
        rows, columns = match(inputs, model.dofs), match(outputs, model.inputs)
        if len(rows) < len(inputs) or len(columns) < len(outputs):
            raise InputError(
                "the modal model does not hold these FRFs",
                got=f"outputs {', '.join(map(str, outputs[:4]))} ...",
                expected="DOFs of the model against its references, or the reverse",
            )
        values = values.transpose(0, 2, 1)
        rows, columns = columns, rows
    values = values[:, [place for _, place, _ in rows]][:, :, [place for _, place, _ in columns]]
    return np.asarray(values * np.outer([sign for *_, sign in rows], [sign for *_, sign in columns]))


def convert(frfs: FrfSet, quantity: FrfQuantity) -> FrfSet:
    """Convert FRFs to receptance, mobility or accelerance; a line at 0 Hz is dropped when it has to be divided.

    Parameters
    ----------
    frfs : FrfSet
        FRFs.
    quantity : {"receptance", "mobility", "accelerance", "unstated"}
        Kind of the FRFs to return.

    Returns
    -------
    FrfSet
        The FRFs with their variance and deviations; the same set where the quantity is already the wanted one.

    Raises
    ------
    InputError
        If the quantity of the FRFs, or the wanted one, is unstated.

    Examples
    --------
    >>> from ema.examples import frf_set
    >>> convert(frf_set(), "receptance").unit
    'm/N'
    """
    if frfs.quantity == quantity:
        return frfs
    if "unstated" in (frfs.quantity, quantity):
        raise InputError(
            "cannot convert FRFs of an unstated quantity",
            where=frfs.name,
            advice="state the unit of the response channel",
        )
    power = DERIVATIVE_ORDER[quantity] - DERIVATIVE_ORDER[frfs.quantity]
    if power < 0 and frfs.frequencies[0] == 0:
        frfs = frfs.lines(slice(1, None))
    factor = ((2j * np.pi * frfs.frequencies) ** power)[:, None, None]
    return replace(
        frfs,
        values=frfs.values * factor,
        variance=None if frfs.variance is None else frfs.variance * np.abs(factor) ** 2,
        deviations=None if frfs.deviations is None else frfs.deviations.scaled(factor),
        quantity=quantity,
        unit=FRF_UNIT[quantity] if frfs.scaled else UNSTATED,
    )
