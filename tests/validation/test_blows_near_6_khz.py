"""Why 5969.6 Hz and not 5970.3 Hz: five raw blows on one point (data of ladisk/pyFRF, not part of this project).

The value of 5970.3 Hz that goes with these data comes from a fit of one pole to a few lines. Its answer depends on the
lines, because a small mode lies 14 Hz above; a model that holds both modes gives one answer.
"""

import numpy as np
import pytest
from scipy.optimize import least_squares

import acquisition
from ema import estimate, fit


@pytest.fixture(scope="module")
def frfs(root, datasets):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EMA_DATASETS", str(datasets))
        run = acquisition.open_campaign(root / "datasets" / "hammer_blows")["blows"]
        return estimate.hammer(run).band(500, 6500)


def one_pole(frfs, low, high):
    """Natural frequency in Hz of one pole, its residue and a straight line, by least squares over some lines."""
    band = frfs.band(low, high)
    s = 2j * np.pi * band.frequencies
    measured = band.values[:, 0, 0] / np.abs(band.values).max()
    trend = np.linspace(-1, 1, len(s))

    def miss(pole):
        basis = np.column_stack([1 / (s - pole[0] - 1j * pole[1]), np.ones_like(s), trend])
        rest = basis @ np.linalg.lstsq(basis, measured, rcond=None)[0] - measured
        return np.concatenate([rest.real, rest.imag])

    start = 2 * np.pi * 5970 * np.array([-0.001, 1.0])
    return float(np.hypot(*least_squares(miss, start, x_scale=[1, 10]).x) / 2 / np.pi)


def test_a_fit_of_one_pole_depends_on_its_lines(frfs):
    windows = [(5966, 5975), (5964, 5976), (5962, 5980), (5960, 5980), (5955, 5985), (5950, 5990)]
    found = np.array([one_pole(frfs, *window) for window in windows])
    assert np.all((found > 5968.4) & (found < 5970.8))
    assert np.ptp(found) > 1.0, "more than three times the tolerance of the value"


def test_a_model_with_the_small_mode_does_not(frfs):
    for low, high in ((5900, 6040), (5850, 6030)):
        band = frfs.band(low, high)
        modes = fit.modes(band, fit.stabilise(band), near=[5969.6, 5983.7])
        # the tolerance of the listed value, less than a third of what one pole scatters; windows differ by 0.2 Hz
        assert modes.natural_frequencies[0] == pytest.approx(5969.6, abs=0.3)
        assert modes.natural_frequencies[1] == pytest.approx(5983.7, abs=0.5)
        assert modes.damping_ratios[0] == pytest.approx(0.00097, rel=0.05)
