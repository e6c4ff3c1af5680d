"""Rounding by the uncertainty."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.report.numbers import fixed, plain, rounded, short, with_uncertainty


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (499.02134, 0.0461, "499.021 ± 0.046"),
        (499.02134, 0.0996, "499.02 ± 0.10"),
        (1018.3, 27.4, "1018 ± 27"),
        (123456.0, 2345.0, "123500 ± 2300"),
        (0.6381, 0.0072, "0.6381 ± 0.0072"),
        (5.0, 0.95, "5.00 ± 0.95"),
        (5.0, 0.996, "5.0 ± 1.0"),
        (499.02134, None, "499.02"),
        (499.02134, 0.0, "499.02"),
        (math.nan, 1.0, "–"),
        (499.02134, math.nan, "499.02"),
    ],
)
def test_value_and_uncertainty_end_at_the_same_digit(value, uncertainty, text):
    assert str(with_uncertainty(value, uncertainty)) == text


@given(value=st.floats(-1e6, 1e6), uncertainty=st.floats(1e-6, 1e5))
def test_what_is_written_is_within_a_tenth_of_the_uncertainty(value, uncertainty):
    shown, spread = (float(part) for part in str(with_uncertainty(value, uncertainty)).split(" ± "))
    assert abs(shown - value) <= 0.0501 * uncertainty + 1e-9 * abs(value)
    assert spread == pytest.approx(uncertainty, rel=0.0501)


def test_other_forms():
    assert [str(plain(x, 3)) for x in (0.0, 1.23456, 1234.5, 1.2e-7, 3.4e8)] == [
        "0",
        "1.23",
        "1234",
        "1.20e-07",
        "3.40e+08",
    ]
    assert str(plain(None)) == str(plain(math.inf)) == str(fixed(None, 2)) == short(None) == "–"
    assert str(rounded(230.0, 0.5)) == "230.00"
    assert plain(1 / 3, 2).value == 1 / 3
