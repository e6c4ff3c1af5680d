"""Scaling of shapes to unit modal mass by one or several drive points."""

from dataclasses import replace

import numpy as np
import scipy.stats

from ema.data import Finding, ModalModel
from ema.dof import match

_DISAGREEMENT = 0.1
"""Largest relative difference of the modal masses by several drive points, weighted by their part in the shape, above
which a finding names them. No value depends on it."""
_CHANCE = 0.01
"""Probability that noise alone, with the stated uncertainty, makes such a finding for any drive point of any mode."""


def scale_to_unit_modal_mass(model: ModalModel) -> ModalModel:
    """Scale shapes so that ``R = phi phi^T / (2j w_d)``, from every DOF that is also a reference.

    Several drive points are weighted by their motion (`disagreements` says whether they agree). Without a drive point
    the model stays unscaled and a finding says why.
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
    return replace(
        model,
        shapes=model.shapes * factor,
        participation=model.participation / factor,
        scaling="unit modal mass",
    )


def disagreements(model: ModalModel) -> tuple[Finding, ...]:
    """A finding for each mode of a scaled model whose drive points give modal masses that differ by more than 10 %, and
    by more than the uncertainty of shape and participation explains.
    """
    drive = match(model.inputs, model.dofs) if model.scaling == "unit modal mass" else []
    if len(drive) < 2 or not len(model.poles):
        return ()
    references, rows, _ = (np.array(column) for column in zip(*drive, strict=True))
    shape, twice = np.abs(model.shapes[rows]), 2 * model.poles.imag
    size = np.maximum(np.linalg.norm(shape, axis=0), np.finfo(float).tiny)
    spread = np.abs(twice * np.abs(model.participation[references]) - shape) / size
    limit = np.full(spread.shape, _DISAGREEMENT)
    if model.uncertainty is not None:
        # A magnitude varies as much as the complex value at most.
        of_shapes, of_participation = (
            np.trace(variances, axis1=-2, axis2=-1).T
            for variances in (model.uncertainty.shapes[:, rows], model.uncertainty.participation[:, references])
        )
        quantile = scipy.stats.norm.isf(_CHANCE / 2 / spread.size)
        limit = np.maximum(limit, quantile * np.sqrt(of_shapes + twice**2 * of_participation) / size)
    found = []
    for mode in np.flatnonzero(np.any(spread > limit, axis=0)):
        worst = np.argmax(spread[:, mode] / limit[:, mode])
        found.append(
            Finding.of(
                "warning",
                "drive-points-disagree",
                f"{model.name or 'fit'}, mode {mode + 1}",
                "The drive points disagree on the modal mass by up to {spread} %.",
                float(spread[worst, mode]),
                float(limit[worst, mode]),
                advice="Check the sensitivities and directions at the drive points.",
                spread=f"{100 * spread[worst, mode]:.0f}",
            )
        )
    return tuple(found)
