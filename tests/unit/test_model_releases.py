"""Releases of a model in a recipe, on two short beams pressed together at three contacts: limits known in closed form."""

from pathlib import Path

import numpy as np
import pytest

from ema.errors import InputError
from ema.study import model_releases, recipe, statements
from ema.study.recipe import ReleaseTable, StatementTable

MODEL = """
[model]
name = "two short beams"

[structure]
kind = "double beam"
length = "0.2 m"
width = "40 mm"
height = "5 mm"
youngs_modulus = "210 GPa"
density = "7850 kg/m^3"
elements = 3

[[joints]]
name = "interface"
normal_force = "1 kN"
normal_stiffness = "1e9 N/m"

[joints.law]
name = "masing"
friction_coefficient = 0.3
contact_stiffness = "1e8 N/m"
"""
SNAPBACK = """
[snapback]
load = "20 N"
at = "beam 2:3:+Z"
duration = "50 ms"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    home = tmp_path_factory.mktemp("models")
    for name, text in (("beams", MODEL + SNAPBACK), ("still", MODEL)):
        (home / name).mkdir()
        (home / name / "model.toml").write_text(text, encoding="utf-8")
    return home


@pytest.fixture(scope="module")
def released(folder):
    tables = [
        ReleaseTable(name="low", model="beams", normal_force=100, loops=[3]),
        ReleaseTable(name="high", model="beams", normal_force=1e6),
        ReleaseTable(name="rising", model="beams", normal_force=100, pressure="rising"),
    ]
    return tables, model_releases.simulated(folder, tables)


def statement(**keys) -> StatementTable:
    return StatementTable(**({"text": "t", "source": "s", "verdict": "matched", "release": "low"} | keys))


def test_without_slip_nothing_is_dissipated_and_friction_takes_no_energy(released):
    """1 MN holds every contact: no loop has an area, and the slip is the elastic one, F / k_T of each contact."""
    motion = released[1]["high"].fine
    areas = released[1]["high"].areas
    np.testing.assert_allclose(
        motion.forces, 1e8 * areas[:, None] * motion.slips, atol=1e-6 * np.abs(motion.forces).max()
    )
    table = statement(release="high", quantity="dissipation of first over last contact", high=1.0)
    (judged,) = statements.judge([table], (), (), released=released[1])
    assert judged.verdict == "not testable here" and "in which the contacts slip" in judged.reason


def test_the_loops_hold_the_energy_that_is_lost(released):
    table = statement(quantity="loop areas over energy lost", low=0.98, high=1.02)
    (judged,) = statements.judge([table], (), (), "the model", released=released[1])
    assert judged.verdict == "matched with an assumed parameter" and judged.reason == "the model"
    assert judged.lower <= judged.value <= judged.upper and judged.upper - judged.lower < 0.02
    assert judged.quantity == "loop areas over energy lost, model released, low"
    (loop,) = model_releases.loops(released[1], released[0])
    top = 0.3 * 100.0 * released[1]["low"].areas[2]
    assert loop.name == "low, contact 3" and np.abs(loop.forces).max() == pytest.approx(top, rel=1e-6)


def test_a_rising_pressure_keeps_its_sum_and_grows_with_the_number_of_the_contact(released):
    """The limits of the contacts: shares 1 : 2 : 1.5, for the last one has half the area, of mu F_N = 30 N."""
    limits = np.abs(released[1]["rising"].fine.forces).max(axis=1)
    np.testing.assert_allclose(limits, 30.0 * np.array([1.0, 2.0, 1.5]) / 4.5, rtol=1e-6)


def test_one_energy_integral_over_itself_is_one(released):
    table = statement(quantity="energy integral over release", other="low", high=1.0)
    measure = model_releases.measured(table, released[1])
    assert measure.value == 1.0 and measure.lower < 1.0 < measure.upper


def test_what_is_not_there_is_named(folder, released):
    with pytest.raises(InputError, match="no \\[snapback\\]"):
        model_releases.simulated(folder, [ReleaseTable(name="a", model="still", normal_force=1)])
    twice = [ReleaseTable(name="a", model="beams", normal_force=force) for force in (1e6, 2e6)]
    with pytest.raises(InputError, match="one name"):
        model_releases.simulated(folder, twice)
    with pytest.raises(InputError, match="no such contact"):
        model_releases.loops(released[1], [ReleaseTable(name="low", model="beams", normal_force=100, loops=[4])])
    with pytest.raises(InputError, match="not in the recipe"):
        model_releases.measured(statement(release="other", quantity="largest slip", high=1.0), released[1])


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"quantity": "damping", "high": 1.0}, "of the release of a model, and of nothing else"),
        ({"quantity": "largest slip", "high": 1.0, "release": "", "run": "r"}, "of the release of a model"),
        ({"quantity": "largest slip", "high": 1.0, "map": "m"}, "name one of them"),
    ],
)
def test_a_statement_is_about_one_thing(keys, said):
    with pytest.raises(ValueError, match=said):
        statement(**keys)


def test_the_recipe_refuses_a_pressure_that_it_does_not_know():
    with pytest.raises(InputError, match="pressure"):
        recipe.parse('campaign = "c"\n[[release]]\nname = "a"\nmodel = "m"\nnormal_force = 1\npressure = "falling"\n')
