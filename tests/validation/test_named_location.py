"""Forecasts at locations that are named, not recommended, against what OpenSeesPy computed there.

The truth of the blind table (``tests/validation/blind_table``) also has the beam at four other locations under 200 N.
"""

import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from ema import place
from ema.data.forecast import Forecast
from ema.place import recipe as recipes
from tests.validation.blind_table import prediction as blind


def rivals() -> list[dict]:
    """The answers of the truth at other locations than the one that the stored prediction recommends."""
    first = json.loads(blind.PREDICTION.read_text(encoding="utf-8"))["places"][0]
    true = json.loads((blind.HERE / "truth.json").read_text(encoding="utf-8"))
    return [one for one in true["answers"] if (one["column"], one["row"]) != (first["column"], first["row"])]


def forecasts(folder: Path) -> tuple[Forecast, ...]:
    """What is predicted there from the signals of the bare table."""
    spots = [((one["column"] * blind.PITCH[0] + 0.15), one["row"] * blind.PITCH[1]) for one in rivals()]
    locations = [place.Location(centre=spot, beam="steel 60 x 50") for spot in spots]
    modes, points = blind.bare_modes(blind.campaign(folder))
    return place.forecast_at(recipes.load(blind.RECIPE), modes, points, locations, normal_forces=[200.0])


@pytest.fixture(scope="module")
def predicted(tmp_path_factory) -> tuple[Forecast, ...]:
    """Computed in another process, whose functions are not watched as a test's are."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(forecasts, tmp_path_factory.mktemp("blind")).result()


def test_another_program_agrees_where_nothing_was_recommended(predicted):
    """Four locations at 15, 30 and 60 N: 24 values, of which 95 % bands hold 22 or more in 88 of 100 cases."""
    inside, errors = 0, []
    for one, answer in zip(predicted, rivals(), strict=True):
        assert answer["normal_force"] == 200.0 and answer["levels"] == one.force_levels.tolist()
        for name in ("frequency", "damping"):
            truth = np.array([part[name] for part in answer["resonances"]])
            low, value, high = (getattr(one, name + end)[0, :, 0] for end in ("_low", "", "_high"))
            inside += int(((low <= truth) & (truth <= high)).sum())
            errors += [] if name == "frequency" else np.abs(value / truth - 1).tolist()
    print(
        f"\n{inside} of 24 inside; errors of the damping ratio: median {np.median(errors):.3f}, most {max(errors):.3f}"
    )
    assert inside >= 22
    assert np.median(errors) < 0.03 and max(errors) < 0.1
