"""Swept beside stepped sines on the work table: figures of the page on maps."""

import pytest

from tests.bench.work_table_sweeps import SETTINGS, read


def test_a_slow_sweep_reads_what_steps_read_and_a_fast_one_does_not():
    """Bending slip, 6 N and 25 N: steady states are passed slowly at 20 Hz/s, within 0.3 Hz and 3 %. At 160 Hz/s the
    upward sweep is ahead of the response: the resonance seems to lie higher."""
    steps, slow, fast = (read(SETTINGS["bending"], 6.0, 25.0, rate) for rate in (None, 20.0, 160.0))
    assert slow.frequency == pytest.approx(steps.frequency, abs=0.3)
    assert slow.damping == pytest.approx(steps.damping, rel=0.03)
    assert 0.5 < fast.frequency - steps.frequency < 2.0
