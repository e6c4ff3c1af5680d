"""`ema simulate` as a shell sees it: table, pictures, store, status; the nouns it stores come back as they were."""

import inspect
import itertools
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from typer.testing import CliRunner

import acquisition
from ema import simulate, store
from ema.cli.app import app
from ema.data import BeamModel, Decay, HarmonicResponse, Loop, ModalMap, Response
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import beam, frf
from tests.golden_json import assert_keys

DATASETS = Path(__file__).parents[2] / "datasets"

SMALL = """
[model]
name = "small"
[structure]
kind = "double beam"
elements = 4
[[joints]]
normal_force = "200 N"
[law]
name = "masing"
friction_coefficient = 0.3
contact_stiffness = "1e9 N/m"
[damping]
ratio = "0.3 %"
[snapback]
load = "20 N"
at = "beam 2:4:+Z"
duration = "0.8 s"
[frf]
force = ["2 N", "4 N"]
at = "beam 2:4:+Z"
band = ["12 Hz", "22 Hz"]
lines = 25
[map]
force = ["2 N", "4 N"]
normal_force = ["50 N", "100 N"]
at = "beam 2:4:+Z"
band = ["14 Hz", "22 Hz"]
[loop]
amplitude = ["1 um", "3 um"]
"""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    (folder / "model.toml").write_text(SMALL)
    return folder


def ema(*arguments):
    return CliRunner().invoke(app, ["simulate", *map(str, arguments)])


def told(*arguments):
    done = ema(*arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_snapback_writes_response_ring_down_and_pictures(model, tmp_path):
    found = told("snapback", model, "--output", tmp_path, "--normal-force", 100, "--normal-force", 400)
    assert_keys("simulate snapback", found)
    assert [row["F_N"] for row in found["rows"]] == ["100 N", "400 N"]
    assert found["rows"][0]["f [Hz]"] == pytest.approx(16.7, abs=0.3)
    assert all(row["energy balance"] < 1e-6 for row in found["rows"])
    assert {Path(name).name for name in found["written"]} >= {
        "snapback.h5",
        "motion.png",
        "motion.svg",
        "contacts_100N.png",
    }
    held = store.load(tmp_path / "snapback.h5")
    assert isinstance(held["model"], BeamModel) and isinstance(held["response 100 N"], Response)
    assert isinstance(held["decay 100 N"], Decay)
    assert held["response 100 N"].displacements[0, 0] == pytest.approx(1e-3 * found["rows"][0]["x0 [mm]"])
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("normal_force", [300.0, 600.0, 1000.0, 1400.0])
@pytest.mark.usefixtures("undrawn")
def test_sliding_and_stuck_phase_are_shown_at_every_normal_force(tmp_path, normal_force):
    """Sliding frequency from the time between the first two zero crossings of the tip, unfiltered; the stuck frequency
    is that of the linear structure; slip ends where the books of the simulation say so. An amplitude that falls to
    exp(-fall) in half a cycle has the damping ratio fall / hypot(pi, fall): the median over the extremes between zero
    crossings, unfiltered."""
    (row,) = told("snapback", DATASETS / "double_beam", "--output", tmp_path, "--normal-force", normal_force)["rows"]
    run = store.load(tmp_path / "snapback.h5")[f"response {normal_force:g} N"]
    x, t = run.displacements[0], run.times
    crossings = t[np.flatnonzero(x[1:] * x[:-1] < 0)]
    assert row["f [Hz]"] == pytest.approx(0.5 / (crossings[1] - crossings[0]), rel=0.07)
    assert row["f stuck [Hz]"] == pytest.approx(31.583, rel=1e-3)
    assert row["zeta stuck [%]"] == pytest.approx(0.1, abs=0.02)
    friction = np.asarray(run.energy.friction)
    assert friction[t >= row["slip ends [s]"]][0] >= 0.999 * friction[-1]
    assert 0.5 <= row["cycles"] <= row["slip ends [s]"] * row["f [Hz]"] + 0.5
    edges = np.concatenate([[-1.0], crossings[: round(2 * row["cycles"]) + 1]])
    tops = [np.abs(x[(t > a) & (t <= b)]).max() for a, b in itertools.pairwise(edges)]
    fall = np.median(np.log(np.divide(tops[:-1], tops[1:])))
    assert row["zeta [%]"] == pytest.approx(100 * fall / np.hypot(np.pi, fall), rel=0.25)


@pytest.mark.parametrize("normal_force", [2000.0, 4000.0, 8000.0])
@pytest.mark.usefixtures("undrawn")
def test_slip_at_some_contacts_is_a_phase_too(tmp_path, normal_force):
    """More damping than the 0.1 % of the stuck structure, at a frequency between both."""
    (row,) = told("snapback", DATASETS / "double_beam", "--output", tmp_path, "--normal-force", normal_force)["rows"]
    assert 16.7 < row["f [Hz]"] < 31.7 and row["zeta [%]"] > 0.11 and row["slip ends [s]"] > 0.05
    assert row["f stuck [Hz]"] == pytest.approx(31.583, rel=1e-3)
    assert row["zeta stuck [%]"] == pytest.approx(0.1, abs=0.02)


@pytest.mark.usefixtures("undrawn")
def test_what_never_slips_has_a_stuck_phase_only_and_what_never_stops_a_sliding_one(tmp_path):
    double_beam = DATASETS / "double_beam"
    (stuck,) = told("snapback", double_beam, "--output", tmp_path, "--normal-force", 1e5)["rows"]
    assert stuck["f [Hz]"] is None and stuck["slip ends [s]"] is None and stuck["cycles"] is None
    assert stuck["f stuck [Hz]"] == pytest.approx(31.58, rel=1e-3)
    (sliding,) = told("snapback", double_beam, "--output", tmp_path, "--normal-force", 20)["rows"]
    assert sliding["slip ends [s]"] == pytest.approx(1.0, abs=0.05)
    assert sliding["f [Hz]"] == pytest.approx(16.7, rel=0.01) and sliding["f stuck [Hz]"] is None


@pytest.mark.usefixtures("undrawn")
def test_the_reference_mode_states_its_error_and_says_what_it_does_not_take(model, tmp_path):
    arguments = ["snapback", tmp_path, "--output", tmp_path / "out", "--reference", "--duration", "0.1"]
    (tmp_path / "model.toml").write_text(SMALL.replace('ratio = "0.3 %"', 'mass_factor = "0.3 1/s"'))
    (row,) = told(*arguments)["rows"]
    assert row["error estimate"] < 1e-6 and row["energy balance"] < 1e-9
    assert store.load(tmp_path / "out" / "snapback.h5")["response 200 N"].method.startswith("reference")
    (tmp_path / "model.toml").write_text(SMALL)
    done = ema(*arguments)
    assert done.exit_code == 2 and "mass-proportional damping only; got ratio 0.003" in done.stderr


@pytest.mark.usefixtures("undrawn")
def test_frf_map_and_loop(model, tmp_path):
    found = told("frf", model, "--output", tmp_path)
    assert_keys("simulate frf", found)
    rows = found["rows"]
    assert [row["F_E [N]"] for row in rows] == [2.0, 4.0] and all(row["solved"] == "25 of 25" for row in rows)
    steady = store.load(tmp_path / "frf.h5")["steady states 2 N, F_N 200 N"]
    assert isinstance(steady, HarmonicResponse) and steady.frequencies[-1] == 22.0
    found = told("map", model, "--output", tmp_path)
    assert_keys("simulate map", found)
    rows = found["rows"]
    chart = store.load(tmp_path / "map.h5")["map"]
    assert isinstance(chart, ModalMap) and rows[1]["zeta there [%]"] == pytest.approx(100 * chart.damping[1].max())
    found = told("loop", model, "--output", tmp_path)
    assert_keys("simulate loop", found)
    rows = found["rows"]
    assert rows[1]["energy per cycle [J]"] == pytest.approx(4 * 60.0 * (3e-6 - 60.0 / 1e9), rel=1e-3)
    loop = store.load(tmp_path / "loop.h5")["loop 3 µm, F_N 200 N"]
    assert isinstance(loop, Loop) and loop.area == rows[1]["energy per cycle [J]"]


def test_laws_are_listed_with_parameters_units_and_limits():
    """The list is that of what the constructors take: names, defaults, and limits that refuse."""
    done = ema("--laws")
    assert done.exit_code == 0
    listed = {law["name"]: law for law in json.loads(ema("--laws-json").stdout)}
    assert {"masing", "iwan", "bouc wen", "valanis", "lugre"} <= set(listed)
    for name, law in listed.items():
        make = getattr(simulate, law["constructor"].removeprefix("ema.simulate."))
        taken = inspect.signature(make).parameters
        assert name in done.output
        for one in law["parameters"]:
            assert one["name"] in taken and one["unit"] in ("-", "N s/m", "m/s") and one["meaning"] and one["limits"]
            assert one["name"] in done.output
            if one["default"] is not None:
                assert (
                    make(0.3, 1e8).parameters
                    and dict(make(0.3, 1e8).parameters)[one["name"].replace("_", " ")] == one["default"]
                )
                with pytest.raises(InputError):
                    make(0.3, 1e8, **{one["name"]: -5})
    assert listed["lugre"]["parameters"][3] == {
        "name": "stribeck_velocity",
        "unit": "m/s",
        "default": 1e-3,
        "limits": "above 0",
        "meaning": "at which F_S - F_C has fallen to 1/e of itself",
    }


def test_the_table_is_for_people(model, tmp_path):
    done = ema("loop", model, "--output", tmp_path, "--amplitude", 2e-6, "--normal-force", 150)
    assert done.exit_code == 0 and "energy per cycle" in done.output and "Written:" in done.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["snapback", "{empty}"], "there is no model here"),
        (["snapback", "{table}"], "the model file has no [snapback]"),
        (["loop", "{model}", "--amplitude", "-1"], "not an amplitude; got -1.0 m"),
        (["snapback", "{model}", "--normal-force", "-5"], "not a normal force; got -5.0 N"),
        (["frf", "{model}", "--force", "0"], "force = 0.0"),
        (["snapback", "{model}", "--load", "nan"], "not a load"),
        (["snapback", "{model}", "--duration", "0"], "duration = 0.0"),
        (["snapback", "{model}", "--duration", "1e9"], "the run does not fit the memory; got 5e+12 samples"),
        (["map", "{model}", "--normal-force", "nan"], "not a normal force"),
        (["loop", "{nowhere}"], "there is no model here"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(model, tmp_path, arguments, words):
    (tmp_path / "empty").mkdir()
    places = {
        "empty": tmp_path / "empty",
        "model": model,
        "nowhere": tmp_path / "nowhere",
        "table": DATASETS / "table_with_beam",
    }
    done = ema(*(argument.format(**places) for argument in arguments), "--output", tmp_path / "out")
    assert done.exit_code == 2 and words in done.stderr and len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("job", "old", "new", "words"),
    [
        ("snapback", "elements = 4", "elements = 0", "line 4: .*a beam needs elements; got 0"),
        (
            "snapback",
            "friction_coefficient",
            "friction_coeficient",
            "line 11: unknown key .*did you mean friction_coeff",
        ),
        ("snapback", '"200 N"', '"200 kg"', "line 8: .*normal_force: a mass is not"),
        ("snapback", "= 0.3", "= -0.3", "line 11: .*greater than or equal to 0; got -0.3"),
        ("snapback", '"1e9 N/m"', '"nan N/m"', "line 12: .*no number before the unit"),
        ("snapback", '"0.8 s"', '"-1 s"', "line 18: .*greater than 0; got '-1 s'"),
        ("snapback", '[[joints]]\nnormal_force = "200 N"\n', "", "the file lacks 'joints'"),
        ("frf", 'band = ["12 Hz", "22 Hz"]', 'band = ["22 Hz", "12 Hz"]', "not a band; got 22.0 to 12.0 Hz"),
        ("map", '["50 N", "100 N"]', "[]", r"line 26: .*normal_force: .*at least 1 item"),
        ("loop", '["1 um", "3 um"]', '["1 N"]', "line 30: .*amplitude"),
    ],
)
def test_bad_models_are_one_sentence_with_their_line(tmp_path, job, old, new, words):
    assert old in SMALL
    (tmp_path / "model.toml").write_text(SMALL.replace(old, new, 1))
    done = ema(job, tmp_path, "--output", tmp_path / "out")
    assert done.exit_code == 2 and re.search(words, done.stderr), done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


HOST = """
[model]
name = "imported"
[structure]
kind = "matrices"
mass = "mass.mtx"
stiffness = "stiffness.mtx"
dofs = "dofs.txt"
[beam]
kind = "beam"
length = "0.2 m"
width = "30 mm"
height = "5 mm"
elements = 4
[[joints]]
host_nodes = "3-7"
beam_nodes = "0-4"
half_heights = ["5 mm", "2.5 mm"]
normal_force = "1 kN"
normal_stiffness = "1e8 N/m"
[law]
name = "masing"
friction_coefficient = 0.2
contact_stiffness = "20 N/um"
[snapback]
load = "20 N"
at = "10:+Z"
duration = "0.01 s"
"""


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((0, 1), 1e9, "imported host: the stiffness matrix is not symmetric; got difference 1e+09"),
        ((0, 0), -1e11, "the stiffness matrix is not positive; got lowest eigenvalue -"),
        ((0, 0), np.nan, "stiffness.mtx: a number that is not finite"),
        ((slice(None), slice(None)), 0.0, "the structure is not held; got a rigid-body motion"),
    ],
    ids=["asymmetric", "indefinite", "NaN", "not held"],
)
def test_imported_matrices_that_are_no_structure(tmp_path, place, value, words):
    host = beam(Section(0.5, 0.04, 0.01, elements=10))
    stiffness = np.array(host.stiffness)
    stiffness[place] = value
    scipy.io.mmwrite(tmp_path / "mass.mtx", host.mass)
    scipy.io.mmwrite(tmp_path / "stiffness.mtx", stiffness, symmetry="general")
    (tmp_path / "dofs.txt").write_text("\n".join(map(str, host.dofs)))
    (tmp_path / "model.toml").write_text(HOST)
    done = ema("snapback", tmp_path, "--output", tmp_path / "out")
    assert done.exit_code == 2 and words in done.stderr, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.skipif(os.name != "posix", reason="a file where a folder is wanted, told by POSIX systems")
def test_a_place_that_cannot_be_written_is_told_before_the_work(model, tmp_path):
    (tmp_path / "file").write_text("")
    done = ema("loop", model, "--output", tmp_path / "file" / "out")
    assert done.exit_code == 3 and "the folder for the results cannot be used" in done.stderr
    assert "choose another one with --output" in done.stderr


@pytest.mark.usefixtures("undrawn")
def test_findings_decide_the_status(model, tmp_path):
    """Slips far beyond the spacing of the pairs: a warning."""
    arguments = ["snapback", model, "--output", tmp_path, "--load", 400_000]
    assert ema(*arguments).exit_code == 0
    assert ema(*arguments, "--limit", "warning").exit_code == 1


def test_models_and_results_come_back_from_the_store(tmp_path):
    for name in ("double_beam", "table_with_beam"):
        opened = acquisition.open_model(DATASETS / name)
        store.save(tmp_path / "model.h5", opened)
        held = store.load(tmp_path / "model.h5")
        assert isinstance(held, BeamModel)
        for part in ("host", "beam"):
            one, two = getattr(opened, part), getattr(held, part)
            assert np.array_equal(one.mass, two.mass) and np.array_equal(one.stiffness, two.stiffness)
            assert one.dofs == two.dofs
        for one, two in zip(opened.joints, held.joints, strict=True):
            assert replace(one, area_shares=None) == replace(two, area_shares=None)
        assert (held.damping, held.name, held.provenance) == (opened.damping, opened.name, opened.provenance)
    steady = frf(opened, np.array([470.0, 480.0]), 5.0, "table:0:+Z", ["table:0:+Z"])
    store.save(tmp_path / "steady.h5", steady)
    back = store.load(tmp_path / "steady.h5")
    for field in ("frequencies", "orders", "values", "slips", "input_power", "converged"):
        assert np.array_equal(getattr(steady, field), getattr(back, field))
    assert (back.driven, back.dofs, back.force) == (steady.driven, steady.dofs, steady.force)
