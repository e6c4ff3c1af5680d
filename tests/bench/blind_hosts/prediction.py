"""The prediction of a case: from the noisy FRFs of the bare host and the sheet alone, by the whole chain of ``ema``."""

from typing import Any

import numpy as np

from ema import place
from ema.data import Finding, FrfSet, Geometry
from ema.dof import Dof
from ema.errors import InputError
from ema.place.job import place as placed
from ema.place.recipe import PlaceRecipe
from ema.place.task import Task
from ema.shapes import smooth, with_rigid_body
from ema.study import chain
from ema.study.recipe import FitTable
from tests.bench.blind_hosts.hosts import (
    CALIBRATION,
    FORCES,
    LEVELS,
    LOSS_STD,
    SCATTER,
    SEARCHED,
    STATED,
    Measured,
    Sheet,
)

DRAWS = 200
RANKED = 9
"""Places whose order is judged: the best one and others spread over the ranking."""
COVERS = 1.96
FULL: dict[str, Any] = {
    "friction_std": STATED["friction"] / COVERS,
    "stiffness_std": STATED["tangential"] / COVERS,
    "normal_std": STATED["normal"] / COVERS,
    "force_std": STATED["force"] / COVERS,
    "height_std": f"{STATED['height'] / COVERS} m",
    "exponent_std": STATED["exponent"] / COVERS,
    "length_std": STATED["length"] / COVERS,
    "scatter": SCATTER,
    "form": "open",
}
"""What the sheet states of a joint, as keys of ``[joint]``."""


def frfs_of(measured: Measured) -> FrfSet:
    """The test as FRFs between the sensors and the struck points."""
    return FrfSet(
        measured.frequencies,
        measured.values,
        tuple(Dof(1 + row, "+Z") for row in measured.sensors),
        tuple(Dof(1 + row, "+Z") for row in range(len(measured.points))),
        "accelerance",
        "(m/s^2)/N",
        variance=measured.variance,
        estimator="H1",
        name="bare",
    )


def recipe_of(
    measured: Measured,
    sheet: Sheet,
    law: dict[str, Any],
    joint: dict[str, Any],
    draws: int,
    others: int | None = None,
) -> PlaceRecipe:
    """What the engineer would write; with a number of other places, which test comes next too."""
    bar = sheet.bar
    span = measured.points.max(axis=0)
    return PlaceRecipe.model_validate(
        {
            "mass": f"{measured.mass} kg",
            "near": [f"{one} Hz" for one in measured.targets],
            "at": f"{1 + measured.drive}:+Z",
            "force": [f"{one} N" for one in LEVELS],
            "normal_force": [f"{one} N" for one in SEARCHED],
            "beams": [
                {
                    "spacing": f"{bar.spacing} m",
                    "width": f"{bar.width} m",
                    "height": f"{bar.height} m",
                    "overhang": f"{bar.overhang} m",
                    "rotary": True,
                    "shear": True,
                    "loss": sheet.loss,
                    "loss_std": LOSS_STD,
                }
            ],
            "joint": {
                "surface_height": f"{sheet.height} m",
                "normal_stiffness": f"{sheet.normal} N/m",
                "contact_length": f"{sheet.length} m",
                "normal_contact": sheet.normal_contact,
                "law": {
                    "friction_coefficient": sheet.friction,
                    "contact_stiffness": f"{sheet.tangential} N/m",
                    "reference_force": f"{sheet.reference} N",
                    "stiffness_exponent": sheet.exponent,
                    **law,
                },
                **joint,
            },
            "search": {
                "step": f"{span[0] / 8} m",
                "margin": "20 mm",
                "angles": [0.0] if measured.kind == "slender" else [0.0, 90.0],
                "shortlist": 4,
                "keep": 1 + (others or 0),
                "draws": 0,
            },
            "forecast": {
                "normal_force": [f"{one} N" for one in FORCES],
                "draws": draws,
                "method": "frozen",
                "above": "plate",
                "calibration_std": CALIBRATION,
            },
            **({} if others is None else {"trials": {"places": others}}),
        }
    )


def prediction(
    measured: Measured, sheet: Sheet, law: dict[str, Any], joint: dict[str, Any], draws: int = DRAWS, seed: int = 0
) -> dict[str, Any]:
    """Place, bands at all conditions, and the damping expected at ``RANKED`` places; raises ``InputError``."""
    points = np.column_stack([measured.points, np.zeros(len(measured.points))])
    geometry = Geometry(np.arange(1, len(points) + 1), points)
    bare = chain.fitted(frfs_of(measured), FitTable())[1]
    recipe = recipe_of(measured, sheet, law, joint, draws)
    answer = placed(recipe, bare, geometry)
    told, best = answer.forecast, answer.ranking.best
    assert told is not None
    candidates = answer.ranking.prediction.candidates
    asked = [int(np.argmin(np.abs(told.normal_forces - force))) for force in FORCES]
    order = [row for row in np.argsort(-answer.ranking.scores) if np.isfinite(answer.ranking.scores[row])]
    spread = np.array(order)[np.unique(np.linspace(0, len(order) - 1, RANKED - 1).astype(int))]
    rows = np.array(list(dict.fromkeys([best.candidate, *spread])))
    whole, _ = with_rigid_body(bare, geometry, measured.mass)
    modes = tuple(int(np.argmin(np.abs(whole.natural_frequencies - near))) for near in measured.targets)
    task = Task(
        whole, smooth(whole, geometry), recipe.bolted_joint(), recipe.at, LEVELS[-1:], FORCES[1:2], modes, recipe.output
    )
    checked = place.verify(task, place.predict(task, candidates), rows)
    return {
        "bare": {"frequency": told.bare_frequencies.tolist(), "damping": told.bare_damping.tolist()},
        "place": [*best.centre, best.angle],
        **{
            name: getattr(told, name)[..., asked].tolist()
            for name in ("frequency", "frequency_low", "frequency_high", "damping", "damping_low", "damping_high")
        },
        "places": [[*candidates.centres[row].tolist(), float(candidates.angles[row])] for row in rows],
        "ranked": checked.damping[:, :, 0, 0].T.tolist(),
        "findings": sorted({one.code for one in _all(answer.findings, told.findings)}),
    }


def _all(*groups: tuple[Finding, ...]) -> list[Finding]:
    return [one for group in groups for one in group]


__all__ = ["DRAWS", "FULL", "InputError", "prediction"]
