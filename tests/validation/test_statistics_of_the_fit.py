"""Statistics of the fit where the data are unusual: what the intervals rest on, and what is found of a mode few see."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ema.fit import modes, stabilise
from ema.fit.uncertainty import shape_std
from tests.bench.accuracy import Kept
from tests.unit.fit_rig import frfs, model

FREQUENCIES, DAMPING = [120.0, 150.0], [0.004, 0.006]


def measured(seed, dofs=8, drive=(0, 3)):
    return frfs(model(FREQUENCIES, DAMPING, dofs=dofs, drive=drive), 100, 180, 401, noise=0.01, seed=seed)


def fitted(one, **how):
    return modes(one, stabilise(one, range(4, 17, 2)), near=FREQUENCIES, **how)


@cache
def fitted_once(seed, drive=(0, 3)):
    """The fit of one measurement as it is, with which several others are compared."""
    return fitted(measured(seed, drive=drive))


def std(found):
    return np.sqrt(found.covariance[:, [0, 1], [0, 1]])


@pytest.mark.parametrize("way", ["columns", "rows"])
def test_the_same_frfs_four_times_tell_no_more_than_once(way):
    """Copies hold the same noise: counted as independent they would halve the intervals."""
    once, often = [], []
    for seed in range(6):
        one = measured(seed, drive=(0,))
        if way == "columns":
            other = replace(measured(seed, drive=(0, 3, 4, 5)), values=np.repeat(one.values, 4, axis=2))
        else:
            other = replace(measured(seed, dofs=32, drive=(0,)), values=np.repeat(one.values, 4, axis=1))
        once.append(std(fitted_once(seed, (0,))))
        found = fitted(other)
        assert "noise that the FRFs share" in found.uncertainty.basis
        often.append(std(found))
    ratio = np.mean(often, axis=0) / np.mean(once, axis=0)
    assert np.all((ratio > 0.75) & (ratio < 1.4))


def test_a_local_mode_seen_in_three_of_forty_outputs():
    truth = model([120.0, 150.0, 165.0], [0.004, 0.006, 0.005], dofs=40)
    shapes = np.array(truth.shapes)
    shapes[:, 2] = 0
    shapes[[0, 7, 8], 2] = [0.4, 1.0, -0.8]
    local = replace(truth, shapes=shapes, participation=shapes[:1] / (2j * truth.poles.imag))
    one = frfs(local, 100, 180, 401, noise=0.01)
    found = modes(one, stabilise(one))
    np.testing.assert_allclose(found.natural_frequencies, [120.0, 150.0, 165.0], rtol=1e-4)
    assert np.all(found.confidence > 0.5)


@pytest.mark.parametrize("bad", [np.nan, 1.5, 1.0])
def test_a_coherence_that_says_nothing_leaves_the_scatter_over_lines(bad):
    one = measured(0)
    found = fitted(replace(one, coherence=np.full(one.values.shape, bad), averages=np.full(one.values.shape[1:], 3.0)))
    assert found.uncertainty.basis.startswith("scatter of the residuals over the lines")
    np.testing.assert_array_equal(found.covariance, fitted_once(0).covariance)


def test_a_variance_of_zero_leaves_the_scatter_over_lines():
    one = measured(0)
    found = fitted(replace(one, variance=np.zeros(one.values.shape)))
    assert found.uncertainty.basis.startswith("scatter of the residuals over the lines")
    np.testing.assert_array_equal(found.covariance, fitted_once(0).covariance)


def test_real_shapes_have_intervals_that_hold_the_truth():
    """Real modes: the drive point makes the scale, so that the shapes of the truth are compared as they are."""
    inside, truth = [], model(FREQUENCIES, DAMPING, dofs=8, drive=(0, 3))
    for seed in range(8):
        found = fitted(measured(seed), shapes="real")
        error = found.shapes.real * np.sign(np.sum(found.shapes.real * truth.shapes.real, axis=0)) - truth.shapes.real
        inside.append(np.abs(error) < 1.96 * shape_std(found).real)
        assert not shape_std(found).imag.any()
    assert np.mean(inside) >= 0.85, "95 % of 128 but for what the drive points share"


def test_misfit_at_the_peaks_is_in_the_intervals():
    """A softening resonance is no pole: two parts of the band give different ones, and the intervals say so."""
    one = frfs(model([150.0], [0.002], dofs=4), 100, 200, 1601, noise=1e-4)
    size = np.abs(one.values[:, :1]) / np.abs(one.values[:, :1]).max()
    shift = 4e-4 * size**2
    f = one.frequencies[:, None, None]
    moved = np.stack(
        [
            np.interp((f * (1 + shift)).ravel(), one.frequencies, part).reshape(-1, 1)
            for row in range(4)
            for part in [one.values[:, row, 0].real]
        ],
        axis=1,
    ) + 1j * np.stack(
        [
            np.interp((f * (1 + shift)).ravel(), one.frequencies, part).reshape(-1, 1)
            for row in range(4)
            for part in [one.values[:, row, 0].imag]
        ],
        axis=1,
    )
    softening = replace(one, values=moved)
    found = [
        modes(part, stabilise(part), near=[150.0]) for part in (softening.band(100, 170), softening.band(140, 200))
    ]
    a, b = found
    assert all("scatter of the residuals" in part.uncertainty.basis for part in found)
    spread = np.sqrt(a.covariance[0].diagonal() + b.covariance[0].diagonal())
    assert abs(a.natural_frequencies[0] - b.natural_frequencies[0]) < 1.96 * spread[0]
    # The linear structure with the same noise: its intervals are far narrower.
    assert std(a)[0, 0] > 5 * std(modes(one, stabilise(one), near=[150.0]))[0, 0]


def test_an_interrupted_bench_goes_on_where_it_was(tmp_path):
    path, made = tmp_path / "draws.jsonl", []

    def make(number):
        if number == 3 and len(made) == 3:
            raise KeyboardInterrupt
        made.append(number)
        return {"number": number}

    seed = Kept(path, resume=False).seed("x")
    with pytest.raises(KeyboardInterrupt):
        Kept(path, resume=True).items("x", 5, make)
    made.append(None)
    kept = Kept(path, resume=True)
    assert kept.seed("x") == seed
    assert [one["number"] for one in kept.items("x", 5, make)] == [0, 1, 2, 3, 4]
    assert made == [0, 1, 2, None, 3, 4]
