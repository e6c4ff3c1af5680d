"""Uncertainty of what is derived from a fit, against the scatter over noise draws: shapes, modal mass, residues, MAC,
differences between two tests, and points of a damping map.

Systems and noise are drawn at run time; limits are those of the scatter of so many draws.
"""

from dataclasses import replace

import numpy as np
import pytest

import ema.fit
from ema import compare, shapes
from ema.data import Condition, Excitation, JointForce, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.fit.uncertainty import residue_std, shape_std
from ema.synthesis import frfs as synthesis

DRAWS = 40
DOFS = tuple(Dof(node, "+Z") for node in range(1, 7))
SEED = 20261122


def structure() -> ModalModel:
    """Three modes on six DOFs, two of them references; shapes 1 and 3 are alike to a part."""
    poles = poles_from(np.array([120.0, 180.0, 260.0]), np.array([0.01, 0.005, 0.02]))
    rows = np.random.default_rng(SEED).uniform(0.4, 1, (6, 3)) * np.random.default_rng(SEED).choice([-1, 1], (6, 3))
    rows[:, 2] += rows[:, 0]
    return ModalModel(poles, rows + 0j, DOFS, rows[:2] / (2j * poles.imag), DOFS[:2], scaling="unit modal mass")


@pytest.fixture(scope="module")
def truth() -> ModalModel:
    return structure()


@pytest.fixture(scope="module")
def fits(truth: ModalModel) -> list[ModalModel]:
    """Fits of the same structure with other noise, each with its own interval."""
    clean = synthesis(truth, np.linspace(90, 300, 421), "accelerance")
    rms = np.sqrt(np.mean(np.abs(clean.values) ** 2, axis=0))
    found = []
    for draw in range(DRAWS):
        rng = np.random.default_rng([SEED, draw])
        noise = rng.standard_normal((*clean.values.shape, 2)).view(complex)[..., 0] / np.sqrt(2)
        frfs = replace(clean, values=clean.values + 0.05 * rms * noise)
        model = ema.fit.modes(frfs, ema.fit.stabilise(frfs, orders=range(4, 17, 2)), near=[120, 180, 260])
        assert len(model.poles) == 3, f"seed {SEED}, draw {draw}"
        found.append(model)
    return found


def inside(errors: np.ndarray) -> float:
    """Share of errors, in standard deviations, that a 95 % interval holds."""
    return float(np.mean(np.abs(errors) <= 1.96))


def test_shapes_residues_and_modal_mass(truth: ModalModel, fits: list[ModalModel]):
    shape, residue, mass = [], [], []
    for model in fits:
        sign = np.sign(np.sum(model.shapes.real * truth.shapes.real, axis=0))
        error, std = model.shapes * sign - truth.shapes, shape_std(model)
        shape.append(error.real / std.real)
        error, std = model.residues() - truth.residues(), residue_std(model)
        residue += [error.real / std.real, error.imag / std.imag]
        top = np.abs(model.shapes).argmax(axis=0), np.arange(3)
        mass.append((np.abs(truth.shapes[top] / model.shapes[top]) ** 2 - 1) / model.uncertainty.modal_mass)
    # 40 draws of 3 modes with errors that DOFs share: about 200 independent ones
    for errors in (shape, residue, mass):
        assert 0.90 <= inside(np.array(errors)) <= 0.985, f"seed {SEED}"


def test_mac_of_two_estimates_of_one_shape(fits: list[ModalModel]):
    loss, stated, spread = [], [], []
    for one, other in zip(fits[::2], fits[1::2], strict=True):
        found = shapes.mac_uncertainty(one, other, [(mode, mode) for mode in range(3)])
        loss.append(1 - found.mac)
        stated.append(found.lowered)
        spread.append(found.std)
    loss, stated, spread = np.array(loss), np.array(stated), np.array(spread)
    # 20 pairs of about ten free components: the mean loss scatters by a tenth, its standard deviation by a fifth
    assert loss.mean(axis=0) == pytest.approx(stated.mean(axis=0), rel=0.35), f"seed {SEED}"
    assert np.sqrt(np.mean((loss - stated.mean(axis=0)) ** 2 / np.mean(spread**2, axis=0))) == pytest.approx(
        1, abs=0.35
    )
    assert inside((loss - stated) / spread) >= 0.85, f"seed {SEED}"


def test_mac_of_shapes_that_are_alike_to_a_part(truth: ModalModel, fits: list[ModalModel]):
    exact = shapes.mac(truth.shapes, truth.shapes)
    pairs = [(0, 2), (2, 0), (0, 1), (1, 2)]
    errors = []
    for one, other in zip(fits[::2], fits[1::2], strict=True):
        found = shapes.mac_uncertainty(one, other, pairs)
        errors.append((found.mac + found.lowered - [exact[pair] for pair in pairs]) / found.std)
    assert 0.85 <= inside(np.array(errors)) <= 1.0, f"seed {SEED}"
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.3), f"seed {SEED}"


def test_mac_against_exact_shapes_rests_on_one_uncertainty(truth: ModalModel, fits: list[ModalModel]):
    against = [shapes.mac_uncertainty(model, truth, [(0, 0)]) for model in fits]
    both = [shapes.mac_uncertainty(one, other, [(0, 0)]) for one, other in zip(fits[::2], fits[1::2], strict=True)]
    lost = np.mean([one.lowered[0] for one in both]) / np.mean([one.lowered[0] for one in against])
    assert lost == pytest.approx(2, rel=0.1)
    loss = np.mean([1 - one.mac[0] for one in against])
    assert loss == pytest.approx(np.mean([one.lowered[0] for one in against]), rel=0.3), f"seed {SEED}"


def test_differences_between_two_tests(fits: list[ModalModel]):
    errors = [compare.modes(one, other).significance for one, other in zip(fits[::2], fits[1::2], strict=True)]
    assert 0.88 <= inside(np.array(errors)) <= 1.0, f"seed {SEED}"
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.2), f"seed {SEED}"
    against = compare.modes(fits[0], fits[1])
    stated = shapes.mac_uncertainty(fits[0], fits[1], against.pairs)
    assert list(against.table()["std MAC"]) == list(stated.std)
    found = compare.difference(compare.repeats(fits[:1], "a"), compare.repeats(fits[1:2], "b"))
    variances = fits[0].covariance[:, 1, 1] + fits[1].covariance[:, 1, 1]
    assert found.damping_noise == pytest.approx(1.96 * np.sqrt(variances), rel=1e-3)


def test_points_of_a_map():
    errors = []
    for draw in range(60):
        rng = np.random.default_rng([SEED, 7, draw])
        sets = []
        for level, damping in ((1.0, 0.004), (5.0, 0.008), (20.0, 0.015)):
            model = replace(structure(), poles=poles_from(np.array([60.0, 180.0, 420.0]), np.full(3, damping)))
            clean = synthesis(model, np.linspace(90, 300, 841), "accelerance")
            noise = rng.standard_normal((*clean.values.shape, 2)).view(complex)[..., 0] / np.sqrt(2)
            size = 0.02 * np.sqrt(np.mean(np.abs(clean.values) ** 2, axis=0))
            condition = Condition(Excitation("sweep", level), (JointForce("J1", 100.0),))
            sets.append(replace(clean, values=clean.values + size * noise, condition=condition))
        chart = ema.fit.track(sets, near=180.0)
        errors.append(
            [
                (chart.frequency[:, 0] - 180.0) / chart.frequency_std[:, 0],
                (chart.damping[:, 0] - [0.004, 0.008, 0.015]) / chart.damping_std[:, 0],
            ]
        )
    assert inside(np.array(errors)) >= 0.90, f"seed {SEED}"
    assert np.sqrt(np.mean(np.square(errors), axis=0)) == pytest.approx(1, abs=0.3), f"seed {SEED}"


def test_bad_input_is_refused_with_a_sentence(truth: ModalModel, fits: list[ModalModel]):
    with pytest.raises(InputError, match="neither model states an uncertainty"):
        shapes.mac_uncertainty(truth, truth, [(0, 0)])
    with pytest.raises(InputError, match="no such mode"):
        shapes.mac_uncertainty(fits[0], truth, [(0, 3)])
    moved = replace(truth, dofs=tuple(Dof(dof.node + 50, "+Z") for dof in DOFS))
    with pytest.raises(InputError, match="no DOF in common"):
        shapes.mac_uncertainty(fits[0], moved, [(0, 0)])
