"""What a text says of polar data: whether an amplitude is linear or in dB re what, and the unit of a phase."""

import re
import unicodedata
from dataclasses import dataclass, replace

import numpy as np

from acquisition import units
from ema.errors import UnitError
from ema.units import UNSTATED

_LINEAR = re.compile(r"^(lin|linear)$", re.IGNORECASE)
_DECIBEL = re.compile(r"(?<![A-Za-z])(?:[dD][bB]|decibels?|[dD]ezibel)(?![A-Za-z])\s*(?P<rest>.*)$")
_LOGARITHMIC = re.compile(
    r"dB|(?<![A-Za-z])(?:db|DB|[lL]og(?!g)|LOG)|(?<![A-Za-z])(?i:decibel|dezibel|level|pegel)(?![A-Za-z])"
)
"""Words of a logarithmic amplitude, whether they say which one or not."""
_REFERENCE = re.compile(r"^(?:(?:re|ref|rel)\b\.?|reference|relative\s+to|:)\s*", re.IGNORECASE)
_OVER = re.compile(r"^/\s*(?=\.?\d[\d.]*(?:[eE][-+]?\d+)?\s+\S)")
"""A reference behind a stroke, ``dB/1.00 (m/s^2)/N``: a number and a unit; ``dB/10`` is none."""
_NUMBER = re.compile(r"^([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*[*·]?\s*(.*)$")
_DEGREES = re.compile(r"(?<![^\W\d_])(?:(?i:deg(?:rees?|s)?|degr[eé]s?|gradi|grados)|Grad)(?![^\W\d_])|°")
_RADIANS = re.compile(r"(?<![A-Za-z])rad(?:ians?|s)?(?![A-Za-z])(?!\s*/)", re.IGNORECASE)
_FACTOR_BEFORE = re.compile(r"(?:\d|pi|π|[*·×])\s*[*·×/]?\s*$|(?:^|[(\[])\s*[-−+]\s*$", re.IGNORECASE)
_FACTOR_BEHIND = re.compile(r"^\s*(?:[*·×/^²]|\d|pi|π)", re.IGNORECASE)
"""Factors and signs beside a unit of phase, which make another unit of it: ``pi rad``, ``deg/10``, ``-deg``."""
_LINEAR_WORD = re.compile(r"(?<![A-Za-z])lin(ear)?(?![A-Za-z])", re.IGNORECASE)
_SCALE_ALONE = re.compile(
    r"lin(ear)?|d[Bb](?![A-Za-z]).*|(unwrapp?ed\s+)?(deg(rees?|s)?|°|rad(ians?|s)?)([,\s]+unwrapp?ed)?", re.IGNORECASE
)
_UNWRAPPED = re.compile(r"unwrapp?ed", re.IGNORECASE)


@dataclass(frozen=True)
class AmplitudeScale:
    """How an amplitude is written: linear in a ``unit``, or in ``decibels`` re ``reference`` times that unit.

    ``reference`` is ``None`` where an amplitude in dB states none.
    """

    unit: str = UNSTATED
    decibels: bool = False
    reference: float | None = 1.0


@dataclass(frozen=True)
class PhaseScale:
    """How a phase is written: radians per unit of the numbers, and whether it runs on beyond a turn."""

    unit: str
    factor: float
    unwrapped: bool = False


def amplitude_scale(text: str) -> AmplitudeScale | None:
    """The scale that a text states: ``linear``, a unit such as ``g/N``, ``dB``, ``dB re 1e-6 m/N``; else ``None``.

    Raises
    ------
    UnitError : a reference that is none.
    """
    text = text.strip()
    if _LINEAR.match(text):
        return AmplitudeScale()
    decibel = _DECIBEL.search(text)
    if decibel is not None:
        return _decibels(decibel["rest"], text)
    unit = units.known(text) if text else None
    return None if unit is None or not unit.stated else AmplitudeScale(text)


def _decibels(rest: str, text: str) -> AmplitudeScale:
    """The scale in dB whose reference stands in ``rest``, behind the letters dB."""
    rest = re.sub(r"^[\s)\]]+", "", rest).rstrip()
    while rest and rest[-1] in ")]" and rest.count(")") + rest.count("]") > rest.count("(") + rest.count("["):
        rest = rest[:-1].rstrip()
    rest = _OVER.sub("", _REFERENCE.sub("", rest))
    if rest[:1] + rest[-1:] in ("()", "[]") and units.known(rest) is None:
        rest = _REFERENCE.sub("", rest[1:-1].strip())
    if not rest:
        return AmplitudeScale(decibels=True, reference=None)
    if rest.lower() == UNSTATED:
        return AmplitudeScale(decibels=True)
    found = _NUMBER.match(rest) if not re.match(r"^1\s*/", rest) else None
    number, unit = (float(found[1]), found[2].strip()) if found else (1.0, rest)
    if not (np.isfinite(number) and number > 0) or (unit and units.known(unit) is None):
        raise UnitError(
            "not a reference of an amplitude in dB",
            got=repr(text),
            expected="a unit, or a number with a unit, as in 'dB re 1e-6 m/N'",
        )
    return AmplitudeScale(unit or UNSTATED, True, number)


def phase_scale(text: str) -> PhaseScale | None:
    """The unit that a text states: ``deg``, ``°``, ``rad``, ``unwrapped rad`` and the like; else ``None``."""
    unwrapped = says_unwrapped(text)
    degrees, radians = _DEGREES.search(text), _RADIANS.search(text)
    found = degrees or radians
    if found is None or (degrees and radians):
        return None
    if _FACTOR_BEFORE.search(text[: found.start()]) or _FACTOR_BEHIND.search(text[found.end() :]):
        return None
    return PhaseScale("deg", np.pi / 180, unwrapped) if degrees else PhaseScale("rad", 1.0, unwrapped)


def phase_in_words(label: str, title: str) -> PhaseScale | None:
    """What stands where a unit belongs, else what the words of the title say; ``None`` where they contradict."""
    there = [phase_scale(label), phase_scale(title)]
    said = {scale.unit for scale in there if scale is not None}
    both = _DEGREES.search(title) and _RADIANS.search(title)
    if both or len(said) != 1 or (there[0] is None and label and units.known(label) is not None):
        return None
    chosen = there[0] or there[1]
    return None if chosen is None else replace(chosen, unwrapped=says_unwrapped(title) or says_unwrapped(label))


def says_unwrapped(text: str) -> bool:
    """Whether a text calls a phase unwrapped."""
    return _UNWRAPPED.search(text) is not None


def check_scales(amplitude_unit: str | None, phase_unit: str | None) -> None:
    """Refuse scales of a layout that are none.

    Raises
    ------
    UnitError : an amplitude neither linear nor in dB nor in a unit, or a unit that is none of a phase.
    """
    if amplitude_unit is not None and amplitude_scale(amplitude_unit) is None:
        raise UnitError(
            "not a scale of an amplitude",
            got=repr(amplitude_unit),
            expected="'linear', a unit such as 'g/N', or 'dB re 1 (m/s^2)/N'",
        )
    if phase_unit is not None and phase_scale(phase_unit) is None:
        raise UnitError(
            "not a unit of phase", got=repr(phase_unit), expected="'deg', 'rad', 'unwrapped deg' or 'unwrapped rad'"
        )


def is_unit(cell: str) -> bool:
    """Whether a cell of a line of units is empty, a unit, or the scale of an amplitude or phase."""
    text = cell.strip("[]() ")
    return not text or _SCALE_ALONE.fullmatch(text) is not None or units.known(text) is not None


def bare_title(title: str) -> str:
    """The title of a column without accents and words that state its scale: ``FRF magnitude dB`` -> ``magnitude``."""
    words = re.split(r"[\s_\-.,:;()\[\]]+", without_accents(_DECIBEL.sub("", title)).lower().replace("°", ""))
    drop = re.compile(
        r"^(|deg(rees?|s)?|degres?|grad|gradi|grados|rad(ians?|s)?|lin|linear|unwrapp?ed|wrapped|in|of|the|frf|h[12v])$"
    )
    sign = "-" if re.match(r"^\s*[-−]\s*[^\W\d]", title) else ""  # of a turned phase
    return sign + " ".join(word for word in words if not drop.match(word))


def without_accents(text: str) -> str:
    """The letters of a text without accents: ``Fréquence`` -> ``Frequence``."""
    return "".join(letter for letter in unicodedata.normalize("NFD", text) if not unicodedata.combining(letter))


def amplitude_in_words(label: str, title: str) -> AmplitudeScale | None:
    """What stands where a unit belongs and the words of the title say together; ``None`` where they say too little.

    A unit beside dB is the reference (``Magnitude dB (g/N)``). A unit beside other words of logarithms is no statement.

    Raises
    ------
    UnitError : a reference that is none.
    """
    scale = amplitude_scale(label)
    if scale is not None and scale.decibels:
        return scale
    decibel = _DECIBEL.search(title)
    if decibel is not None:
        if scale is not None and scale.unit != UNSTATED:
            return _beside(scale.unit, decibel["rest"], title)
        return None if _LINEAR_WORD.search(title) else _decibels(decibel["rest"], title)
    if _LOGARITHMIC.search(title):
        return None
    return scale or (AmplitudeScale() if _LINEAR_WORD.search(title) else None)


def _beside(unit: str, rest: str, title: str) -> AmplitudeScale:
    """The scale in dB re a unit that stands apart from what is said of dB: ``Level (dB re 1e-6) [m/N]``.

    Raises
    ------
    UnitError : what stands behind dB names another unit.
    """
    scale = _decibels(re.sub(r"[()\[\]]", " ", rest.replace(unit, " ")).strip(" /"), title)
    if scale.reference is None:
        return AmplitudeScale(unit, True)
    return replace(scale, unit=unit) if scale.unit == UNSTATED else scale


def says_logarithmic(title: str) -> bool:
    """Whether a title speaks of dB, levels or logarithms."""
    return _LOGARITHMIC.search(title) is not None
