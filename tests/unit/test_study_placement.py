"""A study whose recipe holds the placement itself: its keys, its expectations, its forecast against the maps."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import MapResult, ModalMap
from ema.data.forecast import Forecast
from ema.errors import InputError
from ema.report.blocks import Book
from ema.report.forecast import forecast_blocks, verdict
from ema.study import expectations
from ema.study import placement as study_placement
from ema.study.recipe import parse
from tests.unit.friction_nouns import placement
from tests.unit.placement_rig import RECIPE

LEVELS, FORCES = np.array([10.0, 40.0]), np.array([50.0, 100.0])


def inline(extra: str = "") -> str:
    """A recipe of a study with the placement in its own tables."""
    text = RECIPE.replace('modes = "bare.h5"\n', "").replace('title = "Beam on the work table"\n', "")
    text = (
        text.replace("[[", "[[placement.")
        .replace("\n[", "\n[placement.")
        .replace("[placement.[placement.", "[[placement.")
    )
    return 'campaign = "c"\n\n[placement]\n' + text + extra


def told() -> Forecast:
    middle = np.array([[[500.0, 505.0], [498.0, 503.0]]])
    damping = np.array([[[0.01, 0.02], [0.015, 0.012]]])
    return Forecast(
        (0.4, 0.2),
        0.0,
        "steel 60 x 50",
        (1,),
        np.array([499.0]),
        np.array([0.00638]),
        LEVELS,
        FORCES,
        middle,
        middle - 1,
        middle + 1,
        damping,
        0.9 * damping,
        1.1 * damping,
        40,
    )


def measured(factor: float = 1.0, name: str = "mode 1") -> MapResult:
    forecast = told()
    chart = ModalMap(LEVELS, FORCES, forecast.frequency[0], factor * forecast.damping[0], name=name, method="measured")
    return MapResult(name, chart, np.zeros((0, 3)), np.zeros((0,)), np.zeros((0,)), np.full((2, 2), np.nan), (), ())


def test_the_tables_of_a_placement_stand_in_the_recipe():
    recipe = parse(inline('[placement.forecast]\nnormal_force = ["60 N"]\nmaps = ["mode 1"]\n'))
    assert recipe.placement.joint.law.friction_coefficient == 0.2 and recipe.placement.forecast.maps == ["mode 1"]
    assert parse('campaign = "c"\nplacement = "place.toml"\n').placement == "place.toml"


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (
            "[placement.forecast]\nnormal_forces = [1]\n",
            (r"unknown key 'normal_forces' in \[placement.forecast\]", "line 35", "did you mean normal_force"),
        ),
        (
            "[placement.expect]\ncenter = [1, 2]\n",
            (r"unknown key 'center' in \[placement.expect\]", "did you mean centre"),
        ),
        ('[placement.forecast]\nnormal_force = ["60 N"]\ndraws = 3\n', (r"placement.forecast.draws: ", "line 36")),
    ],
)
def test_a_wrong_key_is_told_with_its_table_and_line(extra, words):
    with pytest.raises(InputError) as error:
        parse(inline(extra))
    for word in words:
        assert error.match(word)


def test_a_forecast_is_held_against_the_maps_named():
    recipe = parse(inline('[placement.forecast]\nnormal_force = ["50 N"]\nmaps = ["mode 1"]\n')).placement
    placed = replace(placement(), forecast=told())
    found = study_placement.forecast_check(recipe, placed, [measured(), measured(2.0, "mode 3")])
    assert (found.inside, found.values) == (8, 8)
    with pytest.raises(InputError, match=r"a map that does not exist.*got mode 1, expected one of mode 3"):
        study_placement.forecast_check(recipe, placed, [measured(2.0, "mode 3")])
    assert study_placement.forecast_check("place.toml", placed, [measured()]) is None


def test_what_is_expected_of_a_placement():
    text = '[placement.expect]\ncentre = ["1 m", "0.4 m"]\nnormal_force = "123 N"\ninside = 7\n'
    recipe = parse(inline('[placement.forecast]\nnormal_force = ["50 N"]\nmaps = ["mode 1"]\n' + text)).placement
    placed = replace(placement(), forecast=told())
    checked = study_placement.forecast_check(recipe, placed, [measured(1.5)])
    found = expectations.of_placement(recipe, placed, checked)
    assert [one.met for one in found] == [True, True, True, False] and found[-1].found == 4
    assert expectations.of_placement("place.toml", placed, None) == ()
    far = parse(inline(text.replace("0.4 m", "0.6 m"))).placement
    assert [one.met for one in expectations.of_placement(far, placed, None)] == [True, False, True, False]


def test_the_report_says_how_many_values_lie_inside():
    recipe = parse(inline('[placement.forecast]\nnormal_force = ["50 N"]\nmaps = ["mode 1"]\n')).placement
    placed = replace(placement(), forecast=told())
    checked = study_placement.forecast_check(recipe, placed, [measured(1.5)])
    assert verdict(checked).startswith("4 of 8 measured values") and "fewer than" in verdict(checked)
    book = Book(png=False)
    forecast_blocks(checked, book)
    (table,) = book.tables
    assert len(table.rows) == 4 and table.columns[-1] == "inside" and {row[-1] for row in table.rows} == {"no"}
    assert {row[7] for row in table.rows} == {"yes"}
    forecast_blocks(told(), book)
    assert len(book.tables[1].columns) == 9
