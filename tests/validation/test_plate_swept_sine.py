"""Swept sine on a thin plate at four force levels (ladisk/mssp-image-tutorial): homogeneity, take by take.

Coherence and peaks of the five takes together are in ``test_hammer_swept_plate.py``.
"""

import numpy as np
import pytest

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.estimate import homogeneity, sweep

PEAKS = (78.0, 126.5, 266.0, 352.0, 454.0)


@pytest.fixture(scope="module")
def takes(datasets):
    """FRFs of every take, with its largest force as level."""
    import h5py

    channels = (
        Channel("force", Dof(1, "+Z"), quantity="force", role="reference", unit="N"),
        Channel("acceleration", Dof(2, "+Z"), quantity="acceleration", unit="m/s^2"),
        Channel("trigger", quantity="voltage", role="trigger", unit="V"),
    )
    found = {}
    for path in sorted((datasets / "04_plate_swept_sine").glob("*.hdf5")):
        with h5py.File(path) as file:
            record = Recording(file["InputTask/data"][()].T.copy(), 25600.0, channels, name=path.stem)
        level = float(np.abs(record.signals[0]).max())
        found[path.stem] = sweep(Run(path.stem, Condition(Excitation("sweep", level)), (record,)), band=(60, 500))
    return found


def test_force_levels(takes):
    """Force peaks of 2.5, 3.3, 3.3, 3.4 and 5.0 N."""
    levels = sorted(one.condition.excitation.level for one in takes.values())
    assert levels == pytest.approx([2.5, 3.3, 3.3, 3.4, 5.0], abs=0.05)


@pytest.mark.parametrize("peak", PEAKS)
def test_a_doubled_force_changes_the_frfs_more_than_a_repeated_one(takes, peak):
    """Takes at one level differ by 5 to 12 % at the peaks, which bounds what the index can tell here; from 2.5 to
    5.0 N they differ by 18 to 54 %, and the finding says so."""
    repeated = homogeneity(takes["view_0"], takes["view_0_02"], peak)
    doubled = homogeneity(takes["view_0_04"], takes["view_0_03"], peak)
    assert doubled.levels == pytest.approx((2.46, 5.01), abs=0.01)
    assert 0.04 < repeated.index < 0.13
    assert 0.15 < doubled.index < 0.6
    assert doubled.index > 1.9 * repeated.index
    assert doubled.findings[0].code == "not-homogeneous"
