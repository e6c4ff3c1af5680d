"""`ema place` as a shell sees it: table, pictures, report, status, resumption, and questions it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from ema import store
from ema.cli.app import app
from ema.data import Placement
from ema.place import recipe as place_recipe
from tests.golden_json import assert_keys
from tests.unit.placement_rig import RECIPE, write_recipe

DATASETS = Path(__file__).parents[2] / "datasets"


def run(*arguments: str):
    return CliRunner().invoke(app, ["place", *arguments])


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("placement")
    recipe = write_recipe(folder)
    result = run(str(recipe), "--output", str(folder / "out"), "--json")
    return folder, recipe, result


def test_a_recipe_gives_a_place_a_normal_force_and_bounds(done):
    _folder, _recipe, result = done
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert_keys("place", told)
    assert told["warning"] == "" and told["candidates"] > 5 and told["checked"] >= 3
    best = told["places"][0]
    assert best["mode 1 zeta [%]"] > 1.3 * 0.638
    assert best["mode 1 zeta low [%]"] < best["mode 1 zeta [%]"] < best["mode 1 zeta high [%]"]
    assert "press every joint" in told["answer"] and told["control"] is None
    assert told["forecast"] == []
    assert {Path(path).name for path in told["written"]} >= {
        "placement.h5",
        "placement_map.png",
        "recommended_force.svg",
        "placement.html",
    }
    assert all(Path(path).stat().st_size > 1000 for path in told["written"])


def test_the_store_holds_what_was_found(done):
    folder, _recipe, result = done
    held = store.load(folder / "out" / "placement.h5")
    assert isinstance(held, Placement)
    best = held.ranking.best
    assert best.method == "all modes" and best.one_mode_damping is not None
    assert json.loads(result.stdout)["places"][0]["F_N [N]"] == best.normal_force
    assert np.all(np.diff([place.score for place in held.ranking.places]) <= 0)


def test_the_report_says_the_answer_and_carries_the_tables(done):
    folder, _recipe, _result = done
    page = (folder / "out" / "placement.html").read_text(encoding="utf-8")
    for words in ("Where the beam goes", "press every joint", "95 % of"):
        assert words in page
    table = (folder / "out" / "placement_tables" / "places.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) == 4 and table[0].startswith("Rank,x [m]")


@pytest.mark.usefixtures("undrawn")
def test_finished_places_are_kept_and_taken_up_again(done, monkeypatch):
    folder, recipe, first = done

    def fail(question):
        raise AssertionError("computed again")

    monkeypatch.setattr("ema.place.shortlist.answer", fail)
    again = run(str(recipe), "--output", str(folder / "out"), "--resume", "--json")
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["places"] == json.loads(first.stdout)["places"]
    anew = run(str(recipe), "--output", str(folder / "out"))
    assert anew.exit_code == 3 and "computed again" in anew.stderr


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_kept_place_is_computed_again(done):
    folder, recipe, first = done
    kept = sorted((folder / "out" / "checked").glob("*.npy"))
    kept[0].write_bytes(b"half")
    again = run(str(recipe), "--output", str(folder / "out"), "--resume", "--json")
    assert json.loads(again.stdout)["places"] == json.loads(first.stdout)["places"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("law", ["modified iwan", "rough contact", "valanis", "bouc wen"])
def test_every_law_that_depends_on_displacements_alone_is_placed(tmp_path, law):
    recipe = write_recipe(tmp_path, RECIPE.replace('name = "masing"', f'name = "{law}"', 1))
    assert place_recipe.load(recipe).bolted_joint().law.name == law
    result = run(str(recipe), "--output", str(tmp_path / "out"), "--json")
    assert result.exit_code == 0, result.output
    placement = store.load(tmp_path / "out" / "placement.h5")
    assert isinstance(placement, Placement)
    bare = placement.ranking.prediction.bare_damping
    assert np.all(np.isfinite(placement.best.damping)) and np.all(placement.best.damping > 0.9 * bare[:, None])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('step = "150 mm"', 'step = "150 mm"\nshortlst = 3', ("unknown key 'shortlst'", "did you mean shortlist")),
        ('spacing = "300 mm"', 'spacing = "1.3 m"', ("no place for the beam", "0.9 m x 0.5 m")),
        ('near = "499 Hz"', 'near = "600 Hz"', ("no mode near this frequency", "499.0")),
        ('at = "91:+Z"', 'at = "777:+Z"', ("not measured",)),
        ('force = ["15 N", "30 N"]', "force = [15]", ("without a unit",)),
        ('name = "masing"', 'name = "lugre"', ("no placement with the law",)),
        ('modes = "bare.h5"', "", ("names no structure",)),
        ('modes = "bare.h5"', 'modes = "gone.h5"', ("no such file",)),
        (
            "draws = 20",
            'draws = 20\nkeep_out = [[["0 m", "0 m"], ["0.9 m", "0 m"], ["0.9 m", "0.5 m"], ["0 m", "0.5 m"]]]',
            ("no place for the beam",),
        ),
    ],
)
def test_what_cannot_be_placed_is_refused_in_one_sentence(tmp_path, old, new, words):
    assert old in RECIPE
    result = run(str(write_recipe(tmp_path, RECIPE.replace(old, new, 1))), "--output", str(tmp_path / "out"))
    assert result.exit_code == 2
    for word in words:
        assert word in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_campaign_alone_says_too_little(tmp_path):
    result = run(str(DATASETS / "virtual_table_hammer"))
    assert result.exit_code == 2 and "joint law with normal forces" in result.stderr and "--recipe" in result.stderr


def test_a_cluster_that_is_not_there_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("ema.cli.cluster.WAIT", 1.0)
    recipe = write_recipe(tmp_path)
    result = run(str(recipe), "--output", str(tmp_path / "out"), "--cluster", "tcp://127.0.0.1:9")
    assert result.exit_code == 2 and "no cluster answers" in result.stderr


@pytest.mark.usefixtures("undrawn")
def test_a_model_file_with_a_map_is_a_question_already(tmp_path):
    result = run(
        str(DATASETS / "table_with_beam"), "--output", str(tmp_path), "--json", "--recipe", str(_short_recipe(tmp_path))
    )
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["places"][0]["mode 2 zeta [%]"] > 0.5


def _short_recipe(folder: Path) -> Path:
    text = RECIPE.replace('modes = "bare.h5"', "").replace('at = "91:+Z"', 'at = "0:+Z"')
    text = text.replace("shortlist = 3", "shortlist = 1").replace("draws = 20", "draws = 0")
    path = folder / "short.toml"
    path.write_text(text, encoding="utf-8")
    return path
