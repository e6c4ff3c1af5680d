"""What a newcomer waits for: the first call of every solver compiles its kernels, in a process that has none."""

import pytest

from tests.bench.simulate import FIRST_CALLS, first_call
from tests.timing import slowness

LONGEST = 20.0
"""s of processor time."""


@pytest.mark.parametrize("name", FIRST_CALLS)
def test_the_first_call_takes_less_than_20_s(name):
    assert first_call(FIRST_CALLS[name]) <= LONGEST * slowness()
