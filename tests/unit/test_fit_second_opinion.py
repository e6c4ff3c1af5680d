"""ERA against known truth, and two estimators side by side."""

from dataclasses import replace

import numpy as np
import pytest

import ema.fit
from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from ema.errors import InputError
from ema.fit import hankel
from ema.synthesis import frfs as synthesis
from tests.bench.cases import case_160
from tests.bench.scoring import cramer_rao, score

DOFS = tuple(Dof(node, "+Z") for node in range(1, 7))


def model(frequencies=(120.0, 180.0, 183.0, 260.0), damping=(0.01, 0.004, 0.006, 0.05), scale=1.0) -> ModalModel:
    """Four modes on six DOFs: a pair 1.7 % apart and a heavily damped one."""
    rng = np.random.default_rng(5)
    poles = scale * poles_from(np.array(frequencies), np.array(damping))
    shapes = rng.standard_normal((6, len(poles))) + 0j
    return ModalModel(
        poles=poles,
        shapes=shapes,
        dofs=DOFS,
        participation=shapes[[0, 3]] / (2j * poles.imag),
        inputs=(DOFS[0], DOFS[3]),
        scaling="unit modal mass",
    )


def measured(truth: ModalModel, noise: float = 0.0, quantity: str = "accelerance", seed: int = 1) -> FrfSet:
    """FRFs at 100-300 Hz with noise relative to the rms of each."""
    frfs = synthesis(truth, np.linspace(100, 300, 801), quantity)
    rng = np.random.default_rng(seed)
    rms = np.sqrt(np.mean(np.abs(frfs.values) ** 2, axis=0))
    unit = rng.standard_normal((*frfs.values.shape, 2)).view(complex)[..., 0] / np.sqrt(2)
    return replace(frfs, values=frfs.values + noise * rms * unit)


def test_products_with_the_hankel_matrix_are_those_of_the_matrix():
    rng = np.random.default_rng(0)
    h = rng.normal(size=(50, 3, 2)) + 1j * rng.normal(size=(50, 3, 2))
    data = hankel.Responses(h, 4, 20, 15)
    full = np.array([[h[4 + i + j] for j in range(15)] for i in range(20)]).transpose(0, 2, 1, 3).reshape(60, 30)
    right, left = rng.normal(size=(15, 2, 4)) + 0j, 1j * rng.normal(size=(20, 3, 4))
    product = hankel.Hankel(data)
    np.testing.assert_allclose(product.times(right).reshape(60, 4), full @ right.reshape(30, 4), atol=1e-12)
    expected = full.conj().T @ left.reshape(60, 4)
    np.testing.assert_allclose(product.adjoint_times(left).reshape(30, 4), expected, atol=1e-12)


def test_a_realisation_of_pure_exponentials_is_exact():
    rng = np.random.default_rng(1)
    values = np.exp(np.array([-0.02 + 0.5j, -0.1 + 2.0j, -0.01 + 4.0j]))
    shapes, participation = rng.normal(size=(5, 3)), rng.normal(size=(2, 3))
    h = np.einsum("nr,or,ir->noi", values ** np.arange(200)[:, None], shapes, participation)
    found = hankel.realise(hankel.Responses(h, 0, 60, 60), order=3)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(found.state)), np.sort_complex(values), atol=1e-10)


def test_the_spread_of_an_eigenvalue_is_its_scatter_over_noise():
    rng = np.random.default_rng(2)
    values = np.exp(np.array([-0.02 + 0.5j, -0.05 + 2.0j]))
    shapes, participation = rng.normal(size=(4, 2)), rng.normal(size=(2, 2))
    clean = np.einsum("nr,or,ir->noi", values ** np.arange(128)[:, None], shapes, participation)
    level, found = 0.02, []
    for _ in range(150):
        noise = rng.standard_normal((*clean.shape, 2)).view(complex)[..., 0] / np.sqrt(2)
        one = hankel.realise(hankel.Responses(clean + level * noise, 0, 60, 60), order=2)
        # noise of variance v in every sample is noise of variance v * lines in every line
        modes = hankel.eigenmodes(one, 2, np.full(128, 128 * level**2), np.ones(2))
        order = np.argsort(modes.values.imag)
        found.append(np.concatenate([modes.values[order], modes.spread[order]]))
    scatter = np.std(np.array(found)[:, :2], axis=0) / np.sqrt(2)
    stated = np.mean(np.array(found)[:, 2:].real, axis=0)
    np.testing.assert_allclose(stated, scatter, rtol=0.2)


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_modes_without_noise(quantity):
    truth = model()
    found = ema.fit.era(measured(truth, 0.0, quantity))
    assert len(found.poles) == 4
    np.testing.assert_allclose(found.natural_frequencies, truth.natural_frequencies, rtol=2e-5)
    np.testing.assert_allclose(found.damping_ratios, truth.damping_ratios, rtol=5e-3)
    error = np.linalg.norm(found.residues() - truth.residues(), axis=(1, 2)) / np.linalg.norm(
        truth.residues(), axis=(1, 2)
    )
    assert error.max() < 0.02
    assert found.scaling == "unit modal mass"


def test_a_roving_hammer_gives_shapes_on_the_hammer_points():
    frfs = measured(model(), 0.001)
    turned = replace(frfs, values=frfs.values.transpose(0, 2, 1), outputs=frfs.inputs, inputs=frfs.outputs)
    assert ema.fit.era(turned).dofs == DOFS


def test_the_decay_of_a_window_is_taken_off():
    truth = model()
    heavier = replace(truth, poles=truth.poles - 3.0)
    found = ema.fit.era(replace(measured(heavier, 0.0005), added_decay=3.0))
    np.testing.assert_allclose(found.poles.real, truth.poles.real, rtol=0.01)


@pytest.mark.parametrize("seed", [1, 2])
def test_160_frfs_at_three_noise_levels(seed: int):
    """Noise of 5 % hides one mode of 20 from this estimator in most draws, and four in the worst of some dozens."""
    inside, false = [], 0
    for noise in (0.001, 0.01, 0.05):
        case = case_160(noise=noise, seed=seed)
        found = ema.fit.era(case.frfs)
        result = score(case, found, cramer_rao(case))
        assert result.found >= 17, f"noise {noise}"
        false += len(result.false)
        hit = result.match >= 0
        std = np.sqrt(found.covariance[result.match[hit]][:, [0, 1], [0, 1]])
        error = np.stack(
            [
                (result.frequency_error * case.truth.natural_frequencies)[hit],
                (result.damping_error * case.truth.damping_ratios)[hit],
            ],
            axis=1,
        )
        inside.append(np.abs(error / std) < 2)
    # this estimator is a second opinion: one draw in a few has modes so far off that they are missed and false at once
    assert false <= 3
    assert np.mean(np.concatenate(inside)) > 0.8


def test_noise_alone_has_no_modes():
    rng = np.random.default_rng(3)
    frfs = measured(model())
    noise = rng.standard_normal((*frfs.values.shape, 2)).view(complex)[..., 0]
    found = ema.fit.era(replace(frfs, values=noise))
    assert len(found.poles) == 0


def test_of_an_axis_with_a_hole_the_longer_part_is_used():
    frfs = measured(model(), 0.001)
    found = ema.fit.era(frfs.lines(np.abs(frfs.frequencies - 150) > 3))
    assert [finding.code for finding in found.findings if finding.severity == "warning"] == ["uneven-axis"]
    np.testing.assert_allclose(found.natural_frequencies, [180, 183, 260], rtol=1e-4)
    with pytest.raises(InputError, match="evenly spaced"):
        ema.fit.era(replace(frfs, frequencies=np.geomspace(100, 300, 801)))


def test_two_opinions_on_clean_data_agree():
    frfs = measured(model(), 0.01)
    modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    opinion = ema.fit.second_opinion(modes, frfs)
    assert len(opinion.pairs) == 4
    assert not opinion.differs.any()
    assert opinion.findings == ()
    assert list(opinion.table()["agrees"]) == [True] * 4
    assert opinion.mac.min() > 0.99


def test_what_differs_is_a_finding():
    frfs = measured(model(), 0.01)
    modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    wrong = poles_from(modes.natural_frequencies, modes.damping_ratios * np.array([1.0, 1.0, 1.0, 1.3]))
    opinion = ema.fit.second_opinion(replace(modes, poles=wrong), frfs)
    assert [finding.code for finding in opinion.findings] == ["second-opinion-differs"]
    assert "260" in opinion.findings[0].where
    assert list(opinion.table()["agrees"]) == [True, True, True, False]


def test_modes_of_one_opinion_alone_are_findings():
    frfs = measured(model(), 0.01)
    modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    fewer = replace(
        modes,
        poles=modes.poles[1:],
        shapes=modes.shapes[:, 1:],
        participation=modes.participation[:, 1:],
        covariance=modes.covariance[1:],
        confidence=None,
    )
    moved = fewer.poles.copy()
    moved[0] *= 1.3
    opinion = ema.fit.second_opinion(replace(fewer, poles=moved), frfs)
    assert sorted(f.code for f in opinion.findings) == ["second-opinion-extra"] * 2 + ["second-opinion-missing"]
    assert len(opinion.table()) == 5


def test_a_peak_that_moves_between_records_is_split_by_the_second_opinion():
    first, second = (measured(model((120.0, 180.0, 220.0, 260.0), (0.004,) * 4, scale)) for scale in (1.0, 1.004))
    values = np.concatenate([first.values[:, :3], second.values[:, 3:]], axis=1)
    frfs = replace(first, values=values)
    modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs), near=[120, 180, 220, 260])
    opinion = ema.fit.second_opinion(modes, frfs)
    assert "second-opinion-splits" in {finding.code for finding in opinion.findings}
