"""Mode indicator functions show the modes that made the FRFs."""

from dataclasses import replace

import numpy as np
import pytest

from ema import synthesis
from ema.fit import cmif, mode_indicator, multivariate_mode_indicator
from tests.unit.fit_rig import frfs, model, transposed


def pair():
    truth = model([120.0, 150.0, 150.0, 185.0], [0.004, 0.005, 0.005, 0.004], drive=(0, 7))
    return truth, frfs(truth, 100, 200, 2001)


def local(values, frequencies, near, width=1.0):
    rows = np.flatnonzero(np.abs(frequencies - near) <= width)
    return rows, values[rows]


def test_cmif_is_the_squared_singular_values():
    _, measured = pair()
    values = cmif(measured)
    assert values.shape == (2001, 2)
    k = 700
    gram = np.linalg.eigvalsh(measured.values[k].conj().T @ measured.values[k])[::-1]
    np.testing.assert_allclose(values[k], gram, rtol=1e-9)
    np.testing.assert_allclose(cmif(transposed(measured)), values, rtol=1e-9)


def test_the_second_value_of_cmif_peaks_at_a_repeated_root_only():
    _, measured = pair()
    second, f = cmif(measured)[:, 1], np.asarray(measured.frequencies)
    assert f[np.argmax(second)] == pytest.approx(150.0, abs=0.2)
    for single in (120.0, 185.0):
        _, values = local(second, f, single, 0.5)
        assert values.max() < 0.02 * second.max()


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_the_indicator_dips_at_the_modes(quantity):
    _, measured = pair()
    measured = synthesis.convert(measured, quantity)
    indicator, f = mode_indicator(measured), np.asarray(measured.frequencies)
    assert np.all((indicator >= 0) & (indicator <= 1 + 1e-12))
    for wanted in (120.0, 150.0, 185.0):
        rows, values = local(indicator, f, wanted)
        assert f[rows[np.argmin(values)]] == pytest.approx(wanted, abs=0.1)
        assert values.min() < 0.1
    assert indicator[np.argmin(np.abs(f - 135.0))] > 0.9


@pytest.mark.parametrize("quantity", ["receptance", "mobility", "accelerance"])
def test_the_second_multivariate_value_dips_at_the_repeated_root(quantity):
    _, measured = pair()
    measured = synthesis.convert(measured, quantity)
    values, f = multivariate_mode_indicator(measured), np.asarray(measured.frequencies)
    assert values.shape == (2001, 2)
    assert np.all(values[:, 0] <= values[:, 1] + 1e-12)
    assert np.all((values > -1e-9) & (values < 1 + 1e-9))
    at = int(np.argmin(np.abs(f - 150.0)))
    assert values[at, 1] < 0.1
    for single in (120.0, 185.0):
        at = int(np.argmin(np.abs(f - single)))
        assert values[at, 0] < 0.1 and values[at, 1] > 0.5
    np.testing.assert_allclose(multivariate_mode_indicator(transposed(measured)), values, atol=1e-9)


def test_zeros_and_single_frfs_are_no_trouble():
    _, measured = pair()
    silent = replace(measured, values=0 * measured.values)
    assert np.all(mode_indicator(silent) == 0)
    assert np.all(np.isfinite(multivariate_mode_indicator(silent)))
    single = measured.pick([0], [0])
    assert cmif(single).shape == (2001, 1)
    np.testing.assert_allclose(cmif(single)[:, 0], np.abs(single.values[:, 0, 0]) ** 2, rtol=1e-12)
