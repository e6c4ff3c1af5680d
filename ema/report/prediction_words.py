"""Values of a prediction with their bands, and how far they lie from what was measured, as a report says them."""

import math
from collections.abc import Sequence

from ema.messages import text
from ema.report.numbers import MISSING, Value, plain, rounded, short

MOST_SAID = 6
"""Conditions up to which the first screen says each; of more it says the first ones, and the table has the others."""
_LEAST = 1e-6
"""Part of a value beyond which no digit is shown, however narrow its band: no clock of a converter is better."""
_READABLE = (1e-4, 1e6)
"""Sizes of a value, or half of its band, outside of which powers of ten are shown, as in other tables."""
_SAME = 1e-9
"""Relative distance from the ends of what was measured that is rounding."""


def banded(low: float, value: float, high: float, factor: float = 1.0) -> tuple[Value, str]:
    r"""Return a value, and its band in words, both to the second digit of half of the band's width.

    Parameters
    ----------
    low, value, high : float
        Bounds and value; a bound that is not finite is open.
    factor : float, optional
        From the unit of the data to that of the page.

    Returns
    -------
    (Value, str)
        What the cells of a table, and the sentences about them, show.

    Examples
    --------
    >>> value, band = banded(0.0081, 0.0123, 0.0171, factor=100)
    >>> str(value), band.replace("\u00a0", " ")
    ('1.23', '0.81 to 1.71')
    """
    low, value, high = factor * low, factor * value, factor * high
    if not math.isfinite(value) or math.isnan(low) or math.isnan(high):
        return plain(value, 4), MISSING
    reaches = [(high - low) / 2, value - low, high - value]
    half = next((reach for reach in reaches if math.isfinite(reach)), None)
    if half is None:
        return plain(value, 4), text("open")
    half = max(half, _LEAST * abs(value))
    if not _READABLE[0] <= max(abs(value), half) < _READABLE[1]:
        shown, ends = plain(value, 3), [_end(plain(end, 3)) for end in (low, high)]
    else:
        shown, ends = rounded(value, half, 4), [_end(rounded(end, half, 4)) for end in (low, high)]
    # a band is not broken over lines
    return shown, text("{low} to {high}", low=ends[0], high=ends[1]).replace(" ", "\u00a0")


def _end(bound: Value) -> str:
    """A bound in words."""
    return str(bound) if math.isfinite(bound.value) else text("open")


def stated(value: float) -> Value:
    """A number that was given, or measured: without zeros at its end."""
    return Value(value, short(float(f"{value:.4g}")))


def against(value: float, low: float, high: float) -> str:
    """Say how far a value lies outside those that were measured, from the lowest to the highest of them."""
    if value > high * (1 + _SAME):
        return text("{factor} times the highest in the data", factor=f"{value / high:.3g}")
    if value < low * (1 - _SAME):
        return text("the lowest in the data over {factor}", factor=f"{low / value:.3g}")
    return text("within the data")


def first_ones(lines: Sequence[str]) -> list[str]:
    """Return the lines that the first screen says, with the last of them naming the table where there are more."""
    if len(lines) <= MOST_SAID:
        return list(lines)
    return [*lines[:MOST_SAID], text("The other conditions stand in the table of predicted values.")]
