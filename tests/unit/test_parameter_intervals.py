"""Intervals of joint parameters under a law that is only nearly right: against draws of the model they assume."""

from dataclasses import replace

import numpy as np
import pytest

from ema.compare.free_parameters import FreeParameter, free_parameters, initial_values, with_law, with_parameters
from ema.compare.parameter_intervals import (
    LinearData,
    ProfileLikelihood,
    hidden_springs,
    levels_agree,
    other_laws,
    posterior,
)
from ema.contact.iwan import springs_of
from ema.data import FrictionLaw
from ema.errors import InputError
from ema.examples import beam_model
from ema.simulate import Masing, ModifiedIwan

POINTS = 24
ANY = np.full(3, 10.0)
"""Limits that every estimate is below: the prior's standard deviation is 3."""


def drawn(rng, share=0.0, count=3, growth=0.0):
    """Random linear data with true parameters of the prior's centre: noise, a common error, other laws' part, and that
    of a mu that changes with the normal force."""
    load = np.sort(rng.uniform(0, 4, POINTS))
    pressed, damping = rng.uniform(0, 2, POINTS), rng.uniform(0.005, 0.05, POINTS)
    slopes = rng.standard_normal((2 * POINTS, count)) * np.repeat([1.0, 0.02], POINTS)[:, None]
    std = np.repeat([0.03, 5e-4], POINTS)
    middle = np.exp(-((load - 2) ** 2))
    others = np.stack([np.concatenate([0.3 * k * middle, 0.01 * middle**k]) for k in (1, 2, -1)], axis=1)
    weights = share / np.sqrt(others.shape[1]) * rng.standard_normal(others.shape[1])
    common = np.repeat([0.0, 0.02 * rng.standard_normal()], POINTS)
    truth = rng.standard_normal(count)
    values = slopes @ truth + others @ weights + common + std * rng.standard_normal(2 * POINTS)
    changed = growth * np.concatenate([pressed - 1, 0.02 * (pressed - 1)])
    values += changed * rng.standard_normal()
    origin = float(load[0]), 0.5 * float(pressed.min() + pressed.max())
    return LinearData(
        values, slopes, std, load, pressed, damping, others, changed, np.zeros(count), 3.0, 0.0, origin
    ), truth


def test_intervals_hold_what_they_say_whether_the_law_is_right_or_one_of_many():
    rng = np.random.default_rng(5)
    for share, growth, low, high in ((0.0, 0.0, 0.93, 0.999), (1.0, 0.0, 0.91, 0.99), (0.0, 0.2, 0.93, 0.999)):
        held = []
        for _ in range(150):
            data, truth = drawn(rng, share, growth=growth)
            whole = posterior(data)
            held += list(np.abs(whole.mean - truth) < 1.96 * np.sqrt(np.diag(whole.covariance)))
        # 450 intervals; a share of 95 % has a standard deviation of 1 %
        assert low < np.mean(held) < high


def test_a_law_that_is_right_costs_little():
    """Against the covariance of least squares with the common error left free: the intervals are less than twice."""
    rng = np.random.default_rng(6)
    data, _ = drawn(rng)
    common = np.repeat([0.0, 1.0], POINTS)[:, None]
    white = np.hstack([data.sensitivity, common]) / data.std[:, None]
    least = np.sqrt(np.diag(np.linalg.inv(white.T @ white)))[:3]
    ratio = np.sqrt(np.diag(posterior(data).covariance)) / least
    assert np.all(ratio > 0.99) and np.all(ratio < 2.0)


def test_estimates_with_a_level_left_out_disagree_by_chance_once_in_a_hundred():
    rng = np.random.default_rng(7)
    agreed, levels = [], np.repeat(np.arange(4), POINTS // 4)
    for _ in range(100):
        data, _ = drawn(rng, share=0.5)
        agreed.append(levels_agree(data, levels, posterior(data), ANY).all())
    # expected 99 of 100; fewer than 93 happen once in 10 000
    assert np.mean(agreed) > 0.93


def test_a_level_that_contradicts_the_others_is_seen():
    rng = np.random.default_rng(8)
    data, _ = drawn(rng, count=1)
    levels = np.repeat(np.arange(4), POINTS // 4)
    shifted = np.tile(levels == 3, 2) * data.sensitivity[:, 0] * 3.0
    wrong = replace(data, residuals=data.residuals + shifted)
    assert not levels_agree(wrong, levels, posterior(wrong), ANY[:1]).any()


def test_one_level_confirms_nothing():
    data, _ = drawn(np.random.default_rng(8), count=2)
    assert not levels_agree(data, np.zeros(POINTS), posterior(data), ANY[:2]).any()


def test_estimates_that_determine_nothing_confirm_nothing():
    """Two points, which three parameters need both: either alone agrees with the two, whatever they say.

    One point is two data; the prior's standard deviation of 3 remains for at least one of three parameters.
    """
    data, _ = drawn(np.random.default_rng(10), count=3)
    two = data.subset(np.arange(POINTS) < 2)
    slopes = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.02, 0.0, 0.0], [0.0, 0.02, 0.0]])
    two = replace(two, sensitivity=slopes, residuals=np.zeros(4))
    assert levels_agree(two, np.arange(2), posterior(two), ANY).all()
    assert not levels_agree(two, np.arange(2), posterior(two), np.full(3, 0.5))[:2].any()


def test_a_profile_that_never_closes_is_named_open():
    """A parameter whose effect saturates: derivatives at the optimum promise an interval that does not exist above."""
    rng = np.random.default_rng(9)
    data, _ = drawn(rng, count=1)
    data = replace(data, residuals=np.zeros(2 * POINTS))
    whole = posterior(data)
    reach = np.sqrt(whole.covariance[0, 0])

    def saturating(step):
        return -data.sensitivity @ np.array([min(step[0], 0.8 * reach)])

    known = np.ones(2 * POINTS, bool)
    below, above = ProfileLikelihood(saturating, known, data, whole).bounds(np.ones(1))
    assert np.isfinite(below) and above == np.inf
    linear = ProfileLikelihood(lambda step: -data.sensitivity @ step, known, data, whole).bounds(np.ones(1))
    assert linear == (-1.0, 1.0)


def test_other_laws_have_the_same_stiffness_and_slip_force():
    """At small motion k_T u, in gross slip mu F_N: from the shares of the springs as the simulator divides them."""
    law = Masing(0.3, 2e7, stiffness_exponent=0.4)
    laws = other_laws(law)
    assert len(laws) == 20 and len({other.parameters for other in laws}) == 20
    for other in laws:
        stiffness, slip = springs_of(other)
        assert (2e7 * stiffness).sum() == pytest.approx(2e7) and (0.3 * slip).sum() == pytest.approx(0.3)
        assert np.all(stiffness > 0) and np.all(slip >= 0)
        assert (other.friction_coefficient, other.contact_stiffness, other.stiffness_exponent) == (0.3, 2e7, 0.4)


@pytest.mark.parametrize("law", [Masing(0.3, 2e7), ModifiedIwan(0.3, 2e7, chi=0.2)], ids=["masing", "modified iwan"])
def test_beside_a_hidden_spring_the_others_slip_as_before(law):
    """The law with a soft spring has the mu and k_T of the law; with the mu that it begins at, the slip forces of the
    other springs are those of the law alone, and what slips last is the soft one, which carries the rest."""
    slip = springs_of(law)[1]
    found = hidden_springs(law)
    assert len(found) == 9
    for other, more in found:
        stiffness, shares = springs_of(other)
        assert (stiffness.sum(), shares.sum()) == pytest.approx((1, 1))
        assert np.exp(more) * shares[:-1] == pytest.approx(slip, rel=1e-12)
        assert shares[-1] / stiffness[-1] > 1


def test_another_law_is_fitted_to_its_least_chi_square():
    """Of linear residuals the least chi-square has a closed form: generalised least squares with the prior."""
    rng = np.random.default_rng(10)
    for _ in range(5):
        data, _ = drawn(rng)
        whole = posterior(data)
        likelihood = ProfileLikelihood(
            lambda step, data=data: data.residuals - data.sensitivity @ step, np.ones(2 * POINTS, bool), data, whole
        )
        weighted = np.linalg.solve(whole.data_covariance, data.sensitivity)
        precision = weighted.T @ data.sensitivity + np.eye(3) / data.prior_std**2
        best = np.linalg.solve(precision, weighted.T @ data.residuals)
        offset, covariance, least = likelihood.descended(best + rng.uniform(-0.5, 0.5, 3), np.inf)
        assert offset == pytest.approx(best, abs=1e-6)
        assert least == pytest.approx(likelihood.chi_square(best)[0], abs=1e-6)
        assert covariance == pytest.approx(max(1, whole.misfit**2) * np.linalg.inv(precision), rel=1e-6)
        assert likelihood.descended(best + 50.0, least) is None


def test_a_law_replaces_the_form_of_all_joints_and_keeps_their_parameters():
    model = beam_model()
    joints = replace(model.joints[0], name="J1"), replace(model.joints[0], name="J2", law=Masing(0.5, 3e6))
    changed = with_law(replace(model, joints=joints), ModifiedIwan(0.1, 1.0, chi=0.2)).joints
    assert [joint.law.name for joint in changed] == ["modified iwan"] * 2
    assert dict(changed[1].law.parameters)["chi"] == 0.2
    assert [joint.law.friction_coefficient for joint in changed] == [joints[0].law.friction_coefficient, 0.5]


@pytest.mark.parametrize(
    ("parameter", "values"),
    [
        (FreeParameter("friction_coefficient"), (0.01, 0.4, 3.0)),
        (FreeParameter("chi", -1.0, 1.0), (-0.9, 0.0, 0.95)),
        (FreeParameter("stiffness_exponent", -np.inf), (-0.2, 0.5)),
        (FreeParameter("static ratio", 1.0), (1.2, 3.0)),
    ],
)
def test_a_parameter_comes_back_from_its_scale(parameter, values):
    for value in values:
        assert parameter.plain(parameter.scaled(value)) == pytest.approx(value)
    assert (
        parameter.low <= parameter.plain(-50.0) <= parameter.plain(50.0) <= max(parameter.high, parameter.plain(50.0))
    )


def test_every_number_of_a_law_may_be_free_and_no_other():
    model = beam_model()
    joints = tuple(replace(joint, law=ModifiedIwan(0.3, 1e6, chi=0.3)) for joint in model.joints)
    iwan = replace(model, joints=joints)
    free = free_parameters(iwan, ["friction_coefficient", "chi", "beta"])
    assert [one.name for one in free] == ["friction_coefficient", "chi", "beta"]
    assert free[1].plain(initial_values(iwan, free)[1]) == pytest.approx(0.3)
    law = with_parameters(iwan, {"chi": -0.2}).joints[0].law
    assert dict(law.parameters)["chi"] == -0.2 and dict(law.parameters)["springs"] == 60
    with pytest.raises(InputError, match="the law has no chi"):
        free_parameters(model, ["chi"])
    with pytest.raises(InputError, match="an unknown parameter"):
        free_parameters(model, ["springs"])
    mixed = replace(model, joints=(model.joints[0], replace(joints[0], name="other")))
    with pytest.raises(InputError, match="the law has no chi"):
        free_parameters(mixed, ["chi"])
    own = replace(joints[0], law=FrictionLaw("own", 0.3, 1e6, parameters=(("rate", 2.0),)))
    assert free_parameters(replace(model, joints=(own,)), ["rate"])[0].logarithmic
