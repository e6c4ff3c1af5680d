"""Scaling of shapes to unit modal mass by one or several drive points."""

from dataclasses import replace

import numpy as np

from ema.data import Finding, ModalModel
from ema.dof import match

_DISAGREEMENT = 0.1
"""Largest relative difference of the modal masses by several drive points, weighted by their part in the shape, above
which a finding names them. No value depends on it."""


def scale_to_unit_modal_mass(model: ModalModel) -> ModalModel:
    """Scale shapes so that ``R = phi phi^T / (2j w_d)``, from every DOF that is also a reference.

    Several drive points are weighted by their motion; where they disagree by more than 10 % a finding says so. Without
    a drive point the model stays unscaled and a finding says why.
    """
    drive = match(model.inputs, model.dofs)
    if not drive or not len(model.poles):
        if drive:
            return replace(model, scaling="unit modal mass")
        note = Finding(
            "info",
            "no-drive-point",
            model.name or "fit",
            "No reference is also a response, so shapes have no modal mass.",
            advice="Measure one drive point to scale the shapes.",
        )
        return replace(model, findings=(*model.findings, note))
    omega = model.poles.imag
    references, rows, signs = (np.array(column) for column in zip(*drive, strict=True))
    shape = signs[:, None] * model.shapes[rows]
    target = 2j * omega * model.participation[references]
    # Least squares for c^2 in target = c^2 shape, so that shapes c and participation / c fulfil the definition.
    energy = np.sum(np.abs(shape) ** 2, axis=0)
    square = np.sum(shape.conj() * target, axis=0) / np.where(energy > 0, energy, 1)
    usable = np.abs(square) > 0
    factor = np.sqrt(np.where(usable, square, 1))
    # Of the two roots, the one that keeps the largest component of the shape positive.
    largest = model.shapes[np.argmax(np.abs(model.shapes), axis=0), np.arange(len(omega))] * factor
    factor = np.where(largest.real < 0, -factor, factor)
    findings = list(model.findings)
    for mode in range(len(omega)):
        if len(drive) > 1 and usable[mode]:
            own = np.abs(target[:, mode]) / np.where(shape[:, mode] == 0, np.inf, np.abs(shape[:, mode]))
            spread = float(np.max(np.abs(own / abs(square[mode]) - 1) * np.abs(shape[:, mode]) / np.sqrt(energy[mode])))
            if spread > _DISAGREEMENT:
                findings.append(
                    Finding.of(
                        "warning",
                        "drive-points-disagree",
                        f"{model.name or 'fit'}, mode {mode + 1}",
                        "The drive points disagree on the modal mass by up to {spread} %.",
                        spread,
                        _DISAGREEMENT,
                        advice="Check the sensitivities and directions at the drive points.",
                        spread=f"{100 * spread:.0f}",
                    )
                )
    return replace(
        model,
        shapes=model.shapes * factor,
        participation=model.participation / factor,
        scaling="unit modal mass",
        findings=tuple(findings),
    )
