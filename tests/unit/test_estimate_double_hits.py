"""Second blows in signals with filter ringing, undershoot and noise: a small, fixed version of the benchmark."""

import numpy as np
import pytest

from ema.estimate.double_hits import opening
from tests.bench.hammer import CASES, one_case, verdict


@pytest.mark.parametrize("kind", CASES)
def test_verdicts(kind):
    rng = np.random.default_rng(20)
    wrong = [case for case in (one_case(rng, kind) for _ in range(150)) if not verdict(case)]
    assert len(wrong) <= 1, wrong


def test_opening_removes_pulses_and_keeps_slopes():
    ramp = np.linspace(0, -3, 200).astype(np.float32)
    bump = ramp.copy()
    bump[90:100] += 1
    np.testing.assert_array_equal(opening(ramp, 4), ramp)
    assert np.max(bump - opening(bump, 4)) == pytest.approx(1, abs=0.2)
