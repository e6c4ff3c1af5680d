"""A take is judged while its impact can still be repeated."""

from dataclasses import replace

import numpy as np
import pytest

from ema.errors import InputError
from ema.estimate import check_hit, check_impact
from ema.simulate import Fault
from tests.unit.estimate_rig import hammer_rig


def codes(take, severity=None):
    return {one.code for one in check_impact(take) if severity in (None, one.severity)}


@pytest.fixture(scope="module")
def takes():
    faults = (Fault(1, 0, "double hit", strength=0.3, delay=0.02),)
    return list(hammer_rig(noise=0.1, hits=1, faults=faults).takes())


def test_a_clean_impact_has_nothing_against_it(takes):
    assert codes(takes[0], "error") == codes(takes[0], "warning") == set()


def test_a_double_hit_and_an_overload_are_named_and_the_take_is_lost(takes):
    found = check_impact(takes[1])
    assert [one.code for one in found if one.severity == "error"] == ["no-impact"]
    assert any(one.code == "double-hit" and "second contact of 3" in one.message for one in found)
    channels = tuple(replace(one, range=10.0) if one.role == "reference" else one for one in takes[0].channels)
    assert {"no-impact", "overload"} <= codes(replace(takes[0], channels=channels))


def test_a_reversed_hammer_and_silence(takes):
    signals = takes[0].signals.copy()
    signals[0] *= -1
    assert "force-sign" in codes(replace(takes[0], signals=signals))
    signals[0] = 0
    (only,) = check_impact(replace(takes[0], signals=signals))
    assert (only.code, only.severity, only.advice) == ("no-trigger", "error", "Strike again.")


def test_a_take_that_cannot_be_judged(takes):
    signals = takes[0].signals.copy()
    signals[1, 100] = np.nan
    with pytest.raises(InputError, match="the first at sample 100"):
        check_impact(replace(takes[0], signals=signals))


def test_the_former_name_still_works_and_says_so(takes):
    with pytest.warns(DeprecationWarning, match="check_impact"):
        assert check_hit(takes[0]) == check_impact(takes[0])
