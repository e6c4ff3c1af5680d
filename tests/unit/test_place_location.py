"""What a beam does at a location that a user names: as `ema place` forecasts its own, or a sentence why not."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ema import place, store
from ema.cli.app import app
from ema.data import Forecast, Geometry, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.place import recipe as recipes
from ema.place.job import place as placed
from tests.golden_json import assert_keys
from tests.unit.placement_rig import RECIPE, bare_table, write_recipe

FORECAST = (
    '\n[forecast]\nnormal_force = ["60 N", "180 N"]\ndraws = 12\nseed = 7\nmethod = "frozen"\ncalibration_std = "1 %"\n'
)
BANDS = tuple(what + end for what in ("frequency", "damping") for end in ("", "_low", "_high"))
TABLE = (
    RECIPE.replace("shortlist = 3", "shortlist = 1").replace("keep = 3", "keep = 1").replace("draws = 20", "draws = 5")
)


def run(*arguments: object):
    return CliRunner().invoke(app, ["predict", *map(str, arguments)])


def loaded(folder: Path, text: str) -> recipes.PlaceRecipe:
    path = folder / "place.toml"
    path.write_text(text, encoding="utf-8")
    return recipes.load(path)


@pytest.fixture(scope="module")
def placement(tmp_path_factory):
    """A recipe, and the placement with its forecast."""
    folder = tmp_path_factory.mktemp("placement")
    path = write_recipe(folder, TABLE + FORECAST)
    return path, placed(recipes.load(path), *bare_table(0.02))


def test_at_the_recommended_location_it_is_the_forecast_of_the_placement(placement):
    path, answer = placement
    best = answer.forecast
    here = place.Location(centre=best.centre, angle=best.angle)
    (same,) = place.forecast_at(
        recipes.load(path), *bare_table(0.02), [here], force_levels=best.force_levels, normal_forces=best.normal_forces
    )
    assert same.draws == 12 and same.beam == "steel 60 x 50"
    for name in BANDS:
        assert np.array_equal(getattr(same, name), getattr(best, name)), name


def test_the_command_gives_it_from_texts_with_units_and_stores_it(placement, tmp_path):
    path, answer = placement
    best = answer.forecast
    x, y = best.centre
    forces = [f"--normal-force={force!r} N" for force in best.normal_forces.tolist()]
    levels = [f"--force={1e-3 * level!r} kN" for level in best.force_levels.tolist()]
    words = ("--place", f"{1e3 * x!r} mm, {y!r} m, {float(np.degrees(best.angle))!r} deg", *forces, *levels)
    result = run(path, *words, "--beam", "steel 60 x 50", "--output", tmp_path, "--json")
    assert result.exit_code == 0, result.output
    spoken = json.loads(result.stdout)
    assert_keys("predict place", spoken)
    (mode,) = spoken["forecasts"][0]["modes"]
    assert mode["without_beam"]["frequency"][1] == pytest.approx(499.0)
    stored = store.load(tmp_path / "place_prediction.h5")
    assert isinstance(stored["bare"], ModalModel) and isinstance(stored["forecast_1"], Forecast)
    for name in BANDS:
        assert np.allclose(getattr(stored["forecast_1"], name), getattr(best, name), rtol=1e-7), name
    condition = next(one for one in mode["conditions"] if (one["force"], one["normal_force"]) == (30.0, 180.0))
    level, force = list(best.force_levels).index(30.0), list(best.normal_forces).index(180.0)
    assert condition["damping"][0] == pytest.approx(best.damping_low[0, level, force], rel=1e-7)
    rows = list(csv.DictReader((tmp_path / "place_prediction.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == len(mode["conditions"]) == best.damping[0].size
    (row,) = (one for one in rows if (float(one["force_N"]), float(one["normal_force_N"])) == (30.0, 180.0))
    assert float(row["frequency_Hz_high"]) == pytest.approx(best.frequency_high[0, level, force], rel=1e-7)
    assert float(row["bare_damping_value"]) == pytest.approx(0.00638)
    assert (tmp_path / "place_forecast_1.png").stat().st_size > 1000


def twisting() -> tuple[ModalModel, Geometry]:
    """A plate of 0.6 m x 0.4 m that twists in its first mode, with node lines at y = 0 and x = 0, and bends above.

    Its corners move in the first mode alone, so that no other mode has a part in their response.
    """
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(-0.3, 0.3, 7), np.linspace(-0.2, 0.2, 5)))
    shapes = np.stack([x * y, x**2 - 0.09, y**2 - 0.04], axis=1) * np.array([8.0, 20.0, 40.0])
    dofs = tuple(Dof(node, "+Z") for node in range(1, len(x) + 1))
    poles = poles_from(np.array([200.0, 340.0, 610.0]), np.array([0.004, 0.005, 0.006]))
    values = shapes.astype(complex)
    model = ModalModel(poles, values, dofs, values / (2j * poles.imag), dofs, scaling="unit modal mass", name="plate")
    return model, Geometry(np.arange(1, len(x) + 1), np.stack([x, y, 0 * x], axis=1))


PLATE = """
near = "200 Hz"
at = "1:+Z"
in_plane = "held"
force = "20 N"
normal_force = "80 N"
[[beams]]
name = "slim"
spacing = "200 mm"
width = "20 mm"
height = "10 mm"
[[beams]]
name = "long"
spacing = "550 mm"
overhang = "40 mm"
width = "20 mm"
height = "10 mm"
[joint]
surface_height = "5 mm"
normal_stiffness = "1e8 N/m"
friction_std = "10 %"
stiffness_std = "20 %"
height_std = "1 mm"
[joint.law]
name = "masing"
friction_coefficient = 0.2
contact_stiffness = "2e7 N/m"
[search]
keep_out = [[["-0.3 m", "0.15 m"], ["-0.2 m", "0.15 m"], ["-0.2 m", "0.2 m"], ["-0.3 m", "0.2 m"]]]
[forecast]
normal_force = "80 N"
draws = 20
"""


def test_joints_on_a_node_line_change_nothing(tmp_path):
    """Neither deflection nor slope along the beam: the beam does not feel the mode (closed form: f and zeta stay)."""
    recipe, (model, geometry) = loaded(tmp_path, PLATE), twisting()
    on, across = (place.Location(centre=(0.0, 0.0), angle=angle, beam="slim") for angle in (0.0, np.pi / 4))
    on_line, twisted = place.forecast_at(recipe, model, geometry, [on, across], force_levels=[20.0, 200.0])
    for name in BANDS:
        bare = 200.0 if name.startswith("f") else 0.004
        assert getattr(on_line, name) == pytest.approx(np.full((1, 2, 1), bare), rel=1e-9), name
    assert np.all(twisted.frequency_high < 199.9)


def test_a_condition_says_the_same_alone_and_among_others(tmp_path):
    recipe, (model, geometry) = loaded(tmp_path, PLATE), twisting()
    here = place.Location(centre=(0.05, 0.1), angle=0.3, beam="slim")
    (alone,) = place.forecast_at(recipe, model, geometry, [here], force_levels=[20.0], normal_forces=[80.0])
    (among,) = place.forecast_at(recipe, model, geometry, [here], force_levels=[40.0, 20.0], normal_forces=[40.0, 80.0])
    assert among.force_levels.tolist() == [20.0, 40.0]
    for name in BANDS:
        assert getattr(among, name)[0, 0, 1] == pytest.approx(getattr(alone, name)[0, 0, 0], rel=1e-4), name


def test_how_far_outside_the_recipe_is_a_finding(tmp_path):
    recipe, (model, geometry) = loaded(tmp_path, PLATE.replace('"80 N"', '["40 N", "160 N"]', 1)), twisting()
    here = place.Location(centre=(0.0, 0.1), beam="long")
    (result,) = place.forecast_at(recipe, model, geometry, [here], force_levels=[20.0], normal_forces=[20.0, 400.0])
    outside = [one for one in result.findings if one.code == "outside-recipe"]
    assert [one.value for one in outside] == pytest.approx([2.5, 2.0])
    assert "400 N lies above" in outside[0].message and "20 N lies below" in outside[1].message
    (beyond,) = (one for one in result.findings if one.code == "beam-sticks-out")
    assert beyond.value == pytest.approx(0.015) and beyond.where == "long at (0, 0.1) m, 0 deg"
    (inside,) = place.forecast_at(recipe, model, geometry, [here], force_levels=[20.0], normal_forces=[40.0, 160.0])
    assert "outside-recipe" not in {one.code for one in inside.findings}


@pytest.mark.parametrize(
    ("location", "words"),
    [
        ({"centre": (0.0, 0.3), "beam": "slim"}, "off the measured structure"),
        ({"centre": (0.25, 0.1), "beam": "slim"}, "sticks out with its joints; got a joint 0.05 m beyond"),
        ({"centre": (np.nan, 0.1), "beam": "slim"}, "off the measured structure"),
        ({"centre": (-0.15, 0.145), "beam": "slim"}, "overlaps an area that is kept free; got keep_out 1"),
        ({"centre": (0.0, 0.1), "beam": "wide"}, "no such beam; got wide, expected one of slim, long"),
        ({"centre": (0.0, 0.1)}, "which beam is to be bolted there"),
    ],
)
def test_a_location_that_cannot_be_is_refused(tmp_path, location, words):
    with pytest.raises(InputError, match=words):
        place.forecast_at(loaded(tmp_path, PLATE), *twisting(), [place.Location(**location)])


def test_a_beam_beside_an_area_kept_free_is_not_refused(tmp_path):
    """Its edge is 1 mm away: half its width of 10 mm from y = 0.139 m ends at 0.149 m, the area begins at 0.150 m."""
    (result,) = place.forecast_at(
        loaded(tmp_path, PLATE), *twisting(), [place.Location(centre=(-0.15, 0.139), beam="slim")]
    )
    assert np.isfinite(result.damping).all()


def test_modes_with_a_beam_on_and_no_location_are_refused(tmp_path):
    from ema.data import Condition, JointForce

    recipe, (model, geometry) = loaded(tmp_path, PLATE), twisting()
    with pytest.raises(InputError, match="no location for a beam"):
        place.forecast_at(recipe, model, geometry, [])
    worn = replace(model, condition=Condition(joints=(JointForce("J1", 100.0),)))
    with pytest.raises(InputError, match="measured with a friction beam"):
        place.forecast_at(recipe, worn, geometry, [place.Location(centre=(0.0, 0.1), beam="slim")])


HERE = ("--place", "0.45 m, 0.25 m, 0 deg")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--place", "0.45 m, 0.25 m"), "not a location of a beam"),
        (("--place", "0.45, 0.25 m, 0 deg"), "without a unit"),
        (("--place", "0.45 m, 0.25 N, 0 deg"), "not a displacement"),
        (("--place", "0.45 m, 0.25 m, 90"), "without a unit"),
        (("--place", "0.45 m, 0.75 m, 0 deg"), "off the measured structure"),
        ((*HERE, "--beam", "oak"), "no such beam"),
        ((*HERE, "--normal-force", "80"), "without a unit"),
        ((*HERE, "--normal-force", "-80 N"), "not normal forces"),
        ((*HERE, "--force", "0 N"), "not force levels"),
        ((*HERE, "--amplitude", "1 m/s^2"), "what is to be predicted?"),
        (("--beam", "steel 60 x 50", "--force", "20 N"), "what is to be predicted?"),
    ],
)
def test_what_cannot_be_asked_is_one_sentence(tmp_path, arguments, words):
    result = run(write_recipe(tmp_path, TABLE), *arguments, "--output", tmp_path / "out")
    assert result.exit_code == 2 and words in result.stderr, result.output
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_stored_placement_asks_for_its_recipe(placement, tmp_path):
    path = tmp_path / "placement.h5"
    store.save(path, placement[1])
    result = run(path, *HERE)
    assert result.exit_code == 2 and "keeps the answer of a placement" in result.stderr
    assert "give the recipe" in result.stderr


def test_modes_of_a_file_and_several_locations_in_words(tmp_path):
    recipe = write_recipe(tmp_path, TABLE + FORECAST)
    words = (*HERE, "--place", "0.45 m, 0.06 m, 0 deg", "--normal-force", "500 N", "--force", "20 N")
    result = run(tmp_path / "bare.h5", "--recipe", recipe, *words, "--output", tmp_path / "out")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].startswith("steel 60 x 50 at (0.45, 0.25) m, 0 deg: 95 % bands from 12 draws; f and damping by")
    assert sum(line.startswith("  mode 1, F_E 20 N, F_N 500 N: ") for line in lines) == 2
    assert any("500 N lies above the range of the recipe, 60 to 240 N, by a factor of 2.08" in line for line in lines)
    assert "F_E and F_N lie within" not in result.stdout


def test_readings_of_tests_that_have_been_done_are_named(tmp_path):
    done = '[[trials.done]]\nforce = "20 N"\nnormal_force = "80 N"\ndamping = ["1 %"]\n'
    recipe, (model, geometry) = loaded(tmp_path, PLATE + done), twisting()
    (result,) = place.forecast_at(recipe, model, geometry, [place.Location(centre=(0.0, 0.1), beam="slim")])
    assert "readings-not-used" in {one.code for one in result.findings}


STUDY = """campaign = "plate.h5"
[fit]
band = [150, 700]
[placement]
near = "200 Hz"
at = "1:+Z"
in_plane = "held"
force = "20 N"
normal_force = "80 N"
beams = [{name = "slim", spacing = "200 mm", width = "20 mm", height = "10 mm"}]
[placement.joint]
surface_height = "5 mm"
normal_stiffness = "1e8 N/m"
law = {name = "masing", friction_coefficient = 0.2, contact_stiffness = "2e7 N/m"}
[placement.forecast]
normal_force = "80 N"
draws = 10
"""


def test_a_study_that_was_not_run_says_what_to_do(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    result = run(path, "--place", "0 m, 0 m, 0 deg")
    assert result.exit_code == 2 and "was not run yet" in result.stderr and "`ema run" in result.stderr
