"""Measured against simulated: modes, signals, maps."""

from dataclasses import replace

import numpy as np
import pytest

from ema import compare
from ema.data import ModalMap, ModalModel
from ema.data.modal import poles_from
from ema.dof import Dof
from ema.errors import InputError

DOFS = tuple(Dof(node, "+Z") for node in range(1, 13))


def modal(frequencies, columns, std=None):
    x = np.arange(1, 13) / 13
    shapes = np.array([np.sin(np.pi * n * x) for n in columns]).T.astype(complex)
    covariance = None if std is None else np.tile(np.diag([std**2, 1e-10]), (len(columns), 1, 1))
    poles = poles_from(np.array(frequencies, float), np.full(len(columns), 0.01))
    return ModalModel(poles, shapes, DOFS, shapes[:1], DOFS[:1], covariance=covariance)


def test_modes_that_swap_are_paired_by_shape():
    found = compare.modes(modal([10, 20, 30], [1, 2, 3], 0.1), modal([10.2, 19, 21], [1, 3, 2], 0.1))
    assert found.pairs == ((0, 0), (1, 2), (2, 1))
    assert found.mac == pytest.approx(1)
    assert found.co_mac == pytest.approx(1)
    assert found.significance[0, 0] == pytest.approx(0.2 / np.hypot(0.1, 0.1))
    assert not found.verdict.agrees  # mode 3 is 37 % off
    assert list(found.table()["model"]) == [1, 3, 2]


def test_a_good_model_agrees_and_a_missing_mode_is_named():
    assert compare.modes(modal([10, 20], [1, 2]), modal([10.1, 19.9], [1, 2])).verdict.agrees
    missing = compare.modes(modal([10, 20], [1, 2]), modal([10.1], [1]))
    assert missing.unpaired == ((1,), ())
    assert not missing.verdict.agrees
    assert "measured modes have no partner: 2" in str(missing.verdict)


def decay(damping, frequency=17.0, rate=2000.0, seconds=4.0):
    t = np.arange(int(seconds * rate)) / rate
    return np.exp(-damping * 2 * np.pi * frequency * t) * np.cos(2 * np.pi * frequency * t)


def test_the_decay_a_model_lacks_is_told():
    found = compare.signals(decay(0.0055), decay(0.0045), 2000.0, (10.0, 30.0))
    assert found.missing_damping == pytest.approx(0.001, abs=1e-4)
    assert found.peak_frequencies == pytest.approx((17.0, 17.0), rel=1e-3)
    assert "lacks an exponential decay" in str(found.verdict)
    same = compare.signals(decay(0.005), decay(0.005), 2000.0, (10.0, 30.0))
    assert same.error < 1e-12
    assert same.verdict.agrees


def chart(factor=1.0, scale=1.0, levels=(10.0, 20.0, 40.0), forces=None):
    levels = np.array(levels)
    forces = np.geomspace(10, 1000, 9) if forces is None else np.array(forces)
    place = np.log(forces[None, :] / levels[:, None] / 3 / scale)
    damping = 0.006 + 0.012 * factor * np.exp(-(place**2))
    return ModalMap(levels, forces, 495 + 4 * np.tanh(place), damping, damping_std=np.full(damping.shape, 1e-4))


def test_a_map_agrees_with_itself_and_not_with_another_joint():
    assert compare.maps(chart(), chart()).verdict.agrees
    assert compare.maps(chart(), chart()).inside == 1
    weak = compare.maps(chart(), chart(factor=0.5))
    assert not weak.verdict.agrees
    moved = compare.maps(chart(), chart(scale=4.0))
    assert not moved.verdict.agrees
    assert "the most damping is at" in str(moved.verdict)


def test_a_flat_ridge_has_no_place_to_disagree_about():
    """Two summits of nearly the same height: which of them is higher says nothing."""
    left, right = chart(factor=0.5), chart(factor=0.5, scale=5.0)
    both = left.damping + right.damping - 0.006
    tilt = 1 + 0.02 * np.linspace(-1, 1, both.shape[1])
    seen, made = (ModalMap(left.force_levels, left.normal_forces, left.frequency, both * t) for t in (tilt, 1 / tilt))
    found = compare.maps(seen, made)
    assert np.any(found.ridge[:, 0] > 1.6 * found.ridge[:, 1]) and found.verdict.agrees
    assert "as far as the data show" in str(found.verdict) and "within 15 %" in str(found.verdict)


def test_holes_do_not_count():
    damping = chart().damping.copy()
    damping[1, 2] = np.nan
    holed = ModalMap(chart().force_levels, chart().normal_forces, chart().frequency, damping)
    assert compare.maps(holed, chart()).inside == 1


def test_points_at_which_the_model_has_no_resonance_are_missed():
    """A model that agrees wherever it has a resonance, and has none at 9 of 27 points: a third is missed."""
    damping = chart().damping.copy()
    damping[2] = np.nan
    holed = replace(chart(), damping=damping, damping_std=None)
    found = compare.maps(chart(), holed)
    assert found.inside == pytest.approx(2 / 3) and not found.verdict.agrees
    assert "Of these, the model has no resonance at 9." in str(found.verdict)


def test_measured_points_beyond_a_simulated_map_are_named():
    """The map of the model ends at 20 N: of 27 points it reaches 18."""
    found = compare.maps(chart(), chart(levels=(10.0, 20.0)))
    assert found.verdict.agrees and "100% of 18 points" in str(found.verdict)
    assert "beyond the simulated map, which do not count: 9." in str(found.verdict)


def test_bad_input_is_told_in_a_sentence():
    with pytest.raises(InputError, match="one level"):
        compare.maps(chart(levels=(10.0,)), chart())
    with pytest.raises(InputError, match="kN against N"):
        compare.maps(chart(), chart(forces=np.geomspace(0.01, 1, 9)))
    with pytest.raises(InputError, match="no point in common"):
        compare.maps(chart(), chart(levels=(1000.0, 2000.0)))
    with pytest.raises(InputError, match="different lengths"):
        compare.signals(decay(0.01), decay(0.01)[:-1], 2000.0, (10.0, 30.0))
    with pytest.raises(InputError, match="too short"):
        compare.signals(decay(0.01, seconds=0.3), decay(0.01, seconds=0.3), 2000.0, (10.0, 30.0))
