"""The table on which a placement is put to the test is measured as tables are: masses, ranges, digits, assemblies."""

import numpy as np
import pytest

from ema.datasets import work_table, work_table_placed
from ema.dof import Dof


@pytest.mark.parametrize("mass", [0.01, 0.06, 2.0])
def test_a_mass_at_a_point_moves_the_modes_as_its_receptance_says(mass):
    """1 = m w^2 a(w) at every resonance with the mass, a the receptance of the point without it (Bishop and Johnson)."""
    plain = work_table.bare(work_table_placed.points(), damping=work_table.PLACED.host_damping)
    loaded = work_table.with_masses(plain, {91: mass})
    at = np.real(plain.shapes[plain.dofs.index(Dof(91, "+Z"))])
    squares, moved = np.abs(plain.poles) ** 2, np.abs(loaded.poles) ** 2
    receptance = np.sum(at**2 / (squares - moved[:, None]), axis=1)
    np.testing.assert_allclose(mass * moved * receptance, 1, rtol=1e-5)  # differences of squares
    assert np.all(loaded.natural_frequencies <= plain.natural_frequencies)
    force = np.linalg.lstsq(np.real(plain.shapes), np.real(loaded.shapes), rcond=None)[0]
    np.testing.assert_allclose(
        force.T @ (np.eye(len(at)) + mass * np.outer(at, at)) @ force, np.eye(len(at)), atol=1e-9
    )


def test_damping_differs_from_mode_to_mode():
    ratios = work_table_placed._bare().damping_ratios[3:]
    assert len(np.unique(np.round(ratios, 4))) == len(ratios) == len(work_table.PLACED.host_damping)
    assert ratios == pytest.approx(work_table.PLACED.host_damping, rel=2e-3)


def test_ranges_of_the_front_end_fit_the_impacts_and_its_digits_are_few():
    rig = work_table_placed._hammer()
    assert rig.bits == 12
    peaks = []
    for take in (0, 44, 81):
        record = rig.take(take)
        for channel, signal in zip(record.channels, record.signals, strict=True):
            steps = np.diff(np.unique(signal))
            assert steps[steps > 1e-9].min() == pytest.approx(2 * channel.range / 2**12, rel=1e-3)
            peaks.append(np.abs(signal).max() / channel.range)
    assert max(peaks) < 0.9 and min(peaks) > 0.05


def test_every_assembly_has_joints_of_its_own():
    law = work_table.PLACED.law
    drawn = [work_table_placed.law_of(force) for force in work_table_placed.FORCES]
    friction = np.array([each.friction_coefficient for each in drawn]) / law.friction_coefficient - 1
    stiffness = np.array([each.contact_stiffness for each in drawn]) / law.contact_stiffness - 1
    assert len(set(friction)) == len(set(stiffness)) == len(drawn)
    assert np.all(np.abs(friction) < 4 * 0.03) and np.all(np.abs(stiffness) < 4 * 0.06)
