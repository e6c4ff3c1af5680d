"""Modes of sets that are larger than memory: the same as in memory, in four passes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import synthesis
from ema.data import FrfSet, ModalModel
from ema.errors import InputError
from ema.fit import modes, stabilise
from ema.fit.range_finder import range_finder
from ema.fit.uncertainty import residue_std, shape_std
from tests.unit.fit_rig import model, transposed
from tests.unit.test_windows import damage, written

FIVE = ([120.0, 140.0, 165.0, 190.0, 215.0], [0.01, 0.006, 0.012, 0.008, 0.01])


def scan(outputs: int, lines: int, seed: int, stated: bool = True, size: float = 0.0) -> tuple[ModalModel, FrfSet]:
    """Five modes; noise of 5 % and another level at each output and reference, and ``size`` times each value."""
    truth = model(*FIVE, dofs=outputs, drive=(0, outputs // 3), phase=0.1, seed=seed)
    exact = synthesis.frfs(truth, np.linspace(100.0, 240.0, lines), "accelerance")
    rng = np.random.default_rng([9, seed])
    level = 0.05 * np.sqrt(np.mean(np.abs(exact.values) ** 2)) * np.exp(rng.normal(0, 1, (outputs, 1)))
    std = level * np.array([1.0, 1.5]) + size * np.abs(exact.values)
    noise = np.sqrt(0.5) * rng.standard_normal((*exact.values.shape, 2)).view(complex)[..., 0]
    variance = np.broadcast_to(std**2, exact.values.shape) if stated else None
    return truth, replace(exact, values=exact.values + std * noise, variance=variance, name="scan")


def passes(found: FrfSet) -> float:
    return found.values.source.bytes_read / found.values.nbytes


def assert_same(large: ModalModel, small: ModalModel, within: float, ratio: float) -> None:
    """Values to ``within`` standard deviations, and these to ``ratio``."""
    assert len(large.poles) == len(small.poles) and large.dofs == small.dofs and large.scaling == small.scaling
    std = np.sqrt(small.covariance[:, [0, 1], [0, 1]])
    assert np.all(np.abs(large.natural_frequencies - small.natural_frequencies) < within * std[:, 0])
    assert np.all(np.abs(large.damping_ratios - small.damping_ratios) < within * std[:, 1])
    np.testing.assert_allclose(np.sqrt(large.covariance[:, [0, 1], [0, 1]]), std, rtol=ratio)
    own, other = residue_std(large), residue_std(small)
    change = large.residues() - small.residues()
    assert np.all(np.abs(change.real) < within * other.real) and np.all(np.abs(change.imag) < within * other.imag)
    for one, two in ((own, other), (shape_std(large), shape_std(small))):
        np.testing.assert_allclose(one.real, two.real, rtol=ratio)
        np.testing.assert_allclose(one.imag, two.imag, rtol=ratio)


def test_modes_of_a_set_in_a_file_are_those_in_memory(tmp_path: Path):
    _, whole = scan(300, 401, seed=1)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)), within=0.01, ratio=0.01)
    assert "compressed" in {finding.code for finding in large.findings}


def test_modes_of_a_set_without_variance_are_those_in_memory(tmp_path: Path):
    """The level of the noise of an FRF comes from its residual: in memory from that of its own fit, here from that of
    the channels, which follows 10 of 802 real values less. A level that is off by 1.2 % moves a residue by as much of
    what another weight of the same lines would, a few hundredths of its standard deviation.
    """
    _, whole = scan(300, 401, seed=1, stated=False)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)), within=0.05, ratio=0.03)


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="damping of one of five modes differs by 0.011 standard deviations, goal 0.01")
def test_two_thousand_outputs_are_the_same_as_in_memory(tmp_path: Path):
    """Both are at the optimum of their own weights (another step promises 1e-9 standard deviations); damping ratios are
    lower by 0.003 to 0.011, frequencies differ by 0.0003, standard deviations by 5e-7.
    """
    _, whole = scan(2000, 1601, seed=3)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)), within=0.01, ratio=0.01)


@pytest.mark.parametrize(
    "seed",
    [
        2,
        31,
        pytest.param(
            32,
            marks=pytest.mark.xfail(
                strict=True, reason="20 of 3000 residues differ by 0.20 to 0.27 standard deviations, goal 0.2"
            ),
        ),
    ],
)
def test_noise_that_grows_with_the_frf_leaves_the_same_intervals(tmp_path: Path, seed: int):
    """Weights follow from an estimated structure of the noise, which is that of the fit where it was estimated: values
    may differ by what such weights change, and the full set decides about residual terms as it does in memory.
    """
    truth, whole = scan(300, 401, seed=seed, size=0.05)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert_same(large, modes(whole, stabilise(whole)), within=0.2, ratio=0.1)
    std = np.sqrt(large.covariance[:, [0, 1], [0, 1]])
    assert np.all(np.abs(large.natural_frequencies - truth.natural_frequencies) < 5 * std[:, 0])
    assert np.all(np.abs(large.damping_ratios - truth.damping_ratios) < 5 * std[:, 1])


@pytest.mark.xfail(
    strict=True,
    reason="noise that grows with the FRF is read once more for the channels: five passes and more, goal four",
)
def test_noise_that_grows_with_the_frf_takes_no_further_pass(tmp_path: Path):
    found = written(tmp_path / "scan.h5", scan(300, 401, seed=2, size=0.05)[1])
    modes(found, stabilise(found))
    assert passes(found) <= 4


def test_forces_that_rove_over_a_set_in_a_file(tmp_path: Path):
    _, whole = scan(300, 401, seed=4)
    roving = transposed(whole)
    found = written(tmp_path / "scan.h5", roving, step=2)
    assert found.values.shape == (401, 2, 300)
    assert_same(modes(found, stabilise(found)), modes(roving, stabilise(roving)), within=0.01, ratio=0.01)


def test_a_dead_output_is_left_out_and_a_damaged_value_named(tmp_path: Path):
    _, whole = scan(300, 401, seed=5, stated=False)
    values = np.array(whole.values)
    values[:, 17] = 0
    found = written(tmp_path / "dead.h5", replace(whole, values=values))
    large = modes(found, stabilise(found))
    assert whole.outputs[17] not in large.dofs and len(large.dofs) == 299
    assert "dead-output" in {finding.code for finding in large.findings}
    values[200, 150, 1] = np.nan
    spoiled = written(tmp_path / "nan.h5", replace(whole, values=values))
    with pytest.raises(InputError, match=r"scan, 151:\+Z/101:\+Z: .*NaN or infinite"):
        stabilise(spoiled)


def test_a_chunk_that_is_damaged_before_the_third_pass_is_one_sentence(tmp_path: Path):
    _, whole = scan(300, 401, seed=6)
    found = written(tmp_path / "scan.h5", whole)
    table = stabilise(found)
    damage(tmp_path / "scan.h5", output=100)
    with pytest.raises(InputError, match=r"values at .* a part of the file is damaged"):
        modes(found, table)


def test_range_finder_keeps_the_energy_that_a_decomposition_keeps():
    """Against the singular values of numpy: 40 directions in noise, 500 rows in uneven slabs.

    After one power iteration noise of energy e turns a direction of energy E by (e / E)^3 of its energy (Halko et al.
    2011, theorem 9.1 with the exponent 2 q + 1), times a factor of the numbers of rows and directions.
    """
    rng = np.random.default_rng(8)
    signal = rng.standard_normal((500, 40)) * np.geomspace(1e4, 10, 40) @ rng.standard_normal((40, 900)) / 30
    matrix = signal + rng.standard_normal((500, 900))
    read = []

    def slabs():
        read.append(1)
        for first in range(0, 500, 70):
            yield matrix[first : first + 70]

    found = range_finder(slabs, 500, rank=80)
    strength = np.linalg.svd(matrix, compute_uv=False)
    assert len(read) == 2
    lost = 1 - found.energies[:40] / strength[:40] ** 2
    assert np.all(lost > -1e-9) and np.all(lost < 1e-9 + 10 * (strength[40] / strength[:40]) ** 6)
    np.testing.assert_allclose(found.directions.T @ found.directions, np.eye(80), atol=1e-10)
    np.testing.assert_allclose(found.directions.T @ matrix, found.compressed, atol=1e-6 * strength[0])
    left = np.linalg.norm(matrix - found.directions @ (found.directions.T @ matrix)) ** 2
    assert found.left_out == pytest.approx(left, rel=1e-6)
    # Theorem 10.5: twice the best of 40 directions at most is left out on the average, of 80 that were looked for.
    assert left < np.sum(strength[40:] ** 2)
    assert found.above(1.1) == np.count_nonzero(strength**2 > 1.1 * found.floor * (1 + np.sqrt(500 / 900)) ** 2)
