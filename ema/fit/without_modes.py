"""DOFs whose FRFs show none of the modes: a broken sensor or cable, or a place where nothing moves."""

import numpy as np
import scipy.stats

from ema.data import Finding, ModalModel

_CHANCE = 1e-3
"""Probability that a DOF of noise alone is not named: its shape components over their variance are then chi-square with
two degrees of freedom for each mode."""
_FEWEST = 2
"""Modes from which on a DOF without any says something: it may well lie on the node line of a single one."""
_NAMED = 6
"""DOFs that are named; the others are counted. No value depends on it."""


def without_modes(model: ModalModel) -> tuple[Finding, ...]:
    """A finding for the DOFs whose components of all shapes noise explains.

    Modes of a group are left out: their shapes are known together, not each by itself.
    """
    grouped = [mode for group in model.groups for mode in group]
    single = np.setdiff1d(np.arange(len(model.poles)), grouped)
    if model.uncertainty is None or len(single) < _FEWEST:
        return ()
    variance = np.trace(model.uncertainty.shapes[single], axis1=2, axis2=3)
    power = 2 * np.abs(model.shapes[:, single].T) ** 2
    seen = np.sum(power / np.maximum(variance, np.finfo(float).tiny), axis=0)
    silent = np.flatnonzero(seen < scipy.stats.chi2.isf(_CHANCE, 2 * len(single)))
    if not len(silent):
        return ()
    named = [str(model.dofs[row]) for row in silent[:_NAMED]] + ["..."] * (len(silent) > _NAMED)
    return (
        Finding.of(
            "warning",
            "dof-without-modes",
            model.name or "fit",
            "{count} of {dofs} DOFs follow none of the modes ({names}): noise explains their components of all shapes, "
            "which are not determined.",
            float(len(silent)),
            advice="Check sensor, cable and channel table, unless nothing moves there, and leave these DOFs out.",
            count=len(silent),
            dofs=len(model.dofs),
            names=", ".join(named),
        ),
    )
