"""Records whose samples were lost, repeated or filled in, against vibrations integrated in time."""

import numpy as np
import pytest
import scipy.signal

from ema.data import Channel, Recording
from ema.dof import Dof
from ema.estimate import shaker, sweep
from ema.estimate.breaks import breaks
from tests.unit.test_shaker_tests_attacked import FINER, RATE, chirp, noisy, record, run, said, times, vibration


def shaken(rng, seconds=12.0, noise=0.01):
    force = rng.normal(size=int((seconds + 4) * RATE) * FINER)
    force = 30 * scipy.signal.sosfilt(scipy.signal.butter(6, [10, 350], "band", fs=RATE * FINER, output="sos"), force)
    start = int(4 * RATE)
    return record(force[::FINER][start:], noisy(vibration(force), rng, noise)[:, start:])


def swept(rng, seconds=8.0, rest=4.0, noise=0.01):
    force = chirp(times(seconds + rest), (15.0, 240.0), seconds)
    return record(force[::FINER], noisy(vibration(force), rng, noise))


def lost(signals, at, count):
    return np.delete(signals, slice(at, at + count), axis=1)


def repeated(signals, at, count):
    signals[:, at : at + count] = signals[:, at - count : at]
    return signals


def held(signals, at, count):
    signals[:, at : at + count] = signals[:, at - 1 : at]
    return signals


def blank(signals, at, count):
    signals[:, at : at + count] = 0.0
    return signals


def slipped(signals, at, count):
    signals[2, at:-count] = signals[2, at + count :]
    return signals


def jumped(signals, at, count):
    signals[2, at:] += 3 * signals[2].std()
    return signals


def wrapped(signals, at, count):
    """A converter that runs over begins again at its other end."""
    top = 0.7 * np.abs(signals[2]).max()
    signals[2] = (signals[2] + top) % (2 * top) - top
    return signals


@pytest.mark.parametrize(
    ("fault", "least"), [(lost, 6), (repeated, 6), (held, 6), (blank, 6), (slipped, 4), (jumped, 6), (wrapped, 6)]
)
def test_records_that_break_are_named(fault, least):
    """They had made FRFs wrong by up to five of their standard deviations, without a word.

    One channel that slips goes on with a value near its last one at times: nothing breaks there.
    """
    rng = np.random.default_rng(71)
    named = 0
    for _ in range(6):
        at, count = int(rng.integers(3000, 9000)), int(rng.integers(20, 200)) if fault is not slipped else 4
        signals = fault(np.array(shaken(rng).signals), at, count)
        found = breaks(record(signals[0], signals[1:]))
        if fault is wrapped:
            named += len(found) > 1
        else:
            named += any(at - 1 <= one.sample <= at + count + 1 for one in found)
        if fault in (slipped, jumped, wrapped):
            assert {row for one in found for row in one.rows} <= {2}
    assert named >= least


def test_what_is_said_of_a_record_that_breaks():
    rng = np.random.default_rng(72)
    takes = [shaken(rng, 6.0), shaken(rng, 6.0)]
    assert not said(shaker(run(takes, "random")).findings, "signals-break")
    signals = lost(np.array(takes[1].signals), 4096, 100)
    (finding,) = said(
        shaker(run([takes[0], record(signals[0], signals[1:], "second")], "random")).findings, "signals-break"
    )
    assert "signals break at 4 s, in 5 of 5 response channels" in finding.message and finding.where.endswith("second")
    signals = jumped(np.array(swept(rng).signals), 5120, 0)
    (finding,) = said(sweep(run([record(signals[0], signals[1:])], "sweep")).findings, "signals-break")
    assert "signals break at 5 s, in 1 of 5 response channels, first in a2" in finding.message


@pytest.mark.parametrize("noise", [1e-4, 0.01, 0.1])
def test_signals_of_a_clean_test_do_not_break(noise):
    """Also where a sweep begins and ends at once, a force is noisy, and several sweeps follow each other."""
    rng = np.random.default_rng(73)
    for _ in range(4):
        assert not breaks(shaken(rng, noise=noise))
        take = swept(rng, noise=noise)
        noisy_force = noisy(take.signals[:1], rng, min(2 * noise, 0.2))
        assert not breaks(take)
        assert not breaks(record(noisy_force[0], take.signals[1:]))
    force = np.tile(chirp(times(2.0), (15.0, 240.0), 1.7), 6)
    assert not breaks(record(force[::FINER], noisy(vibration(force), rng, noise)))


def test_breaks_of_a_long_record_lie_where_they_are():
    """Records are looked at in parts, which overlap."""
    rng = np.random.default_rng(74)
    take = shaken(rng, seconds=270.0)
    at = [2**20 // 6 - 3, 2**20 // 6 + 40, 200_000]  # about the end of the first part of six channels
    signals = np.array(take.signals)
    for sample in at:
        signals[3, sample:] += 4 * signals[3].std() * (-1) ** at.index(sample)
    found = breaks(Recording(signals, RATE, take.channels))
    assert [one.sample for one in found] == at and all(one.rows == (3,) for one in found)


def test_records_of_real_shaker_tests_do_not_break(datasets):
    from scipy.io import loadmat

    signals = loadmat(datasets / "05_steel_subframe_mimo" / "flexible_structure_dat.mat")
    (values,) = (one for name, one in signals.items() if not name.startswith("__"))
    channels = tuple(
        Channel(f"c{k}", Dof(k + 1, "+Z"), "force" if k < 2 else "acceleration", "reference" if k < 2 else "response")
        for k in range(30)
    )
    assert not breaks(Recording(np.ascontiguousarray(values.T, dtype=float), 1024.0, channels))
