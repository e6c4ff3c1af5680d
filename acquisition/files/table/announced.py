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


@dataclass(frozen=True)
class Clock:
    """A sampling rate in Hz that a header states, and by how much of it the digits are rounded."""

    rate: float
    rounding: float


def _matches(pattern: re.Pattern[str], header: tuple[str, ...]) -> Iterator[re.Match[str]]:
    return (found for line in header if (found := pattern.match(line)))


def rate(header: tuple[str, ...]) -> Clock | None:
    """The sampling rate that a line such as ``Sampling Rate(Hz),50`` or ``dt = 0.02 s`` states with its unit."""
    for found in _matches(_RATE, header):
        unit = found["before"] or found["after"]
        if unit:
            prefix = {"k": 1e3, "m": 1e6}.get(unit[0].lower(), 1.0) if len(unit) > 2 and unit[0] in "kKmM" else 1.0
            return Clock(_number(found) * prefix, 0.0)
    for found in _matches(_INTERVAL, header):
        known = units.known(found["before"] or found["after"] or "")
        if known is not None and _number(found) > 0:
            return Clock(1.0 / (_number(found) * known.factor), _rounding(found))
    return None


def _number(found: re.Match[str]) -> float:
    return float(found["number"].replace(",", "."))


def _rounding(found: re.Match[str]) -> float:
    """Half of the last digit of a number, relative to it."""
    digits = re.sub(r"[eE].*", "", found["number"]).replace(",", ".")
    places = len(digits.partition(".")[2])
    return 0.5 * 10.0**-places / float(digits) if float(digits) else 0.0


def contradiction(header: tuple[str, ...], measured: float) -> float | None:
    """The rate in Hz of a stated interval that is not that of the time axis, whatever unit the interval is in."""
    for found in _matches(_INTERVAL, header):
        stated = _number(found)
        known = units.known(found["before"] or found["after"] or "")
        factors = _SECONDS if known is None else (known.factor,)
        within = CLOCK + _rounding(found)
        if stated > 0 and all(abs(stated * factor * measured - 1) > within for factor in factors):
            return 1.0 / (stated * factors[0])
    return None


def rows(header: tuple[str, ...]) -> int | None:
    """The number of rows that lines such as ``Record Length,2500`` state, where they agree."""
    stated = {int(number) for found in _matches(_COUNT, header) for number in re.findall(r"\d+", found["numbers"])}
    return stated.pop() if len(stated) == 1 else None
