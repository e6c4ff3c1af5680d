"""Modes of sets that are larger than memory: the same as in memory, in four passes."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import synthesis
from ema.data import FrfSet, ModalModel
from ema.errors import InputError
from ema.fit import compression, modes, stabilise
from ema.fit.compression import compressed
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


def assert_same(
    large: ModalModel, small: ModalModel, within: float = 0.001, ratio: float = 0.001, *, residues: float | None = None
) -> None:
    """Values to ``within`` standard deviations (``residues`` to as many of their own), and these to ``ratio``."""
    assert len(large.poles) == len(small.poles) and large.dofs == small.dofs and large.scaling == small.scaling
    std = np.sqrt(small.covariance[:, [0, 1], [0, 1]])
    assert np.all(np.abs(large.natural_frequencies - small.natural_frequencies) < within * std[:, 0])
    assert np.all(np.abs(large.damping_ratios - small.damping_ratios) < within * std[:, 1])
    np.testing.assert_allclose(np.sqrt(large.covariance[:, [0, 1], [0, 1]]), std, rtol=ratio)
    own, other = residue_std(large), residue_std(small)
    change, within = large.residues() - small.residues(), within if residues is None else residues
    assert np.all(np.abs(change.real) < within * other.real) and np.all(np.abs(change.imag) < within * other.imag)
    for one, two in ((own, other), (shape_std(large), shape_std(small))):
        np.testing.assert_allclose(one.real, two.real, rtol=ratio)
        np.testing.assert_allclose(one.imag, two.imag, rtol=ratio)


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_modes_of_a_set_in_a_file_are_those_in_memory(tmp_path: Path, seed: int, stated: bool):
    _, whole = scan(300, 401, seed=seed, stated=stated)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)))
    assert "compressed" in {finding.code for finding in large.findings}


@pytest.mark.parametrize("seed", [3, 5])
def test_a_pole_that_follows_the_noise_of_the_channels_is_left_out(tmp_path: Path, seed: int):
    """Channels are the directions with most noise: a pole found there is none that all outputs ask for."""
    _, whole = scan(300, 401, seed=seed)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)))


@pytest.mark.slow
def test_two_thousand_outputs_are_the_same_as_in_memory(tmp_path: Path):
    _, whole = scan(2000, 1601, seed=3)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)))


@pytest.mark.parametrize("seed", [2, 31, 32, 61, 62])
def test_noise_that_grows_with_the_frf_leaves_the_same_values_and_intervals(tmp_path: Path, seed: int):
    """Weights follow from an estimated structure of the noise, by fits in which all lines count the same; those of
    some channels are near those of all outputs, and no more.
    """
    truth, whole = scan(300, 401, seed=seed, size=0.05)
    found = written(tmp_path / "scan.h5", whole)
    large = modes(found, stabilise(found))
    assert passes(found) <= 4
    assert_same(large, modes(whole, stabilise(whole)), within=0.01, ratio=0.01, residues=0.1)
    std = np.sqrt(large.covariance[:, [0, 1], [0, 1]])
    assert np.all(np.abs(large.natural_frequencies - truth.natural_frequencies) < 5 * std[:, 0])
    assert np.all(np.abs(large.damping_ratios - truth.damping_ratios) < 5 * std[:, 1])


def test_the_noise_of_channels_is_that_of_their_outputs(tmp_path: Path):
    """Against the sum over all outputs of their stated variance, for channels that show resonances.

    Weights that are off by a factor of 1.15 raise a standard deviation by 0.5 % at most (Kantorovich's inequality).
    """
    _, whole = scan(300, 401, seed=71, size=0.3)
    packed = compressed(written(tmp_path / "scan.h5", whole))
    shares = packed.directions**2 / packed.scale[:, None] ** 2
    exact = np.einsum("oc,foi->fci", shares, whole.variance)
    off = np.log(packed.frfs.variance / exact)[:, :10]
    assert np.sqrt(np.mean(off**2)) < np.log(1.15) and np.max(np.abs(off)) < np.log(2)
    assert np.max(exact[:, :10] / exact[:, :10].min(axis=0)) > 5


def test_directions_of_noise_alone_have_the_noise_that_they_were_chosen_for(tmp_path: Path):
    truth, whole = scan(2000, 401, seed=72)
    packed = compressed(written(tmp_path / "scan.h5", whole))
    exact = synthesis.frfs(truth, whole.frequencies, "accelerance").values
    of_channels = np.einsum("oc,foi->fci", packed.directions / packed.scale[:, None], whole.values - exact)
    energy = np.mean(np.abs(of_channels) ** 2 / packed.frfs.variance, axis=(0, 2))
    assert len(energy) >= 20
    np.testing.assert_allclose(energy, 1, rtol=0.15)


def test_forces_that_rove_over_a_set_in_a_file(tmp_path: Path):
    _, whole = scan(300, 401, seed=4)
    roving = transposed(whole)
    found = written(tmp_path / "scan.h5", roving, step=2)
    assert found.values.shape == (401, 2, 300)
    assert_same(modes(found, stabilise(found)), modes(roving, stabilise(roving)))


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


def test_a_chunk_that_is_damaged_in_the_middle_of_the_third_pass_is_one_sentence(tmp_path: Path, monkeypatch):
    _, whole = scan(300, 401, seed=6)
    path = tmp_path / "scan.h5"
    found = written(path, whole)
    table = stabilise(found)
    monkeypatch.setattr(compression, "_AT_ONCE", 1_000_000)
    reached = []

    def spoil(task: str, done: int, total: int) -> None:
        if task == "information" and done >= 100 and not reached:
            reached.append(done)
            damage(path, output=250)

    with pytest.raises(InputError, match=r"values at .* a part of the file is damaged.*backup"):
        modes(found, table, progress=spoil)
    assert reached and 2 < passes(found) < 3


def test_compression_needs_no_disk(tmp_path: Path):
    """Where no file can be written any more, a set in a file is fitted as ever."""
    _, whole = scan(300, 401, seed=7)
    written(tmp_path / "scan.h5", whole)
    script = (
        "import resource, sys\n"
        "from ema import store\n"
        "from ema.fit import modes, stabilise\n"
        "found = store.load(sys.argv[1])\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
        "sys.stderr.write(str(len(modes(found, stabilise(found)).poles)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "scan.h5")], stderr=subprocess.PIPE, text=True, check=False
    )
    assert done.returncode == 0 and done.stderr == "5"


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
