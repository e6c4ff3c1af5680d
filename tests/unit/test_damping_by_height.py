"""Damping by the height of a peak: shown where it is the damping, blanked where shape or neighbours make it another."""

import numpy as np
import pytest

from ema import fit
from ema.data import Condition, Excitation, FrfSet, JointForce, ModalModel, poles_from
from ema.dof import Dof
from ema.study.damping_by_height import ALLOWED, with_valid_heights

DOF = (Dof(1, "+Z"),)
LINES = np.arange(480.0, 520.0, 0.1)
W = 2 * np.pi * LINES


def reference(constant: float = 0.04) -> ModalModel:
    """One mode at 500 Hz with a modal constant in 1/kg at its drive point."""
    pole, shape = poles_from(np.array([500.0]), np.array([0.006])), np.array([[np.sqrt(constant)]], complex)
    return ModalModel(pole, shape, DOF, shape / (2j * pole.imag), DOF, scaling="unit modal mass", name="bare")


def condition(level: float, constant: float, zeta: float, neighbour: float = 0.0, friction: float = 0.0) -> FrfSet:
    """One mode with damping zeta + friction / amplitude, solved at every line, and a flexible neighbourhood."""
    r = 2 * np.pi * 500.0
    values = np.empty(len(W), complex)
    for k, w in enumerate(W):
        low, high = 0.0, constant * level / (2 * r * r * zeta)
        for _ in range(80):
            size = 0.5 * (low + high)
            response = constant * level / (r * r - w * w + 2j * (zeta + friction / max(size, 1e-30)) * r * w)
            low, high = (size, high) if abs(response) > size else (low, size)
        values[k] = response / level
    where = Condition(Excitation("stepped sine", level), (JointForce("J1", 100.0),))
    return FrfSet(LINES, (values + neighbour)[:, None, None], DOF, DOF, "receptance", "m/N", condition=where)


def judged(sets: list[FrfSet]):
    """Heights before and after, and the findings."""
    bare = reference()
    chart = fit.track(sets, 500.0, bare)
    order = [(row, 0) for row in range(len(sets))]
    after, findings = with_valid_heights(chart, sets, order, bare)
    return chart, after.quadrature_damping[:, 0], findings


@pytest.mark.parametrize("zeta", [0.002, 0.02])
def test_heights_stay_where_beam_and_neighbours_change_nothing(zeta):
    _, after, findings = judged([condition(10.0, 0.04, zeta), condition(20.0, 0.04, zeta)])
    assert after == pytest.approx(zeta, rel=0.01) and not findings


def test_a_sticking_beam_that_changes_the_modal_constant_has_no_height():
    """Linear, 0.6 % damped, modal constant 0.76 of the reference: the height alone would read 0.6 / 0.76 %."""
    chart, after, findings = judged([condition(10.0, 0.76 * 0.04, 0.006), condition(20.0, 0.76 * 0.04, 0.006)])
    assert chart.quadrature_damping[:, 0] == pytest.approx(0.006 / 0.76, rel=0.01)
    assert np.isnan(after).all()
    assert [one.code for one in findings] == ["height"] and findings[0].value == pytest.approx(1 / 0.76, rel=0.02)


def test_neighbours_that_add_to_the_peak_take_its_height():
    """A flexibility in quadrature of a third of the peak, as a mode with another phase leaves at its top."""
    top = 0.04 / (2 * (2 * np.pi * 500) ** 2 * 0.006)
    one = [condition(10.0, 0.04, 0.006, neighbour=-0.33j * top)]
    chart, after, findings = judged(one)
    assert chart.quadrature_damping[0, 0] == pytest.approx(0.006 / 1.33, rel=0.02)
    assert np.isnan(after).all() and [finding.code for finding in findings] == ["height"]
    small = condition(10.0, 0.04, 0.006, neighbour=-0.3 * ALLOWED * 1j * top)
    assert np.isfinite(judged([small])[1]).all()


def test_a_peak_bent_by_friction_keeps_its_height_and_it_is_the_damping_at_the_top():
    """Damping that falls with amplitude: the linear fit is off, the height is not."""
    slope = 0.004 * 0.04 * 10.0 / (2 * (2 * np.pi * 500) ** 2 * 0.010)
    bent = condition(10.0, 0.04, 0.006, friction=slope)
    chart, after, findings = judged([condition(40.0, 0.04, 0.006), bent][::-1])
    top = np.abs(bent.values).max() * 10.0
    assert after[0] == pytest.approx(0.006 + slope / top, rel=0.02)
    assert not findings and abs(chart.damping[0, 0] / after[0] - 1) > 0.05
