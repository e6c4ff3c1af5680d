"""One resonance that a linear fit took apart is told; true modes that are near each other are not."""

from dataclasses import replace

import numpy as np
import pytest

from ema import fit
from ema.data import ModalModel, poles_from
from ema.dof import Dof
from ema.fit.companions import companions
from tests.bench.repeated_roots import symmetric

POINTS = np.linspace(0, np.pi, 12)
BENDING, TWIST = np.sin(POINTS), np.cos(POINTS)
OUTER = np.where(np.abs(POINTS - np.pi / 2) > 0.9, 1.0, 0.5)
"""Where the impact is large enough for slip: there the heavily damped part has the larger share."""


def model(frequencies: list[float], damping: list[float], shapes: list[np.ndarray], dofs: int = 12) -> ModalModel:
    columns = np.array(shapes, complex).T[:dofs]
    names = tuple(Dof(node, "+Z") for node in range(1, dofs + 1))
    participation = np.ones((1, len(frequencies)), complex)
    return ModalModel(poles_from(np.array(frequencies), np.array(damping)), columns, names, participation, names[:1])


def test_parts_of_one_resonance_are_told_with_the_mode_of_small_amplitudes():
    phase = np.where(OUTER > 0.6, np.exp(0.9j), np.exp(-0.3j))
    parts = [BENDING * OUTER * phase, TWIST, BENDING * (1.5 - OUTER)]
    (finding,) = companions(model([478.0, 490.0, 508.0], [0.058, 0.006, 0.0073], parts))
    assert finding.code == "one-resonance-in-parts"
    assert finding.where.endswith("modes 1, 3")
    assert "508.0 Hz, is then that of small amplitudes" in finding.message


def test_an_absorber_has_two_true_modes():
    """The shape of the host twice, real, at the two sides of the tuned frequency."""
    assert companions(model([485.0, 515.0], [0.03, 0.03], [BENDING, BENDING])) == ()


def test_modes_apart_and_modes_of_other_shapes_are_left_alone():
    turned = BENDING * np.exp(1j * np.linspace(0, 2, 12))
    assert companions(model([480.0, 520.0], [0.01, 0.01], [turned, turned])) == ()
    assert companions(model([500.0, 501.0], [0.01, 0.01], [BENDING, TWIST * np.exp(1j * POINTS)])) == ()


@pytest.mark.parametrize("dofs", [1, 5])
def test_few_points_tell_nothing(dofs):
    turned = BENDING * np.exp(1j * np.linspace(0, 2, 12))
    assert companions(model([500.0, 501.0], [0.01, 0.01], [turned, turned], dofs)) == ()


@pytest.mark.parametrize(("seed", "number"), [(5301, 8), (5302, 1), (5302, 16)])
def test_double_roots_of_linear_plates_are_no_resonance_in_parts(seed, number):
    """Plates in closed form: their shapes are real, those of a fit are any from the space of each double root."""
    frfs = symmetric(seed, number).case.frfs
    found = fit.modes(frfs, fit.stabilise(frfs))
    codes = [finding.code for finding in found.findings]
    assert found.groups and "mode-group" in codes
    assert "one-resonance-in-parts" not in codes


def test_two_references_tell_two_modes_from_parts_that_share_their_participation():
    """A double root whose shapes were mixed with complex factors, and its participation with the inverse of these."""
    mixing = np.array([[1.0, 0.9], [0.4j, 0.8]])
    shapes = np.array([BENDING, TWIST]).T
    mixed = shapes @ mixing
    double = model([500.0, 501.0], [0.01, 0.01], list(mixed.T))
    references = double.dofs[2:5:2]
    sees_two = np.linalg.solve(mixing, shapes[[2, 4]].T).T
    assert companions(replace(double, inputs=references, participation=sees_two)) == ()
    sees_one = np.outer(BENDING[[2, 4]], [1.0, 0.7j])
    (finding,) = companions(replace(double, inputs=references, participation=sees_one))
    assert finding.where.endswith("modes 1, 2")


def test_nothing_and_one_mode():
    assert companions(model([500.0], [0.01], [BENDING])) == ()
