"""Control study, refusals, and workers that fail."""

from dataclasses import replace

import numpy as np
import pytest

from ema import place, shapes
from ema.data.comparison import Verdict
from ema.errors import FailureError, InputError
from ema.place import predict
from ema.place.recipe import KIND, PlaceRecipe
from tests.unit.placement_rig import RECIPE, bare_table
from tests.unit.test_place_answers import spot, task_of


@pytest.fixture(scope="module")
def table():
    bare, geometry = bare_table()
    return bare, shapes.smooth(bare, geometry)


def test_a_controlled_force_is_told_against_the_best_constant_one(table):
    task = task_of(table, (15.0, 30.0), (50.0, 100.0, 200.0))
    best = replace(place.rank(task, spot(), draws=0).best, normal_force=100.0)
    study = place.control_study(task, spot(), best, 300.0)
    constant, *controlled = study.lines
    assert constant.law == "constant" and len(controlled) == 2
    assert min(line.energy for line in controlled) < constant.energy
    assert all(line.energies.max() <= 1 + 1e-9 for line in study.lines)
    assert np.all(study.scheduled_damping >= study.constant_damping - 1e-12)
    assert "After a release" in study.verdict and "In steady vibration" in study.verdict
    with pytest.raises(InputError, match="not a load"):
        place.control_study(task, spot(), best, 0.0)


def recipe() -> PlaceRecipe:
    from ema.tables import validated

    return validated(
        PlaceRecipe, RECIPE.replace("shortlist = 3", "shortlist = 1").replace("= 20", "= 0"), "r", KIND.tables
    )


def test_a_model_that_does_not_agree_places_only_anyway(tmp_path):
    from ema.place.job import place as placed
    from ema.place.job import refuse_disagreement
    from ema.report import write

    bare, geometry = bare_table()
    verdict = Verdict(False, ("Simulated over measured damping is 2.1.",))
    with pytest.raises(InputError, match="--anyway"):
        refuse_disagreement(verdict, "table")
    found = placed(recipe(), bare, geometry, verdict)
    assert found.warning.startswith("THE JOINT MODEL DOES NOT AGREE")
    page = write(found, tmp_path / "placement.html").read_text(encoding="utf-8")
    assert page.index("THE JOINT MODEL DOES NOT AGREE") < page.index("press every joint")


def test_a_worker_that_fails_is_told_and_nothing_is_lost(table, tmp_path):
    from concurrent.futures import Executor, Future

    class Broken(Executor):
        def submit(self, work, question):
            future = Future()
            future.set_exception(RuntimeError("gone"))
            return future

    task = task_of(table)
    with pytest.raises(FailureError, match="kept in"):
        place.verify(task, predict(task, spot()), np.array([0]), Broken(), place.KeptPlaces(tmp_path))
