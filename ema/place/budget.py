"""Which of the things that are not known make the bands of a forecast wide: an uncertainty budget of its draws."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ema.data.placement import Candidates
from ema.dof import Dof, match
from ema.place.shortlist import Question
from ema.place.task import Task

ENOUGH = 50
"""Draws from which on a budget is stated: a share of a source of one number is then known to 0.1 or better."""
_PER_COLUMN = 4
"""Draws for each column of a regression, at least; with fewer the squares are left out, then the source."""
HARMONICS, REST = "upper harmonics of the friction", "all else, and what acts together"


def inputs(sample: Task, case: Question, beams: Sequence[Candidates]) -> dict[str, Float[np.ndarray, "mode value"]]:
    """What one draw took for the things that are not known, by their names, for every target mode."""
    law, modes, joints = sample.joint.law, list(sample.modes), case.model.joints
    at_joints = []
    for here in beams:
        points, angle = here.joints(0), float(here.angles[0])
        at_joints += [sample.surface.values(points)[:, modes], sample.surface.values(points, 1, angle)[:, modes]]
    wanted = [Dof.parse(dof) for dof in (sample.at, sample.output) if dof is not None]
    driven = [found[1] for found in match(wanted, sample.bare.dofs)]
    poles = sample.bare.poles[modes]
    uneven = [
        (one.law.friction_coefficient / law.friction_coefficient, one.law.contact_stiffness / law.contact_stiffness)
        for one in joints
    ]
    form = [value for name, value in law.parameters if name in ("chi", "beta")] if sample.joint.form == "open" else []
    common = {
        "friction coefficient": np.log([law.friction_coefficient]),
        "tangential contact stiffness": np.log([law.contact_stiffness]),
        "exponent of the contact stiffness": [law.stiffness_exponent],
        "form of the friction law": [form[0], np.log(form[1])] if form else [],
        "normal contact stiffness": np.log([sample.joint.normal_stiffness]),
        "contact length": [sample.joint.contact_length],
        "pressure over the contact": [] if case.pressure is None else [case.pressure],
        "normal force": np.log(sample.normal_forces[:1]),
        "height of the interface": [sample.joint.surface_height],
        "scatter from joint to joint": np.log(uneven).ravel(),
        "loss factor of the beam": [beams[0].catalogue[int(beams[0].beams[0])].loss],
        "modes above those known": np.log([sample.flexibility_factor]),
    }
    return {
        **{name: np.tile(np.asarray(value, float), (len(modes), 1)) for name, value in common.items()},
        "frequency and damping without the beam": np.log(np.stack([np.abs(poles), -poles.real / np.abs(poles)], 1)),
        "mode shape at joints and exciter": np.concatenate([*at_joints, sample.bare.shapes[driven][:, modes].real]).T,
    }


def budget(
    taken: Sequence[dict[str, Float[np.ndarray, "mode value"]]],
    ratios: Float[np.ndarray, "draw mode 2 level force"],
    harmonics: Float[np.ndarray, "mode 2 level force"],
) -> tuple[tuple[str, ...], Float[np.ndarray, "2 mode source"]]:
    """Names of the sources, and their shares of the variance of the logarithms of frequency and damping ratio.

    The share of a source is the variance that its expectation explains, of the whole (first-order index: Sobol 1993),
    by regression on its values and their squares, freed of what as many random columns would explain (adjusted
    coefficient of determination). Conditions count by their variance. None with fewer than ``ENOUGH`` draws.

    Parameters
    ----------
    taken : what each draw took (``inputs``).
    ratios : values of the draws over the nominal ones; NaN where there is none.
    harmonics : standard deviation of the logarithms by what the upper harmonics do.
    """
    names = [name for name in taken[0] if any(not np.array_equal(one[name], taken[0][name]) for one in taken)]
    names += [HARMONICS] if harmonics.any() else []
    if len(ratios) < ENOUGH or not names:
        return (), np.zeros((2, ratios.shape[1], 0))
    shares = np.zeros((2, ratios.shape[1], len(names) + 1))
    for mode in range(ratios.shape[1]):
        columns = {name: np.stack([one[name][mode] for one in taken]) for name in names if name != HARMONICS}
        for quantity in range(2):
            values = np.log(ratios[:, mode, quantity]).reshape(len(ratios), -1)
            own = harmonics[mode, quantity].ravel()
            total, parts = 0.0, np.zeros(len(names))
            for condition in range(values.shape[1]):
                known = np.isfinite(values[:, condition])
                if known.sum() < ENOUGH:
                    continue
                y = values[known, condition]
                variance = float(np.var(y))
                explained = [
                    min(own[condition] ** 2, variance)
                    if name == HARMONICS
                    else variance * _explained(columns[name][known], y)
                    for name in names
                ]
                total, parts = total + variance, parts + explained
            if total > 0:
                shares[quantity, mode, :-1] = parts / total
                shares[quantity, mode, -1] = max(1 - parts.sum() / total, 0.0)
    return (*names, REST), shares


def _explained(columns: Float[np.ndarray, "draw value"], y: Float[np.ndarray, "draw"]) -> float:
    """Share of the variance of ``y`` that the columns explain: their first powers, and squares where draws suffice."""
    some = columns[:, np.ptp(columns, axis=0) > 0]
    some = (some - some.mean(axis=0)) / some.std(axis=0)
    if _PER_COLUMN * 2 * some.shape[1] <= len(y):
        some = np.hstack([some, some**2])
    if not some.shape[1] or _PER_COLUMN * some.shape[1] > len(y):
        return 0.0
    design = np.column_stack([np.ones(len(y)), some])
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    spent = np.linalg.matrix_rank(design)
    return float(max(1 - float(left @ left) / (len(y) - spent) / float(np.var(y, ddof=1)), 0.0))
