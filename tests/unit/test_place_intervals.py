"""What is uncertain before a beam is bolted on: poles of the test, damping of what nobody measured, rigid-body motion."""

from dataclasses import replace

import numpy as np
import pytest

from ema import place, shapes
from ema.data import FrictionLaw, poles_from
from ema.data.placement import BoltedJoint, Candidates, FrictionBeam
from ema.place.intervals import UNKNOWN_DAMPING, drawn
from ema.shapes.rigid import Body
from tests.unit.placement_rig import bare_table

JOINT = BoltedJoint(FrictionLaw("masing", 0.2, 2e8), 1e9, 0.045)


@pytest.fixture(scope="module")
def known():
    """Modes of the table with damping ratios that differ, and with stated uncertainties."""
    bare, geometry = bare_table(0.0)
    ratios = 0.006 * np.exp(0.3 * np.random.default_rng(3).standard_normal(len(bare.poles)))
    covariance = np.stack([np.diag([0.3**2, (0.05 * ratio) ** 2]) for ratio in ratios])
    poles = poles_from(bare.natural_frequencies, ratios)
    bare, _ = shapes.with_rigid_body(replace(bare, poles=poles, covariance=covariance), geometry, 130.0)
    return bare, shapes.with_body_uncertainty(shapes.smooth(bare, geometry), 3, mass_known=True), ratios


def test_poles_are_drawn_as_well_as_they_are_known(known):
    bare, surface, ratios = known
    longer, wider, _ = shapes.with_plate(bare, surface)
    task = place.Task(longer, wider, JOINT, "91:+Z", np.array([30.0]), np.array([100.0]), (0,))
    draws = list(drawn(task, 600, np.random.default_rng(1)))
    count, first = len(ratios), len(bare.poles)
    frequency = np.array([one.bare.natural_frequencies for one in draws])
    logarithm = np.log([one.bare.damping_ratios for one in draws])
    # the relative standard error of a standard deviation of 600 draws is 3 %
    assert np.std(frequency[:, :count], axis=0) == pytest.approx(0.3, rel=0.15)
    assert np.std(logarithm[:, :count], axis=0) == pytest.approx(0.05, rel=0.15)
    assert np.std(logarithm[:, count:first], axis=0) == pytest.approx(UNKNOWN_DAMPING, rel=0.15)
    if len(longer.poles) > first:
        scatter = float(np.std(np.log(ratios), ddof=1))
        assert np.std(logarithm[:, first:], axis=0).mean() == pytest.approx(scatter, rel=0.05)
        assert np.array_equal(frequency[0, first:], longer.natural_frequencies[first:])


def test_a_band_is_never_narrower_than_the_test_of_the_bare_structure(known):
    """A beam of no weight whose joints stick changes nothing: the band of f and zeta is that of the measured mode."""
    bare, surface, ratios = known
    light = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02, density=1.0, young_modulus=1e6)
    spot = Candidates(np.array([[0.45, 0.25]]), np.zeros(1), np.zeros(1, int), (light,))
    task = place.Task(bare, surface, JOINT, "91:+Z", np.array([30.0]), np.array([5000.0]), (0,))
    told = place.forecast(
        task._replace(force_levels=[20.0], normal_forces=[5000.0]),
        spot,
        0,
        settings=place.ForecastSettings(draws=200, seed=4, method="frozen"),
    )
    assert told.damping[0, 0, 0] == pytest.approx(ratios[0], rel=0.01)
    # 95 % of 200 draws end within 6 % of 1.96 standard deviations, twice that is not seen in a million
    assert np.log(told.damping_high / told.damping_low).item() / 2 == pytest.approx(1.96 * 0.05, rel=0.35)
    assert ((told.frequency_high - told.frequency_low) / 2).item() == pytest.approx(1.96 * 0.3, rel=0.35)


def test_rigid_body_shapes_are_as_uncertain_as_the_body(known):
    """Against shapes of bodies with other centres and radii of gyration, closed forms of (x - c) / (r sqrt(m))."""
    _, surface, _ = known
    places = np.random.default_rng(0).uniform(surface.extent[:, 0], surface.extent[:, 1], (40, 2))
    sides, middle = surface.extent[:, 1] - surface.extent[:, 0], surface.extent.mean(axis=1)
    rng = np.random.default_rng(2)
    bodies = [
        Body(
            130.0,
            middle + 0.02 * sides * rng.standard_normal(2),
            sides / np.sqrt(12) / np.exp(0.04 * rng.standard_normal(2)),
        )
        for _ in range(3000)
    ]
    scatter = np.std([body.shapes(places) for body in bodies], axis=0)
    stated = surface.std(places)[:, -3:]
    assert stated[:, 0] == pytest.approx(0.0, abs=1e-5)
    assert stated[:, 1:] == pytest.approx(scatter[:, 1:], rel=0.1)
    unknown = shapes.with_body_uncertainty(surface, 3, mass_known=False).std(places)[:, -3:]
    assert unknown[:, 0] == pytest.approx(0.04 / np.sqrt(130.0), rel=1e-4)
