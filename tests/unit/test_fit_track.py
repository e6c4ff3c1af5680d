"""One mode through force levels and normal forces."""

from dataclasses import replace

import numpy as np
import pytest

from ema import fit
from ema.data import Condition, Excitation, FrfSet, JointForce, ModalModel
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.errors import InputError

LINES = np.arange(440.0, 560.0, 0.25)
OUT, IN = Dof(1, "+Z"), Dof(7, "-Z")


def damped(level, force):
    """Frequency and damping of a made-up joint."""
    return 495.0 + 4 * np.log10(force / level), 0.006 + 0.01 * np.exp(-(np.log(force / level / 4) ** 2))


def measured(level, force, joints=("J1", "J2"), shift=0.0):
    natural, damping = damped(level, force)
    w, r = 2 * np.pi * LINES, 2 * np.pi * natural
    values = 0.3 * -0.5 / (r**2 - w**2 + 2j * damping * r * w)
    pressed = tuple(JointForce(name, force + shift * (-1) ** n) for n, name in enumerate(joints))
    return FrfSet(
        LINES,
        values[:, None, None],
        (OUT,),
        (IN,),
        "receptance",
        "m/N",
        condition=Condition(Excitation("sweep", level), pressed),
        name=f"{level:g} N, {force:g} N",
    )


def test_a_map_is_filled_with_what_every_condition_shows():
    levels, forces = [10.0, 20.0, 40.0], [50.0, 100.0]
    sets = [measured(level, force, shift=2.0) for level in levels for force in forces]
    del sets[3]  # 20 N at 100 N was not measured
    chart = fit.track(sets, near=497.0)
    assert chart.force_levels == pytest.approx(levels)
    assert chart.normal_forces == pytest.approx(forces)
    for row, level in enumerate(levels):
        for column, force in enumerate(forces):
            if (row, column) == (1, 1):
                assert np.isnan(chart.damping[row, column])
                continue
            natural, damping = damped(level, force)
            assert chart.frequency[row, column] == pytest.approx(natural, rel=1e-9)
            assert chart.damping[row, column] == pytest.approx(damping, rel=1e-8)
            assert chart.joint_forces[row, column] == pytest.approx([force + 2, force - 2])
            assert chart.misfit[row, column] < 1e-9
    assert chart.joints == ("J1", "J2")
    assert chart.method == "measured"


def test_a_reference_gives_the_damping_by_height_and_the_modal_amplitude():
    poles = poles_from(np.array([300.0, 499.0]), np.array([0.006, 0.006]))
    shapes = np.array([[0.1, 0.3], [0.2, 0.5]], complex)
    bare = ModalModel(
        poles, shapes, (OUT, Dof(7, "+Z")), shapes / (2j * poles.imag), (OUT, Dof(7, "+Z")), scaling="unit modal mass"
    )
    chart = fit.track([measured(10.0, 50.0)], near=497.0, reference=bare)
    natural, damping = damped(10.0, 50.0)
    assert chart.quadrature_damping[0, 0] == pytest.approx(damping, rel=2e-3)
    assert chart.modal_amplitude[0, 0] == pytest.approx(10 * 0.5 / (2 * damping * (2 * np.pi * natural) ** 2), rel=5e-3)


def test_measured_values_near_each_other_are_one_nominal_value():
    chart = fit.track([measured(9.8, 50.0), measured(10.2, 99.0), measured(20.5, 51.0)], near=497.0)
    assert chart.force_levels == pytest.approx([10.0, 20.5])
    assert chart.normal_forces == pytest.approx([50.5, 99.0])
    given = fit.track([measured(9.8, 50.0), measured(20.5, 51.0)], 497.0, force_levels=[10, 20], normal_forces=[50])
    assert given.force_levels == pytest.approx([10, 20])
    assert given.force_at_resonance[:, 0] == pytest.approx([9.8, 20.5])


def test_noise_shows_in_the_standard_deviations():
    rng = np.random.default_rng(2)
    errors, stds = [], []
    for _ in range(60):
        one = measured(10.0, 50.0)
        noise = (
            0.01
            * np.abs(one.values).max()
            * (rng.standard_normal(one.values.shape) + 1j * rng.standard_normal(one.values.shape))
        )
        chart = fit.track([replace(one, values=one.values + noise)], near=497.0)
        errors.append(chart.damping[0, 0] - damped(10.0, 50.0)[1])
        stds.append(chart.damping_std[0, 0])
    assert np.std(errors) == pytest.approx(np.mean(stds), rel=0.3)


def test_bad_input_is_told_in_a_sentence():
    one = measured(10.0, 50.0)
    with pytest.raises(InputError, match="no FRFs"):
        fit.track([], near=500.0)
    with pytest.raises(InputError, match="unknown force level"):
        fit.track([replace(one, condition=Condition(Excitation("sweep"), one.condition.joints))], near=500.0)
    with pytest.raises(InputError, match="unknown normal force"):
        fit.track([measured(10.0, float("nan"), ("J1",))], near=500.0)
    with pytest.raises(InputError, match="joints that differ"):
        fit.track([one, measured(20.0, 50.0, ("J1", "J3"))], near=500.0)
    with pytest.raises(InputError, match="two sets"):
        fit.track([one, one], near=500.0)
    with pytest.raises(InputError, match="kN for N"):
        fit.track([measured(10.0, 50.0)], near=500.0, normal_forces=[0.05])
    chart = fit.track([one], near=450.0)
    assert np.isnan(chart.damping[0, 0])
