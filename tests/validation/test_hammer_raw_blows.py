"""Five raw blows on one point (data of ladisk/pyFRF, not part of this project): coherence, force spectrum, peaks."""

import numpy as np
import pytest

from ema.data import Channel, Condition, Recording, Run
from ema.dof import Dof
from ema.estimate import hammer_test, quality


@pytest.fixture(scope="module")
def measured(datasets):
    folder = datasets / "03_raw_hammer_blows"
    channels = (
        Channel("force", Dof(1, "+Z"), quantity="force", role="reference"),
        Channel("acceleration", Dof(2, "+Z"), quantity="acceleration"),
    )
    records = []
    for number in range(1, 6):
        signals = np.load(folder / f"measurements_{number}.npy", allow_pickle=False)
        assert 1 / (signals[0, 1] - signals[0, 0]) == pytest.approx(25600)
        records.append(Recording(signals[1:], 25600.0, channels, name=f"measurements_{number}"))
    return hammer_test(Run("raw blows", Condition(), tuple(records)))


@pytest.mark.parametrize(("low", "high", "coherence"), [(20, 500, 0.9985), (500, 2000, 0.9996), (2000, 5000, 0.998)])
def test_coherence(measured, low, high, coherence):
    frfs, _ = measured
    assert np.median(frfs.band(low, high).coherence) >= coherence - 1e-4


def test_force_spectrum(measured):
    _, gallery = measured
    assert gallery.usable_band[1] == pytest.approx(6900, rel=0.03)
    assert [hit.accepted for hit in gallery.hits] == [True] * 5
    assert all(68 < hit.peak < 90 for hit in gallery.hits)


def test_peaks(measured):
    from scipy.signal import find_peaks

    frfs, _ = measured
    places, _ = find_peaks(np.abs(frfs.values[:, 0, 0]), prominence=1.0)
    for wanted in (810.31, 899.99, 2640.27, 3669.03, 4127.8, 4163.5, 4391.8, 5970.3):
        assert np.min(np.abs(frfs.frequencies[places] - wanted)) <= 1.5 * frfs.frequency_step


def test_missing_unit_is_reported(measured):
    frfs, gallery = measured
    assert frfs.unit == "unstated"
    assert "unit-unstated" in {finding.code for finding in frfs.findings}
    assert not [f for f in quality(frfs.band(100, 6000), hits=gallery) if f.severity == "error"]
