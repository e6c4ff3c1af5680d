"""Swept sine on a thin plate, five takes (ladisk/mssp-image-tutorial, not part of this project)."""

import numpy as np
import pytest

from ema.data import Channel, Condition, Recording, Run
from ema.dof import Dof
from ema.estimate import sweep


@pytest.fixture(scope="module")
def frfs(datasets):
    import h5py

    channels = (
        Channel("force", Dof(1, "+Z"), quantity="force", role="reference", unit="N"),
        Channel("acceleration", Dof(1, "+Z"), quantity="acceleration", unit="m/s^2"),
        Channel("trigger", quantity="voltage", role="trigger", unit="V"),
    )
    records = []
    for path in sorted((datasets / "04_plate_swept_sine").glob("*.hdf5")):
        with h5py.File(path) as file:
            records.append(Recording(file["InputTask/data"][()].T.copy(), 25600.0, channels, name=path.name))
    assert len(records) == 5
    return sweep(Run("plate", Condition(), tuple(records)))


def test_median_coherence(frfs):
    assert np.median(frfs.band(60, 500).coherence) == pytest.approx(0.997, abs=0.001)


def test_sweep_band_is_found(frfs):
    assert frfs.frequencies[0] < 60
    assert 480 < frfs.frequencies[-1] < 520


@pytest.mark.parametrize("peak", [78, 126.5, 266, 352, 454])
def test_peaks(frfs, peak):
    size = np.abs(frfs.values[:, 0, 0])
    near = np.abs(frfs.frequencies - peak) <= 1.5
    around = np.abs(frfs.frequencies - peak) <= 3.0
    assert size[near].max() == size[around].max()


def test_group_of_peaks(frfs):
    size = np.abs(frfs.values[:, 0, 0])
    group = (frfs.frequencies > 215) & (frfs.frequencies < 227)
    around = (frfs.frequencies > 190) & (frfs.frequencies < 250)
    assert size[group].max() == size[around].max()
