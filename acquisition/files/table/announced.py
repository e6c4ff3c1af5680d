"""What the lines above a table announce: its sampling rate or interval, and how many rows it has."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from acquisition import units
from acquisition.files.signals import CLOCK

_VALUE = r"\s*[)\]]?[\s\"]*[:=,;\t]?[\s\"]*(?P<number>\d*[.,]?\d+(?:[eE][-+]?\d+)?)\s*\"?[,;\s]*"
_RATE = re.compile(
    r"^\W*(?:sampl\w*[ _-]?(?:rate|freq\w*)|abtast(?:rate|freq\w*)|fs)\s*[(\[]?\s*(?P<before>[kM]?Hz|[kM]?S/s)?"
    + _VALUE
    + r"(?P<after>[kM]?Hz|[kM]?S/s)?[\s;,\"]*$",
    re.IGNORECASE,
)
_INTERVAL = re.compile(
    r"^\W*(?:sampl\w*[ _-]?(?:interval|period|time|step)|abtast(?:intervall|zeit|schritt)|time[ _-]?(?:step|increment)"
    r"|(?:x[ _-]?)?increment|delta[ _-]?[tx]|dt)\s*[(\[]?\s*(?P<before>[mµun]?s|sec|seconds?)?"
    + _VALUE
    + r"(?P<after>[mµun]?s|sec|seconds?)?[\s;,\"]*$",
    re.IGNORECASE,
)
_COUNT = re.compile(
    r"^\W*(?:record[ _-]?length|maxlength|samples[ _-]per[ _-]channel|(?:number|no\.?|anzahl)(?:[ _-](?:of|der))?[ _-]"
    r"(?:data[ _-]?)?(?:samples|points|values|scans|rows|werte|messwerte|abtastwerte))[\s\"]*[:=,;\t]"
    r"(?P<numbers>[\s\"]*\d+(?:[\s\",;]+\d+)*)[\s,;\"]*$",
    re.IGNORECASE,
)
_SECONDS = (1.0, 1e-3, 1e-6, 1e-9)
"""Units that an interval without one may have, in s."""
_HERTZ = (1.0, 1e3, 1e6)
"""Units that a rate without one may have, in Hz."""


@dataclass(frozen=True)
class Clock:
    """A sampling rate in Hz that a header states, and by how much of it the digits are rounded."""

    rate: float
    rounding: float


def _matches(pattern: re.Pattern[str], header: tuple[str, ...]) -> Iterator[re.Match[str]]:
    return (found for line in header if (found := pattern.match(line)))


def rate(header: tuple[str, ...], decimal: str) -> Clock | None:
    """The sampling rate that a line such as ``Sampling Rate(Hz),50`` or ``dt = 0.02 s`` states with its unit.

    A number that may be one or a thousand, ``2,048`` above a table with the decimal mark ``.``, states nothing.
    """
    for found in _matches(_RATE, header):
        unit, readings = found["before"] or found["after"], _readings(found, decimal)
        if unit and len(readings) == 1:
            return Clock(readings[0] * _prefix(unit), 0.0)
    for found in _matches(_INTERVAL, header):
        known, readings = units.known(found["before"] or found["after"] or ""), _readings(found, decimal)
        if known is not None and len(readings) == 1 and readings[0] > 0:
            return Clock(1.0 / (readings[0] * known.factor), _rounding(found))
    return None


def _prefix(unit: str) -> float:
    return {"k": 1e3, "m": 1e6}.get(unit[0].lower(), 1.0) if len(unit) > 2 and unit[0] in "kKmM" else 1.0


def _readings(found: re.Match[str], decimal: str) -> tuple[float, ...]:
    """What a number may be: two values where its mark is not that of the table and may part thousands."""
    text = found["number"]
    value = float(text.replace(",", "."))
    if decimal not in text and re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", text):
        return (value, 1e3 * value)
    return (value,)


def _rounding(found: re.Match[str]) -> float:
    """Half of the last digit of a number, relative to it."""
    digits = re.sub(r"[eE].*", "", found["number"]).replace(",", ".")
    places = len(digits.partition(".")[2])
    return 0.5 * 10.0**-places / float(digits) if float(digits) else 0.0


def contradiction(header: tuple[str, ...], measured: float, decimal: str) -> float | None:
    """A stated rate in Hz, or that of a stated interval, which is not the measured one in whatever unit it may be."""
    for found in _matches(_RATE, header):
        unit = found["before"] or found["after"]
        multiples = (_prefix(unit),) if unit else _HERTZ
        rates = [value * multiple for value in _readings(found, decimal) for multiple in multiples]
        if rates[0] > 0 and all(abs(rate / measured - 1) > CLOCK for rate in rates):
            return rates[0]
    for found in _matches(_INTERVAL, header):
        known = units.known(found["before"] or found["after"] or "")
        factors = _SECONDS if known is None else (known.factor,)
        steps = [value * factor for value in _readings(found, decimal) for factor in factors]
        within = CLOCK + _rounding(found)
        if steps[0] > 0 and all(abs(step * measured - 1) > within for step in steps):
            return 1.0 / steps[0]
    return None


def rows(header: tuple[str, ...]) -> int | None:
    """The number of rows that lines such as ``Record Length,2500`` state, where they agree."""
    stated = {int(number) for found in _matches(_COUNT, header) for number in re.findall(r"\d+", found["numbers"])}
    return stated.pop() if len(stated) == 1 else None
