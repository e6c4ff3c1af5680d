"""What makes the bands of a forecast wide."""

from dataclasses import replace

import numpy as np
import pytest

from ema import place, shapes
from ema.data import FrictionLaw
from ema.data.forecast import Forecast
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.place.budget import ENOUGH, HARMONICS, REST, budget
from tests.unit.placement_rig import bare_table

BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02)
SPOT = Candidates(np.array([[0.3, 0.06]]), np.zeros(1), np.zeros(1, int), (BEAM,))
KNOWN = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045)


def test_shares_are_those_of_a_polynomial_in_closed_form():
    """y = 2 a + (b^2 - 1) + c d of normal numbers, and a harmonic of its own of 1: variances 4, 2, 1 and 1 of 8."""
    rng = np.random.default_rng(4)
    a, b, c, d, own, idle = rng.standard_normal((6, 4000))
    y = 2 * a + b**2 - 1 + c * d + own
    taken = [
        {
            "a": one[None, :1],
            "b": one[None, 1:2],
            "c and d": one[None, 2:4],
            "idle": one[None, 4:],
            "sure": np.ones((1, 1)),
        }
        for one in np.stack([a, b, c, d, idle], axis=1)
    ]
    ratios = np.exp(0.01 * np.stack([y, 3 * a], axis=1))[:, None, :, None, None]
    harmonics = np.array([0.01, 0.0])[None, :, None, None]
    names, shares = budget(taken, ratios, harmonics)
    assert names == ("a", "b", "c and d", "idle", HARMONICS, REST)
    # standard deviations of estimates from 4000 draws are 0.01 to 0.02
    assert shares[0, 0] == pytest.approx([4 / 8, 2 / 8, 0, 0, 1 / 8, 1 / 8], abs=0.05)
    assert shares[1, 0] == pytest.approx([1, 0, 0, 0, 0, 0], abs=0.01)


def test_few_draws_tell_nothing_and_draws_without_a_value_are_left_out():
    rng = np.random.default_rng(5)
    numbers = rng.standard_normal(200)
    taken = [{"a": np.array([[one]])} for one in numbers]
    ratios = np.exp(np.stack([numbers, numbers], axis=1))[:, None, :, None, None]
    ratios[::3] = np.nan
    names, shares = budget(taken, ratios, np.zeros((1, 2, 1, 1)))
    assert names == ("a", REST) and shares[:, 0] == pytest.approx(np.array([[1, 0], [1, 0]]))
    assert budget(taken[: ENOUGH - 1], ratios[: ENOUGH - 1], np.zeros((1, 2, 1, 1)))[0] == ()
    assert budget([{"a": np.ones((1, 1))}] * 200, ratios, np.zeros((1, 2, 1, 1)))[0] == ()


def test_many_columns_explain_no_noise():
    """Eight columns without any effect on the 60 draws: 8/59 of the variance by chance, taken off."""
    rng = np.random.default_rng(6)
    found = []
    for _ in range(100):
        taken = [{"idle": row[None]} for row in rng.standard_normal((60, 8))]
        ratios = np.exp(rng.standard_normal((60, 1, 2, 1, 1)))
        found.append(budget(taken, ratios, np.zeros((1, 2, 1, 1)))[1][:, 0, 0])
    # half of the estimates are below 0 and count as 0; their standard deviation is 0.08
    assert np.mean(found) < 0.06


@pytest.fixture(scope="module")
def task() -> place.Task:
    bare, geometry = bare_table(0.0)
    bare, _ = shapes.with_rigid_body(bare, geometry, 130.0)
    return place.Task(bare, shapes.smooth(bare, geometry), KNOWN, "91:+Z", np.array([30.0]), np.array([100.0]), (0,))


def told(task: place.Task, **uncertain: float) -> Forecast:
    joint = replace(KNOWN, **uncertain)
    return place.forecast(
        task._replace(joint=joint, force_levels=[30.0], normal_forces=[100.0]),
        SPOT,
        0,
        settings=place.ForecastSettings(draws=200, method="frozen"),
    )


def test_shares_are_those_of_forecasts_in_which_one_thing_alone_is_uncertain(task: place.Task):
    """Widths of the bands with friction alone, k_N alone and both; the bands of the two are of independent draws."""
    stated = {"friction_std": 0.03, "normal_std": 0.1}
    both = told(task, **stated).budget().set_index("source")
    alone = [told(task, **{name: value}) for name, value in stated.items()]
    for column, what in (("mode 1: f [%]", "frequency"), ("mode 1: zeta [%]", "damping")):
        widths = np.array([np.log(getattr(one, what + "_high") / getattr(one, what + "_low")).item() for one in alone])
        share = widths[0] ** 2 / np.sum(widths**2)
        found = both[column][["friction coefficient", "normal contact stiffness"]]
        assert found.iloc[0] / found.sum() == pytest.approx(share, abs=0.15)
