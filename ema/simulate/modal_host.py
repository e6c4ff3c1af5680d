"""A measured modal model as the structure a friction beam is attached to: no FE model is needed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ema.data import Finding, ModalModel
from ema.dof import Dof
from ema.errors import InputError

_ABOVE = 20.0
"""Frequency of the modes that stand for an upper residual term, over the highest of the model: their dynamics within
the band are 1/400 of their flexibility at most."""


@dataclass(frozen=True)
class ModalCoordinates:
    """Modal masses and stiffnesses of a measured host; ``shapes`` (dof, coordinate), ``decay`` (coordinate,) 1/s.

    After the modes come the residual terms: one coordinate without stiffness for every direction of the lower one
    (rigid-body modes), and one far above the band for every direction of the upper one (static flexibility).
    """

    mass: Float[np.ndarray, "n n"]
    stiffness: Float[np.ndarray, "n n"]
    decay: Float[np.ndarray, "n"]
    shapes: Float[np.ndarray, "dof n"]
    dofs: tuple[Dof, ...]
    findings: tuple[Finding, ...]


def modal_coordinates(model: ModalModel) -> ModalCoordinates:
    """Modal coordinates of a measured host.

    Its damping couples the modes of the stuck structure; the fast time solver and harmonic balance take it whole.

    Raises
    ------
    InputError : the shapes are not scaled to unit modal mass, a mode is not damped positively.
    """
    where = model.name or "modal host"
    if model.scaling != "unit modal mass":
        raise InputError(
            "a host needs scaled shapes",
            where=where,
            got=model.scaling,
            expected="unit modal mass",
            advice="measure the force and a drive point",
        )
    if np.any(model.damping_ratios < 0):
        raise InputError(
            "a mode with negative damping", where=where, got=f"{model.damping_ratios.min():.2e}", expected="0 or more"
        )
    findings = []
    shapes = np.real(model.shapes)
    lost = float(np.linalg.norm(np.imag(model.shapes))) / max(float(np.linalg.norm(model.shapes)), 1e-300)
    if lost > 0.1:
        findings.append(
            Finding(
                "warning",
                "complex-host",
                where,
                f"{lost:.0%} of the shapes is out of phase.",
                lost,
                0.1,
                "Make the shapes real first (ema.shapes.realise).",
            )
        )
    omega = np.abs(model.poles)
    squares, decay, columns = list(omega**2), list(-2 * np.real(model.poles)), [shapes]
    rest = model.residuals
    if rest is not None and tuple(model.inputs) == tuple(model.dofs):
        rigid, flexible = _directions(np.real(rest.lower)), _directions(np.real(rest.upper))
        top = _ABOVE * float(omega.max())
        columns += [rigid, flexible * top]
        squares += [0.0] * rigid.shape[1] + [top**2] * flexible.shape[1]
        decay += [0.0] * (rigid.shape[1] + flexible.shape[1])
    elif rest is not None:
        findings.append(
            Finding(
                "warning",
                "no-residuals",
                where,
                "the residual terms are left out.",
                None,
                None,
                "They are needed between all DOFs: the host is too stiff.",
            )
        )
    return ModalCoordinates(
        np.eye(len(squares)), np.diag(squares), np.array(decay), np.hstack(columns), model.dofs, tuple(findings)
    )


def _directions(matrix: Float[np.ndarray, "dof in"]) -> Float[np.ndarray, "dof direction"]:
    """Columns whose outer products give the positive part of a symmetric matrix."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    keep = values > 1e-9 * max(float(values[-1]), 1e-300)
    return np.asarray(vectors[:, keep] * np.sqrt(values[keep]))
