"""The benchmark's own measuring stick: truth, noise level, scores and the Cramer-Rao bound."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ema.data.modal import damping_ratios, poles_from
from ema.synthesis import frfs, pole_basis
from tests.bench.cases import Case, _case, case_160, random_system
from tests.bench.scoring import cramer_rao, modes_of_poles, score
from tests.bench.write_docs import OURS, accuracy, speed


def tiny(seed: int = 5, noise: float = 0.02) -> Case:
    rng = np.random.default_rng(seed)
    natural, damping = np.array([24.0, 31.0]), np.array([0.01, 0.02])
    return _case(
        "tiny",
        seed,
        noise,
        np.linspace(20, 36, 81),
        rng,
        natural,
        damping,
        outputs=4,
        references=2,
        beyond=0.05,
        neighbours=0,
    )


def test_case_160_is_what_it_says():
    case = case_160(seed=11)
    assert case.frfs.values.shape == (1601, 80, 2)
    natural, zeta = case.truth.natural_frequencies, case.truth.damping_ratios
    assert len(natural) == 20
    assert np.min(np.diff(natural) / natural[:-1]) == pytest.approx(0.004, rel=0.1)
    assert zeta.max() == pytest.approx(0.05, rel=0.02)
    assert case.outside.natural_frequencies == pytest.approx([95, 945], rel=1e-3)


def test_modes_inside_and_outside_give_the_frfs_exactly():
    case = case_160(lines=201, seed=2)
    rebuilt = sum(frfs(model, case.frfs.frequencies, "accelerance").values for model in (case.truth, case.outside))
    assert np.abs(rebuilt - case.clean).max() < 1e-12 * np.abs(case.clean).max()


def test_the_noise_has_the_stated_level():
    case = case_160(lines=801, noise=0.05, seed=3)
    error = case.frfs.values - case.clean
    magnitude = np.abs(case.clean)
    expected = 0.05 * (magnitude + np.sqrt(np.mean(magnitude**2, axis=0)))
    scaled = error / expected
    assert np.mean(np.abs(scaled) ** 2) == pytest.approx(1, abs=0.02)
    assert abs(np.mean(scaled**2)) < 0.02


def test_the_systems_are_reciprocal_and_their_shapes_complex():
    case = case_160(lines=51, seed=4)
    places = [case.truth.dofs.index(dof) for dof in case.truth.inputs]
    square = case.clean[:, places]
    assert np.abs(square - square.transpose(0, 2, 1)).max() < 1e-12 * np.abs(square).max()
    assert np.all(
        np.linalg.norm(case.truth.shapes.imag, axis=0) > 1e-4 * np.linalg.norm(case.truth.shapes.real, axis=0)
    )


@pytest.mark.parametrize("seed", range(6))
def test_random_systems_stay_in_their_distribution(seed):
    case = random_system(seed, largest=200_000)
    assert 4 <= len(case.truth.poles) <= 61
    assert case.frfs.values.shape[1] >= 8
    assert 1 <= case.frfs.values.shape[2] <= 4
    assert np.all((case.truth.damping_ratios > 0.0004) & (case.truth.damping_ratios < 0.12))
    assert case.noise in (0.001, 0.01, 0.05)
    assert case.band[0] > 0
    assert np.all(case.truth.poles.real < 0)


def test_a_seed_is_a_draw():
    assert np.array_equal(case_160(51, seed=1).frfs.values, case_160(51, seed=1).frfs.values)
    assert not np.array_equal(case_160(51, seed=1).frfs.values, case_160(51, seed=2).frfs.values)


def test_the_truth_scores_full_marks():
    case = case_160(lines=401, seed=6)
    result = score(case, case.truth, cramer_rao(case))
    assert result.found == 20
    assert result.false == ()
    assert result.recall == 1
    assert np.all(result.residue_error == 0)
    assert np.all(result.frequency_ratio == 0)


def test_a_miss_a_double_a_ghost_and_a_wrong_shape():
    case = case_160(lines=401, seed=6)
    truth = case.truth
    gap = int(np.argmax(np.diff(truth.natural_frequencies)))
    ghost = poles_from(truth.natural_frequencies[gap : gap + 2].mean(keepdims=True), np.array([0.01]))
    keep = np.array([mode for mode in range(20) if mode != 3])
    poles = np.concatenate([truth.poles[keep], truth.poles[7:8] * 1.0001, ghost])
    shapes = np.concatenate([truth.shapes[:, keep], truth.shapes[:, 7:8], truth.shapes[:, 1:2]], axis=1)
    shapes[:, 9] = np.roll(np.eye(1, 80)[0], 3)
    participation = np.concatenate([truth.participation[:, keep], truth.participation[:, [7, 1]]], axis=1)
    result = score(case, replace(truth, poles=poles, shapes=shapes, participation=participation), cramer_rao(case))
    assert result.match[3] == -1
    assert result.match[keep[9]] == -1
    assert result.found == 18
    assert result.false == (9, 19, 20)
    assert set(result.missed) == {3, keep[9]}


def test_a_mode_outside_the_band_is_neither_found_nor_false():
    case = case_160(lines=401, seed=6)
    model = case.outside
    result = score(case, model, cramer_rao(case))
    assert result.found == 0
    assert result.false == ()
    assert np.isnan(result.median_damping_error)


def test_errors_are_relative_and_signed():
    case = case_160(lines=401, seed=6)
    bound = cramer_rao(case)
    poles = poles_from(case.truth.natural_frequencies * 1.00001, case.truth.damping_ratios * 0.98)
    result = score(case, replace(case.truth, poles=poles), bound)
    assert result.frequency_error == pytest.approx(np.full(20, 1e-5), rel=1e-6)
    assert result.damping_error == pytest.approx(np.full(20, -0.02), rel=1e-6)
    assert result.median_damping_error == pytest.approx(0.02)
    assert result.damping_ratio == pytest.approx(-0.02 * case.truth.damping_ratios / bound.damping_std, rel=1e-6)


def test_true_poles_alone_find_every_mode():
    case = case_160(lines=801, seed=9)
    result = score(case, modes_of_poles(case, case.truth.poles), cramer_rao(case))
    assert result.found == 20
    assert np.nanmedian(result.residue_error) < 0.02


def test_bare_poles_may_be_none():
    case = case_160(lines=101, seed=9)
    result = score(case, modes_of_poles(case, np.zeros(0, complex)), cramer_rao(case))
    assert result.found == 0
    assert result.false == ()


def test_the_bound_is_proportional_to_the_noise():
    quiet, loud = (cramer_rao(case_160(lines=201, noise=noise, seed=8)) for noise in (0.001, 0.01))
    assert loud.damping_std == pytest.approx(10 * quiet.damping_std, rel=1e-5)
    assert loud.frequency_std == pytest.approx(10 * quiet.frequency_std, rel=1e-5)


def test_maximum_likelihood_scatters_as_the_bound_says():
    """Monte Carlo: weighted least squares in modal form on 300 draws; the sample variance of 300 scatters by 8 %."""
    case = tiny()
    bound = cramer_rao(case)
    assert len(case.outside.poles) == 0
    factor = (2j * np.pi * case.frfs.frequencies) ** 2
    flat_std = case.noise_std.reshape(len(factor), -1)
    start = np.concatenate([case.truth.poles, case.truth.participation[1] / case.truth.participation[0]])
    size = np.abs(start)

    def residual(parameters, values):
        poles, ratio = (size * (parameters[:4] + 1j * parameters[4:])).reshape(2, 2)
        direct, mirrored = (factor[:, None] * part for part in pole_basis(case.frfs.frequencies, poles))
        rest = []
        for output in range(4):
            columns = []
            for mode in range(2):
                over = [(direct[:, mode] * share, mirrored[:, mode] * np.conj(share)) for share in (1.0, ratio[mode])]
                columns.append(
                    np.concatenate([(a + b) / case.noise_std[:, output, i] for i, (a, b) in enumerate(over)])
                )
                columns.append(
                    np.concatenate([1j * (a - b) / case.noise_std[:, output, i] for i, (a, b) in enumerate(over)])
                )
            matrix = np.stack(columns, axis=1)
            target = (values[:, output] / case.noise_std[:, output]).T.ravel()
            matrix, target = np.vstack([matrix.real, matrix.imag]), np.concatenate([target.real, target.imag])
            orthogonal = np.linalg.qr(matrix)[0]
            rest.append(target - orthogonal @ (orthogonal.T @ target))
        return np.concatenate(rest)

    rng = np.random.default_rng(2024)
    begin = np.concatenate([(start / size).real, (start / size).imag])
    draws = []
    for _ in range(300):
        noise = np.sqrt(0.5) * (rng.standard_normal(flat_std.shape) + 1j * rng.standard_normal(flat_std.shape))
        values = case.clean + (flat_std * noise).reshape(case.clean.shape)
        found = least_squares(residual, begin, args=(values,), method="lm").x
        draws.append(size[:2] * (found[:2] + 1j * found[4:6]))
    frequency_std = np.std(np.abs(draws) / (2 * np.pi), axis=0)
    damping_std = np.std(damping_ratios(np.array(draws)), axis=0)
    assert frequency_std / bound.frequency_std == pytest.approx(np.ones(2), abs=0.15)
    assert damping_std / bound.damping_std == pytest.approx(np.ones(2), abs=0.15)


def _run(seed: int, poles: float, selection: float, **more: object) -> dict:
    return {
        "seed": seed,
        "version": "1.0",
        "time_poles": poles,
        "time_selection": selection,
        "time_wall": poles,
        "extra_memory": 3e6,
        "data_bytes": 2e6,
        "found": 19,
        "identifiable": 20,
        "missed": [[123.4, 0.05]],
        "false": [],
        "damping_error": 4e-4,
        "damping_bias": -1e-4,
        "frequency_ratio": 1.1,
        "damping_ratio": 1.2,
        "residue_error": 0.01,
        "residue_error_largest": 0.02,
        "bound_damping": 3e-4,
        "bound_frequency": 2e-6,
        **more,
    }


def test_the_pages_hold_medians_ratios_and_every_miss():
    machine = {
        "processor": "p",
        "cores": 2,
        "system": "Linux",
        "python": "3.11",
        "numpy": "2",
        "scipy": "1",
        "numba": "0",
    }
    row = {
        "title": "a case",
        "seeds": [1, 2, 3],
        "date": "2026-01-02",
        "machine": machine,
        "runs": {
            OURS: [_run(1, 0.1, 0.1), _run(2, 0.1, 0.3), _run(3, 0.1, 0.2, missed=[], false=[77.0])],
            "pyfbs": [_run(1, 3.0, 0.0), {"seed": 2, "error": "not finished within 9 s"}],
        },
    }
    page = speed(row)
    assert "| friction-ema 1.0 | 0.1 | 0.2 | 0.3 | 0.1 | 1.5 |  |" in page
    assert "| pyFBS 1.0 | 3 | <0.001 | 3 | 3 | 1.5 | 10 |" in page
    assert "pyFBS 1.0, seed 2: not finished within 9 s" in page
    page = accuracy(row)
    assert "| friction-ema 1.0 | nothing | 19 + 19 + 19 | 20 + 20 + 20 | 0 + 0 + 1 | 0.04 | -0.01 | 1.1 | 1.2 |" in page
    assert "friction-ema 1.0, seed 3: false 77 Hz" in page
    assert "pyFBS 1.0, seed 1: missed 123.4 Hz (5.00 %)" in page
    assert "Seeds: 1, 2, 3." in page
