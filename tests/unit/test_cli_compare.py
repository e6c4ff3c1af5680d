"""`ema compare` as a shell sees it: verdict, status, table, picture and store."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import acquisition
from ema import store
from ema.cli.app import app
from ema.data import Geometry, MapComparison, MapPrediction, ModalModel, ModeComparison, ModelUpdate
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.simulate import damping_map
from tests.golden_json import assert_keys

MODEL = """
[model]
name = "small"
[structure]
kind = "double beam"
elements = 2
[[joints]]
normal_force = "200 N"
[law]
name = "masing"
friction_coefficient = 0.3
contact_stiffness = "2e7 N/m"
[damping]
ratio = "0.6 %"
[map]
force = ["0.5 N", "1 N", "2 N"]
normal_force = ["30 N", "100 N", "300 N"]
at = "beam 2:2:+Z"
output = "beam 1:2:+Z"
band = ["14 Hz", "60 Hz"]
"""


def call(*words):
    return CliRunner().invoke(app, ["compare", *(str(word) for word in words)])


def modes(frequencies):
    x = np.arange(1, 9) / 9
    shapes = np.array([np.sin(np.pi * n * x) for n in (1, 2)]).T.astype(complex)
    dofs = tuple(Dof(n, "+Z") for n in range(1, 9))
    return ModalModel(poles_from(np.array(frequencies), np.array([0.01, 0.01])), shapes, dofs, shapes[:1], dofs[:1])


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The model file, to be read."""
    path = tmp_path_factory.mktemp("model") / "model.toml"
    path.write_text(MODEL)
    return path


def simulated(model, levels, forces):
    """Map of the structure: another mu than that of the model."""
    held = acquisition.open_model(model)
    truth = held.with_law(replace(held.joints[0].law, friction_coefficient=0.2))
    return damping_map(truth, levels, forces, "beam 2:2:+Z", "beam 1:2:+Z", (14.0, 60.0))


@pytest.fixture(scope="module")
def measured(model):
    """The file of a map, to be read."""
    chart = simulated(model, [0.5, 2.0], [30.0, 120.0, 240.0])
    path = model.with_name("map.h5")
    store.save(path, replace(chart, damping_std=0.01 * chart.damping, frequency_std=1e-4 * chart.frequency))
    return path


def test_two_files_of_modes(tmp_path):
    store.save(tmp_path / "a.h5", modes([10.0, 40.0]))
    store.save(tmp_path / "b.h5", modes([10.1, 40.2]))
    store.save(tmp_path / "c.h5", modes([14.0, 40.2]))
    good = call(tmp_path / "a.h5", tmp_path / "b.h5", "--output", tmp_path / "good")
    assert good.exit_code == 0, good.output
    assert "The model agrees." in good.output
    assert isinstance(store.load(tmp_path / "good/comparison.h5")["comparison"], ModeComparison)
    assert (tmp_path / "good/modes.csv").read_text().count("\n") == 3
    page = (tmp_path / "good/comparison.html").read_text(encoding="utf-8")
    assert page.index("In short") < page.index("The model agrees.") < page.index("<h2>Modes compared")
    bad = call(tmp_path / "a.h5", tmp_path / "c.h5", "--output", tmp_path / "bad", "--json")
    assert bad.exit_code == 1
    told = json.loads(bad.output)
    assert_keys("compare modes", told)
    assert told["agrees"] is False
    assert told["tables"]["modes"][0]["MAC"] == pytest.approx(1)


def test_modes_of_a_test_against_those_of_a_finite_element_model(tmp_path):
    """Ten points of the solved plate, in millimetres, along other axes and numbered anew."""
    plate = Path(__file__).parents[1] / "formats" / "l_plate.frd"
    contents = acquisition.read(plate, unit="m")
    (solved,) = contents.modes
    rows = np.array([0, 4, 9, 12, 30, 44, 61, 70, 88, 94])
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    nodes = np.arange(201, 211)
    shapes = np.einsum("ab,nbm->nam", turn, solved.shapes.reshape(190, 3, -1)[rows]).reshape(30, -1)
    dofs = tuple(Dof(int(node), direction) for node in nodes for direction in ("+X", "+Y", "+Z"))
    measured = ModalModel(solved.poles, shapes, dofs, np.zeros((0, 6), complex), (), scaling="unscaled")
    store.save(tmp_path / "test.h5", measured)
    points = Geometry(nodes, contents.geometry.xyz[rows] @ turn.T)
    acquisition.write(tmp_path / "points.unv", points)
    ended = call(
        tmp_path / "test.h5", plate, "--geometry", tmp_path / "points.unv", "--output", tmp_path / "out", "--json"
    )
    assert ended.exit_code == 0, ended.output
    table = json.loads(ended.output)["tables"]["modes"]
    assert [row["MAC"] for row in table] == pytest.approx([1.0] * 6, abs=1e-3)
    lost = call(tmp_path / "test.h5", plate, "--geometry", tmp_path / "test.h5")
    assert lost.exit_code == 2 and "no points in this file" in lost.output
    without = call(tmp_path / "test.h5", plate)
    assert without.exit_code == 2


def test_a_map_against_a_model_before_and_after_an_update(measured, model, tmp_path):
    before = call(measured, model, "--output", tmp_path / "before")
    assert before.exit_code == 1, before.output
    assert "The model does not agree." in before.output
    # in a process of its own, which spares the search the shape checker
    command = [Path(sys.executable).with_name("ema"), "compare", measured, model, "--update", "friction_coefficient"]
    after = subprocess.run([*command, "--output", tmp_path / "after", "--json"], capture_output=True, text=True)
    assert after.returncode == 0, after.stdout + after.stderr
    told = json.loads(after.stdout)
    assert_keys("compare map", told)
    (row,) = told["tables"]["parameters"]
    assert row["value"] == pytest.approx(0.2, rel=0.02)
    assert row["low"] < row["value"] < row["high"]
    kept = store.load(tmp_path / "after/comparison.h5")
    assert isinstance(kept["update"], ModelUpdate)
    assert isinstance(kept["comparison"], MapComparison)
    assert kept["model"].joints[0].law.friction_coefficient == pytest.approx(row["value"])
    assert (tmp_path / "after/map_comparison.png").stat().st_size > 10_000
    page = (tmp_path / "after/comparison.html").read_text(encoding="utf-8")
    assert "Identified: friction_coefficient 0.2" in page and "Best F_N of the model [N]" in page
    points = (tmp_path / "after/comparison_tables/points.csv").read_text(encoding="utf-8").splitlines()
    assert len(points) == 1 + 2 * 3
    check_prediction(tmp_path / "after/comparison.h5", model, tmp_path / "predicted")


def check_prediction(compared, model, folder):
    """At a level and a normal force between those of the map and one beyond, against the structure itself."""
    words = [compared, "--model", model, "--force", "0.8 N", "--normal-force", "0.15 kN", "--normal-force", "400 N"]
    command = [Path(sys.executable).with_name("ema"), "predict", *words, "--output", folder, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads(done.stdout)
    stored = store.load(folder / "small_prediction.h5")
    assert sorted(stored) == ["map", "prediction", "update"]
    kept = stored["prediction"]
    assert kept.normal_forces.tolist() == [150.0, 400.0] and isinstance(kept, MapPrediction)
    truth = simulated(model, [0.8], [150.0, 400.0])
    for point, f, zeta in zip(told["points"], truth.frequency[0], truth.damping[0], strict=True):
        assert point["frequency"][0] < f < point["frequency"][2]
        assert point["damping"][0] < zeta < point["damping"][2]
        assert point["damping"][1] == pytest.approx(zeta, rel=0.05)
    assert "normal force" in told["statement"]
    assert len(list(folder.glob("*.png"))) == 1


def test_two_maps(measured, tmp_path):
    same = call(measured, measured, "--output", tmp_path / "same")
    assert same.exit_code == 0, same.output


def test_bad_input_is_one_sentence(measured, model, tmp_path):
    store.save(tmp_path / "a.h5", modes([10.0, 40.0]))
    bare = tmp_path / "bare.toml"
    bare.write_text(MODEL[: MODEL.index("[map]")])
    for words, said in (
        ((tmp_path / "none.h5", model), "no such file"),
        ((tmp_path / "a.h5", measured), "modes cannot be compared with a map"),
        ((tmp_path / "a.h5", model), "a model file is compared with a map"),
        ((measured, bare), "the model file has no [map]"),
        ((measured, measured, "--update", "exponent"), "only a model file has parameters"),
        ((measured, model, "--update", "mu"), "an unknown parameter"),
    ):
        ended = call(*words, "--output", tmp_path / "out")
        assert ended.exit_code == 2, ended.output
        assert said in " ".join(ended.output.split())


def test_a_prediction_without_an_updated_model_is_one_sentence(measured, model, tmp_path):
    at = ("--force", "1 N", "--normal-force", "100 N")
    for words, said in (
        ((measured, "--model", model, *at), "no updated model with its map"),
        ((tmp_path / "none.h5", "--model", model, *at), "no such file"),
        ((measured, "--model", model), "what is to be predicted?"),
        ((measured,), "what is to be predicted?"),
        ((measured, "--amplitude", "1 m/s^2", *at), "what is to be predicted?"),
        ((measured, "--amplitude", "1 m/s^2"), "not a mode over its amplitude"),
    ):
        ended = CliRunner().invoke(app, ["predict", *(str(word) for word in words)])
        assert ended.exit_code == 2, ended.output
        assert said in " ".join(ended.output.split())
