"""Quantities of units as people write them, without an error where a text is none."""

import acquisition


def quantity_of(text: str) -> str:
    """Return what a unit measures, such as ``"force"`` for ``"kN"``; empty where the text is no unit.

    Examples
    --------
    >>> quantity_of("kN"), quantity_of("m/s^2"), quantity_of("moon")
    ('force', 'acceleration', '')
    """
    from ema.errors import UnitError

    try:
        return acquisition.quantities.measure(f"1 {text}")[1]
    except UnitError:
        return ""
