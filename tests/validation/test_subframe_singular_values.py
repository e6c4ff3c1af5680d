"""Peaks of singular values are not all modes: steel subframe of DaISy (De Moor (ed.), KU Leuven, 96-013).

The list that goes with these data was read from the complex mode indicator function of a Hann-2048 estimate. It holds
234 Hz, where the singular value curves of two well separated modes cross, and 468 Hz, the highest of four lines of
nearly equal height on top of one resonance.
"""

import numpy as np
import pytest
from scipy.signal import find_peaks

import acquisition
from ema import estimate, fit, synthesis
from ema.shapes import mac

FIRST = (62.5, 119, 154.5, 192.5, 214.5, 229.5, 239.5, 287, 321, 334, 352, 398, 417.5, 468)
SECOND = (156.5, 234)


@pytest.fixture(scope="module")
def run(root, datasets):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EMA_DATASETS", str(datasets))
        return acquisition.open_campaign(root / "datasets" / "steel_subframe")["random"]


@pytest.fixture(scope="module")
def hann(run):
    return estimate.shaker(run, method="welch", block=2048)


@pytest.fixture(scope="module")
def sharp(run):
    return estimate.shaker(run)


@pytest.fixture(scope="module")
def pair(sharp):
    band = sharp.band(205, 265)
    return fit.modes(band, fit.stabilise(band))


def singular_values(frfs):
    return np.linalg.svd(frfs.values, compute_uv=False)


def test_every_value_of_the_list_is_a_peak_of_a_singular_value(hann):
    values = singular_values(hann)
    for row, wanted in ((0, FIRST), (1, SECOND)):
        peaks = hann.frequencies[find_peaks(values[:, row])[0]]
        for frequency in wanted:
            assert np.abs(peaks - frequency).min() <= 0.6, frequency


@pytest.mark.parametrize("estimated", ["hann", "sharp"])
def test_multiple_coherence_and_inputs(estimated, request):
    frfs = request.getfixturevalue(estimated)
    assert 0.98 < np.median(frfs.band(10, 500).coherence) <= 1.0
    (correlation,) = [finding for finding in frfs.findings if finding.code == "input-correlation"]
    assert correlation.severity == "info"
    assert correlation.value < 0.15


def test_all_modes_show_in_the_singular_values_of_the_local_model(sharp):
    """468 Hz apart, which is no mode."""
    frfs = sharp.band(40, 500)
    logarithm = np.log(singular_values(frfs))
    for row, wanted in ((0, FIRST[:-1]), (1, SECOND)):
        peaks = frfs.frequencies[find_peaks(logarithm[:, row], prominence=0.3)[0]]
        for frequency in wanted:
            assert np.abs(peaks - frequency).min() <= 0.6, frequency


def test_no_mode_is_found_between_the_two_told_nothing(pair):
    found = pair.natural_frequencies
    assert found == pytest.approx([214.97, 229.44, 239.34], abs=0.1)


def test_the_two_modes_are_orthogonal(pair):
    assert mac(pair.shapes[:, 1:2], pair.shapes[:, 2:3])[0, 0] < 0.05


@pytest.mark.parametrize("estimated", ["hann", "sharp"])
def test_two_modes_make_the_peak_at_234_hz(estimated, pair, request):
    """Without any mode there, the model shows the second singular value of the measurement, peak and all."""
    band = request.getfixturevalue(estimated).band(231, 238)
    model = synthesis.frfs(pair, band.frequencies, band.quantity, outputs=band.outputs, inputs=band.inputs)
    measured, rebuilt = (singular_values(one)[:, 1] for one in (band, model))
    assert rebuilt == pytest.approx(measured, rel=0.04)
    assert band.frequencies[measured.argmax()] == pytest.approx(234, abs=0.6)
    assert band.frequencies[rebuilt.argmax()] == pytest.approx(234, abs=0.6)
    # there the two modes are equally strong: the curves of the first and second value touch
    alone = [singular_values(one_mode(pair, mode, band))[:, 0] for mode in (1, 2)]
    crossing = band.frequencies[np.abs(np.log(alone[0] / alone[1])).argmin()]
    assert crossing == pytest.approx(234, abs=0.6)


def one_mode(model, mode, like):
    """The FRFs of one mode alone."""
    from dataclasses import replace

    alone = replace(
        model,
        poles=model.poles[[mode]],
        shapes=model.shapes[:, [mode]],
        participation=model.participation[:, [mode]],
        residuals=None,
        covariance=None,
        confidence=None,
    )
    return synthesis.frfs(alone, like.frequencies, like.quantity, outputs=like.outputs, inputs=like.inputs)


def test_468_hz_is_a_line_on_a_flat_top_and_the_pole_lies_below(run, hann, sharp):
    """Averages under a Hann window of twice the length put the pole at 467.25 and 467.27 Hz, 0.03 Hz uncertain."""
    longer = estimate.shaker(run, method="welch", block=4096)
    top = hann.band(466.9, 468.1)
    values = singular_values(top)[:, 0]
    assert list(top.frequencies) == [467.0, 467.5, 468.0]
    assert top.frequencies[values.argmax()] == 468.0, "the value of the list"
    assert values.min() > 0.95 * values.max(), "but the lines below are as high"
    for low, high in ((440, 500), (455, 480)):
        smooth, found = (
            fit.modes(one, fit.stabilise(one), near=[467.2]) for one in (longer.band(low, high), sharp.band(low, high))
        )
        assert smooth.natural_frequencies == pytest.approx([467.25], abs=0.05)
        assert found.natural_frequencies == pytest.approx(smooth.natural_frequencies, abs=0.15)
