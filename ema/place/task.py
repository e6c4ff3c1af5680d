"""What a placement is asked."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from ema.data import ModalModel
from ema.data.placement import BoltedJoint, Candidates
from ema.dof import Dof
from ema.shapes import Surface

_SWAY = 0.1
"""Frequency over that of the lowest target below which a mode is taken for swaying on the suspension."""


class Task(NamedTuple):
    """The measured structure, the joint, the range of forces, and the target modes.

    Parameters
    ----------
    bare : ModalModel
        Modes of the structure without the beam, of unit modal mass.
    surface : Surface
        Their smooth shapes.
    joint : BoltedJoint
        Joint of the beam.
    at : Dof or str
        Excited DOF.
    force_levels : array of shape (level,)
        F_E [N].
    normal_forces : array of shape (force,)
        F_N per joint [N].
    modes : tuple of int
        Target modes, rows of ``bare`` from 0.
    output : Dof or str, optional
        DOF whose response counts; the excited one where ``None``.
    scale_std : float, default 0.0
        Relative standard uncertainty of the scale common to all shapes, half that of the calibration of the test.
    in_plane : {"free", "held"}, default "free"
        Whether a structure that hangs freely may move in its own plane.
    flexibility_factor : float, default 1.0
        Factor on the estimated flexibility of the modes above those measured.

    Examples
    --------
    >>> from ema.data import FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), normal_stiffness=1e8, surface_height=0.003)
    >>> task = Task(bare, smooth(bare, geometry), joint, "1:+Z", np.array([10.0]), np.array([100.0]), modes=(0,))
    >>> len(task.bare.poles)
    3
    """

    bare: ModalModel
    surface: Surface
    joint: BoltedJoint
    at: Dof | str
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    modes: tuple[int, ...]
    output: Dof | str | None = None
    scale_std: float = 0.0
    in_plane: Literal["free", "held"] = "free"
    flexibility_factor: float = 1.0


def without_suspension(task: Task) -> Task:
    """The task without the modes far below its targets: a freely hung structure sways long after a release."""
    sizes = np.abs(task.bare.poles)
    keep = np.flatnonzero(sizes >= _SWAY * sizes[list(task.modes)].min())
    bare, surface = task.bare, task.surface
    return task._replace(
        bare=replace(
            bare,
            poles=bare.poles[keep],
            shapes=bare.shapes[:, keep],
            participation=bare.participation[:, keep],
            covariance=None if bare.covariance is None else bare.covariance[keep],
            confidence=None,
            uncertainty=None,
            groups=(),
            candidates=(),
        ),
        surface=replace(
            surface,
            coefficients=surface.coefficients[:, keep],
            covariance=surface.covariance[keep],
            noise=surface.noise[keep],
        ),
        modes=tuple(int(np.flatnonzero(keep == mode)[0]) for mode in task.modes),
    )


def only(candidates: Candidates, rows: Sequence[int] | np.ndarray) -> Candidates:
    """Some of the candidates."""
    picked = np.asarray(rows, dtype=np.int64)
    return replace(
        candidates, centres=candidates.centres[picked], angles=candidates.angles[picked], beams=candidates.beams[picked]
    )
