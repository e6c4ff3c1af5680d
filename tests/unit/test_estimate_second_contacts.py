"""Second contacts in signals with filter ringing, undershoot and noise: a small, fixed version of the benchmark."""

import numpy as np
import pytest

from ema.estimate import hammer_test
from ema.estimate.second_contacts import opening
from tests.bench.hammer import CASES, one_case, verdict
from tests.bench.hammer_records import RECORDS, draw


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


@pytest.mark.parametrize("records", RECORDS)
def test_second_contacts_at_any_delay_and_no_others(records):
    """10, 20 and 50 % of the impact, 5 to 500 ms behind it."""
    rng = np.random.default_rng(21)
    for second in (True, False):
        for _ in range(12):
            drawn = draw(rng, records, second=second)
            _, gallery = hammer_test(drawn.run)
            found = ["second contact" in hit.reason for hit in gallery.hits]
            assert any(found) == second, (drawn.delay, drawn.ratio)
            if second:
                assert found[drawn.impact] and sum(found) == 1
