"""What a placed beam will do, with bands, and whether a measurement falls inside them."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest

from ema import place, shapes, simulate, store
from ema.data import FrictionLaw, ModalMap
from ema.data.forecast import Forecast, ForecastCheck
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.errors import InputError
from ema.place.forecast_findings import about_harmonics
from ema.place.fundamental import fundamental
from ema.place.predictor import predict
from ema.place.shortlist import answer, question
from ema.place.task import only
from tests.unit.placement_rig import bare_table

BEAM = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02, name="steel 60 x 50")
JOINT = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045, friction_std=0.1, stiffness_std=0.2)
SPOT = Candidates(np.array([[0.45, 0.25], [0.3, 0.06]]), np.zeros(2), np.zeros(2, int), (BEAM,))
LEVELS, FORCES = (20.0, 40.0), (60.0, 120.0)


@pytest.fixture(scope="module")
def task() -> place.Task:
    bare, geometry = bare_table(0.02)
    bare, _ = shapes.with_rigid_body(bare, geometry, 130.0)
    surface = shapes.smooth(bare, geometry)
    return place.Task(bare, surface, JOINT, "91:+Z", np.array(LEVELS), np.array(FORCES), (0,))


@pytest.fixture(scope="module")
def pool():
    """Another process, whose functions are not watched as those of a test are."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as held:
        yield held


@pytest.fixture(scope="module")
def told(task, pool) -> Forecast:
    return place.forecast(
        task,
        SPOT,
        1,
        settings=place.ForecastSettings(draws=24, seed=5, method="frozen"),
        executor=pool,
    )


def chart(damping: np.ndarray, frequency: np.ndarray, levels=LEVELS, forces=FORCES, name="mode 1") -> ModalMap:
    return ModalMap(np.array(levels), np.array(forces), frequency, damping, name=name, method="measured")


def test_the_middle_is_the_full_model_and_lies_in_its_band(task, told):
    model = place.model_at(task, SPOT, 1, 60.0)
    band = (float(told.frequency.min()) - 10, float(told.frequency.max()) + 10)
    truth = simulate.damping_map(model, np.array(LEVELS), np.array(FORCES), "91:+Z", "91:+Z", band, 1e-2)
    assert np.allclose(told.damping[0], truth.damping, rtol=2e-2)
    assert np.allclose(told.frequency[0], truth.frequency, rtol=1e-4)
    assert np.all((told.damping_low < told.damping) & (told.damping < told.damping_high))
    assert np.all((told.frequency_low < told.frequency) & (told.frequency < told.frequency_high))
    assert told.modes == (1,) and told.bare_frequencies == pytest.approx([499.0]) and told.beam == BEAM.name
    assert len(told.table()) == 4 and told.table()["zeta [%]"].iloc[0] == pytest.approx(100 * told.damping[0, 0, 0])


def test_the_band_is_that_of_the_draws(task, told, pool):
    """A joint that is better known gives a narrower band; the same seed the same one."""
    better = task._replace(joint=replace(JOINT, friction_std=0.01, stiffness_std=0.02))
    narrow = place.forecast(
        better,
        SPOT,
        1,
        settings=place.ForecastSettings(draws=24, seed=5, method="frozen"),
        executor=pool,
    )
    wide, small = (np.log(one.damping_high / one.damping_low).mean() for one in (told, narrow))
    assert small < 0.5 * wide
    again = place.forecast(
        task,
        SPOT,
        1,
        settings=place.ForecastSettings(draws=24, seed=5, method="frozen"),
        executor=pool,
    )
    assert np.array_equal(again.damping_high, told.damping_high)


def test_scatter_between_the_joints_widens_the_band(task, pool):
    """Uneven joints do what a common error of both does not: at the ridge the band opens."""
    sure = replace(JOINT, friction_std=0.0, stiffness_std=0.0)
    even, uneven = (
        place.forecast(
            task._replace(joint=joint),
            SPOT,
            1,
            settings=place.ForecastSettings(draws=12, seed=5, method="frozen"),
            executor=pool,
        )
        for joint in (sure, replace(sure, scatter=0.1))
    )
    widths = [np.log(one.damping_high / one.damping_low).mean() for one in (even, uneven)]
    assert widths[1] > 1.3 * widths[0]
    assert np.array_equal(even.damping, uneven.damping)


def test_a_truth_drawn_from_the_same_doubt_falls_inside(task, told):
    """Of 12 tables with other friction and stiffness, 24 to 48 values each lie in their bands as often as promised."""
    rng, inside = np.random.default_rng(11), 0
    for _ in range(12):
        law = replace(
            JOINT.law,
            friction_coefficient=0.2 * np.exp(0.1 * rng.standard_normal()),
            contact_stiffness=2e8 * np.exp(0.2 * rng.standard_normal()),
        )
        model = place.model_at(task._replace(joint=replace(JOINT, law=law)), SPOT, 1, 60.0)
        band = (float(told.frequency.min()) - 12, float(told.frequency.max()) + 12)
        truth = simulate.damping_map(model, np.array(LEVELS), np.array(FORCES), "91:+Z", "91:+Z", band, 1e-2)
        found = place.check(told, [replace(truth, name="mode 1")])
        assert found.values == 8
        inside += found.inside
    assert inside >= 0.85 * 96


def test_bands_hold_what_the_upper_harmonics_change(task, pool):
    """All parameters certain: against the two answers of one question, with all harmonics and with the first alone."""
    sure = task._replace(
        joint=replace(JOINT, friction_std=0.0, stiffness_std=0.0),
        surface=replace(task.surface, covariance=0 * task.surface.covariance, noise=0 * task.surface.noise),
    )
    bands = place.forecast(
        sure,
        SPOT,
        1,
        settings=place.ForecastSettings(draws=200, seed=3, method="frozen"),
        executor=pool,
    )
    asked = sure._replace(force_levels=np.array(LEVELS), normal_forces=np.array(FORCES))
    here = only(SPOT, [1])
    one = question(asked, predict(asked, here), 0)
    effect = np.abs(np.log(answer(one)[:, :2] / fundamental(one)[:, :2]))
    for column, (low, high) in enumerate(
        ((bands.frequency_low, bands.frequency_high), (bands.damping_low, bands.damping_high))
    ):
        # quantiles of 200 draws scatter by 6 %; the damping of the suspension is drawn as well
        assert np.all(np.log(high / low) / 2 > 0.7 * 1.96 * effect[:, column])
    assert effect[:, 1].max() > 0.005


def test_strong_upper_harmonics_are_named():
    (found,) = about_harmonics(np.array([[[0.02, 0.08], [0.051, 0.0]]]))
    assert found.code == "upper-harmonics" and found.value == pytest.approx(0.08) and "in 2 of 4" in found.message
    assert about_harmonics(np.full((1, 2, 2), 0.049)) == ()


def test_a_check_counts_what_lies_inside(told):
    found = place.check(told, [chart(told.damping[0] * 1.0, told.frequency[0])])
    assert (found.inside, found.values, found.maps) == (8, 8, ("mode 1",))
    off = place.check(told, [chart(3 * told.damping[0], told.frequency[0])])
    assert (off.inside, off.values) == (4, 8)
    part = place.check(told, [chart(told.damping[0, :1], told.frequency[0, :1], levels=LEVELS[:1])])
    assert part.values == 4 and np.isnan(part.measured_damping[0, 1]).all()


def test_it_is_stored_whole(told, tmp_path):
    found = place.check(told, [chart(told.damping[0], told.frequency[0])])
    store.save(tmp_path / "forecast.h5", found)
    again = store.load(tmp_path / "forecast.h5")
    assert isinstance(again, ForecastCheck) and np.array_equal(again.forecast.damping_low, told.damping_low)


def test_bad_input_is_told(task, told):
    with pytest.raises(InputError, match="too few draws"):
        place.forecast(task, SPOT, 1, settings=place.ForecastSettings(draws=3))
    with pytest.raises(InputError, match="no such place; got 7"):
        place.forecast(task, SPOT, 7)
    good = chart(told.damping[0], told.frequency[0])
    with pytest.raises(InputError, match="none of the forecast's target modes"):
        place.check(told, [chart(told.damping[0], 3 * told.frequency[0])])
    with pytest.raises(InputError, match="two maps of one mode"):
        place.check(told, [good, good])
    with pytest.raises(InputError, match="none of the conditions"):
        place.check(told, [chart(told.damping[0], told.frequency[0], levels=(1.0, 2.0))])
