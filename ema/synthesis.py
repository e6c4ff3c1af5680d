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
    """``1 / (j w - p)`` and ``1 / (j w - conj(p))`` on the given lines (Hz; poles in rad/s)."""
    s = 2j * np.pi * frequencies[:, None]
    return 1 / (s - poles[None, :]), 1 / (s - poles.conj()[None, :])


def receptance(
    model: ModalModel, frequencies: Float[np.ndarray, "freq"], residuals: bool = True
) -> Complex[np.ndarray, "freq dof in"]:
    """Receptance between all DOFs and inputs of ``model`` (ISO 7626-1), with or without its residual terms."""
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
    """FRFs of a modal model, by reciprocity also with its DOFs as inputs and its references as outputs.

    Parameters
    ----------
    frequencies : Hz.
    outputs, inputs : DOFs wanted; by default ``model.dofs`` and ``model.inputs``.

    Raises
    ------
    InputError : a DOF is not in the model.
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
    """Residue matrices of the receptance between these DOFs, by reciprocity also against the order of the model.

    Raises
    ------
    InputError : a DOF is not in the model.
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
    return values * np.outer([sign for *_, sign in rows], [sign for *_, sign in columns])


def convert(frfs: FrfSet, quantity: FrfQuantity) -> FrfSet:
    """The same FRFs as receptance, mobility or accelerance; a line at 0 Hz is dropped when it has to be divided.

    Raises
    ------
    InputError : the quantity of the FRFs is unstated.
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
