"""Unit strings as people write them, turned into factors to SI; the only place that knows anything but SI."""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from math import isfinite
from typing import Any

from ema.errors import FailureError, UnitError
from ema.units import FRF_OF_RESPONSE, FRF_UNIT, QUANTITIES, SI_UNIT, STANDARD_GRAVITY, UNSTATED

_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
_SYMBOLS = {"·": "*", "⋅": "*", "×": "*", "µ": "u", "μ": "u", "Ω": "ohm", "°": "deg", "€": "", "Â": ""}
_WORDS = {
    "g": "accel_g",
    "gn": "accel_g",
    "g_n": "accel_g",
    "mg": "milliaccel_g",
    "ug": "microaccel_g",
    "kg_f": "kgf",
    "lbs": "lbf",
    "pound_force": "lbf",
    "newton": "N",
    "inch": "in",
    "ue": "microstrain_unit",
    "ustrain": "microstrain_unit",
    "microstrain": "microstrain_unit",
    "strain": "strain_unit",
    "ustr": "microstrain_unit",
    "mil": "thou",
    "mils": "thou",
    "degF": "degF",
    "degreeC": "degC",
    "sec": "s",
    "msec": "ms",
    "usec": "us",
}
_DIMENSIONS: dict[tuple[tuple[str, int], ...], str] = {
    (("[length]", 1), ("[mass]", 1), ("[time]", -2)): "force",
    (("[length]", 1), ("[time]", -2)): "acceleration",
    (("[length]", 1), ("[time]", -1)): "velocity",
    (("[length]", 1),): "displacement",
    (("[length]", -1), ("[mass]", 1), ("[time]", -2)): "pressure",
    (("[current]", -1), ("[length]", 2), ("[mass]", 1), ("[time]", -3)): "voltage",
    (("[temperature]", 1),): "temperature",
    (("[time]", 1),): "time",
    (("[length]", 2), ("[mass]", 1), ("[time]", -2)): "torque",
    (("[time]", -1),): "frequency",
    (("[mass]", 1),): "mass",
    (("[mass]", -1), ("[time]", 2)): "receptance",
    (("[mass]", -1), ("[time]", 1)): "mobility",
    (("[mass]", -1),): "accelerance",
    (): "ratio",
}
_OF_STRUCTURES: dict[tuple[tuple[str, int], ...], str] = {
    (("[length]", -3), ("[mass]", 1)): "density",
    (("[mass]", 1), ("[time]", -2)): "stiffness",
    (("[mass]", 1),): "mass",
    (("[length]", 2),): "area",
    (("[mass]", 1), ("[time]", -1)): "damping",
}
"""What describes a structure, and no sensor measures."""
_ANGULAR = {"frequency": "angular velocity", "ratio": "rotation"}
_TURNS = re.compile(r"(?<!ste)radian$|degree$|turn$|revolution$|grade$|revolutions_per_(minute|second)$")
"""How the names of units of angles end: they may have a prefix, as in krad/s."""
_LONGEST = 86400.0
"""The longest unit of time that is taken, in s: what makes it longer was meant otherwise (``Gs`` for g, ``a``)."""
_EXAMPLES = {
    "frequency": "Hz",
    "density": "kg/m^3",
    "stiffness": "N/m",
    "damping": "N s/m",
    "mass": "kg",
    "area": "m^2",
    "ratio": "%",
}
_USUAL = (
    "N",
    "kN",
    "mN",
    "MN",
    "lbf",
    "kip",
    "kgf",
    "m/s^2",
    "m/s²",
    "mm/s^2",
    "g",
    "mg",
    "in/s^2",
    "m/s",
    "mm/s",
    "in/s",
    "m",
    "mm",
    "um",
    "in",
    "ft",
    "Pa",
    "kPa",
    "MPa",
    "bar",
    "psi",
    "V",
    "mV",
    "degC",
    "degF",
    "K",
    "s",
    "ms",
    "us",
    "min",
    "N m",
    "N*m",
    "kN m",
    "in lbf",
    "Hz",
    "kHz",
    "rpm",
    "rad/s",
    "rad",
    "deg",
    "um/m",
    "microstrain",
    "strain",
    "%",
    "(m/s^2)/N",
    "g/N",
    "g/lbf",
    "(m/s)/N",
    "m/N",
    "mm/N",
    "mV/N",
    "mV/g",
    "mV/(m/s^2)",
    "mV/lbf",
    UNSTATED,
)
"""Spellings offered when a unit is not understood."""


@dataclass(frozen=True)
class Unit:
    """A unit: ``SI value = factor * value + offset``.

    ``quantity`` is one of :data:`ema.units.QUANTITIES`, an FRF quantity, ``frequency``, ``mass`` or ``ratio``.
    """

    text: str
    factor: float
    quantity: str
    offset: float = 0.0

    @property
    def stated(self) -> bool:
        """Whether the unit is known."""
        return self.text != UNSTATED

    @property
    def si(self) -> str:
        """Name of the SI unit that values have after conversion."""
        return SI_UNIT.get(self.quantity) or FRF_UNIT.get(self.quantity) or {"frequency": "Hz"}.get(self.quantity, "1")

    def to_si(self, values: Any) -> Any:
        """Values in this unit, converted to SI."""
        if self.factor == 1.0 and self.offset == 0.0:
            return values
        return self.factor * values + self.offset


@cache
def _registry() -> Any:
    """The table of units (pint), made on first use.

    Raises
    ------
    FailureError : pint cannot be used as it is installed.
    """
    try:
        import pint

        registry: Any = pint.UnitRegistry(cache_folder=None)
    except Exception as error:  # whatever it is, it says nothing about the unit that was asked for
        raise FailureError(
            f"the table of units cannot be loaded ({type(error).__name__}: {error})",
            advice=f'repair it with: "{sys.executable}" -m pip install -U pint',
        ) from error
    registry.define(f"accel_g = {STANDARD_GRAVITY!r} * meter / second ** 2")
    registry.define("strain_unit = []")
    registry.define("microstrain_unit = 1e-6 * strain_unit")
    return registry


def _spell(text: str) -> str:
    """The unit in one spelling: ``m/s²`` -> ``m/s^2``, ``N-m`` -> ``N*m``, ``°C`` -> ``degC``."""
    for symbol, word in _SYMBOLS.items():
        text = text.replace(symbol, word)
    text = re.sub(r"([⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+)", lambda found: "^" + found[0].translate(_SUPERSCRIPTS), text)
    text = text.replace("**", "^").replace("ε", "strain").strip()
    text = re.sub(r"^%$", "percent", text)
    text = re.sub(r"\bdeg\s+([CFK])\b", r"deg\1", text)
    text = re.sub(r"(?<=[A-Za-z])(-?\d)", r"^\1", text)  # m/s2, m s-2
    text = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "*", text)  # N-m, in-lbf
    return re.sub(r"\b(k?N)m\b", r"\1*m", text)


def _refuse(text: str, why: str = "not a unit", advice: str = "", expected: str | None = None) -> UnitError:
    from difflib import get_close_matches

    close = get_close_matches(text, _USUAL, n=3, cutoff=0.4) if not advice else []
    hint = advice or ("did you mean " + " or ".join(close) + "?" if close else "") or f'or unit = "{UNSTATED}"'
    return UnitError(why, got=repr(text), expected=expected, advice=hint)


@lru_cache(maxsize=1024)
def parse(text: str, of_structure: bool = False) -> Unit:
    """Understand a unit string such as ``m/s²``, ``g``, ``kip``, ``(m/s^2)/N`` or ``mV/g``.

    ``g`` is standard gravity, never gram. ``"unstated"`` gives a factor of 1. A ratio of voltage to something has the
    quantity ``"sensitivity"`` of :func:`sensitivity`, not of this function. ``of_structure`` admits masses, densities,
    stiffnesses and areas, which no sensor measures.

    Raises
    ------
    UnitError : the string is no unit, with the nearest known spelling.
    """
    text = text.strip()
    if text.lower() == UNSTATED:
        return Unit(UNSTATED, 1.0, UNSTATED)
    units, factor, offset = _resolve(text)
    dimension = tuple(sorted((name, power) for name, power in units.dimensionality.items()))
    names = set(units._units)
    if of_structure and dimension in _OF_STRUCTURES:
        return Unit(text, factor, _OF_STRUCTURES[dimension], offset)
    quantity = _DIMENSIONS.get(dimension, "")
    if any(map(_TURNS.search, names)):
        angular_acceleration = dimension == (("[time]", -2),)
        quantity = "angular acceleration" if angular_acceleration else _ANGULAR.get(quantity, quantity)
    if quantity == "ratio" and names & {"strain_unit", "microstrain_unit"}:
        quantity = "strain"
    if quantity == "ratio" and len(names) == 2 and all(units._units[name] in (1, -1) for name in names):
        quantity = "strain"  # um/m, mm/m
    if quantity == "mass":
        raise _refuse(text, "a mass is not what a sensor measures", "write lbf or kgf for a force, g for gravity")
    if quantity == "time" and (factor > _LONGEST or any(name.endswith("year") for name in names)):
        raise _refuse(text, "a unit of time that no measurement has", "write g for gravity, Pa for a pressure")
    if not quantity:
        raise _refuse(text, "a unit of no known quantity", expected="one of " + ", ".join(QUANTITIES))
    return Unit(text, factor, quantity, offset)


_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z_]+)|(?P<one>1)(?!\d)|(?P<power>\^(?:[+-]?\d|\([+-]?\d\)))|(?P<sign>[*/()]))"
)
Powers = dict[str, int]


def _powers(text: str) -> Powers:
    """Names of the units in the text with their powers: ``(m/s^2)/N`` -> ``{"m": 1, "s": -2, "N": -1}``."""
    tokens, position = [], 0
    text = _spell(text)
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            raise ValueError(text[position:])
        tokens.append((str(token.lastgroup), token[0].strip()))
        position = token.end()
    powers, rest = _product(tokens)
    if rest:
        raise ValueError(rest)
    return powers


def _product(tokens: list[tuple[str, str]]) -> tuple[Powers, list[tuple[str, str]]]:
    """One product or quotient, up to the closing bracket or the end, and the tokens behind it."""
    powers: Powers = {}
    side, wanted = 1, True  # wanted: a factor must follow
    while tokens and tokens[0] != ("sign", ")"):
        kind, text = tokens.pop(0)
        if kind == "sign" and text in "*/":
            if wanted:
                raise ValueError("two operators")
            side, wanted = (1 if text == "*" else -1), True
            continue
        if kind == "power":
            raise ValueError("a power of nothing")
        factor: Powers = {}
        if text == "(":
            factor, tokens = _product(tokens)
            if not tokens:
                raise ValueError("an open bracket")
            tokens.pop(0)
        elif kind == "name":
            spoken = len(text) > 3 and text[0].isupper() and text[1:].islower()  # Newtons, Volts, Pascal
            factor = {_WORDS.get(text, text.lower() if spoken else text): 1}
        exponent = int(re.sub(r"[^\d-]", "", tokens.pop(0)[1])) if tokens and tokens[0][0] == "power" else 1
        for name, power in factor.items():
            powers[name] = powers.get(name, 0) + side * exponent * power
        side, wanted = 1, False
    if wanted:
        raise ValueError("a factor is missing")
    return powers, tokens


def _resolve(text: str) -> tuple[Any, float, float]:
    """Units of the table with the factor and offset to SI base units."""
    if not text or len(text) > 40:
        raise _refuse(text, "not a unit" if text else "a unit is missing")
    registry = _registry()
    try:
        units = registry.Unit("")
        for name, power in _powers(text).items():
            units *= registry.parse_units(name, as_delta=False) ** power
        offset = float(registry.Quantity(0.0, units).to_base_units().magnitude)
        factor = (float(registry.Quantity(1000.0, units).to_base_units().magnitude) - offset) / 1000
    except Exception as error:  # the table raises errors of many kinds for a name that is no unit
        raise _refuse(text) from error
    if not 0 < abs(factor) < float("inf") or (offset and units.dimensionless):
        raise _refuse(text, "a logarithmic unit is not converted" if offset else "not a unit")
    return units, float(f"{factor:.{12 if offset else 15}g}"), float(f"{offset:.13g}")


_NUMBER = re.compile(r"^\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")


def _value(quantity: str) -> str:
    """A value of that quantity as an example."""
    return f'a value such as "1.02 {"kN" if quantity in ("", "force") else example(quantity)}"'


def split(text: str, quantity: str = "") -> tuple[float, str]:
    """Number and unit of a text such as ``"1.02 kN"``; ``quantity``: that of the example in a message.

    Raises
    ------
    UnitError : there is no number, no unit, or the number is too large to be one.
    """
    number = _NUMBER.match(text)
    if number is None:
        raise UnitError("no number before the unit", got=repr(text), expected=_value(quantity))
    if not number[2]:
        raise UnitError("a number without a unit", got=repr(text), expected=f'{_value(quantity)}, or "{UNSTATED}"')
    _refuse_endless(float(number[1]), text, quantity)
    return float(number[1]), number[2]


def _refuse_endless(value: float, text: str, quantity: str = "") -> None:
    """A number with an exponent beyond 308 is infinite to the machine."""
    if not isfinite(value):
        raise UnitError("not a finite number", got=repr(text), expected=_value(quantity))


def measure(text: str, quantity: str = "") -> tuple[float, str]:
    """SI value and quantity of a text with a number and a unit.

    Parameters
    ----------
    text : such as ``"1.02 kN"``; a number without a unit is refused.
    quantity : the quantity that is wanted, such as ``"force"``; any where it is empty.

    Raises
    ------
    UnitError : no number, no unit, an unknown unit, or a unit of another quantity than the one wanted.

    Examples
    --------
    >>> measure("1.02 kN", "force")
    (1020.0, 'force')
    >>> measure("21 degC")
    (294.15, 'temperature')
    """
    value, unit_text = split(text, quantity)
    unit = parse(unit_text, quantity in _OF_STRUCTURES.values())
    if quantity and unit.quantity != quantity:
        raise UnitError(
            f"not {'an' if quantity[0] in 'aeiou' else 'a'} {quantity}",
            got=repr(text),
            expected=f"a unit such as {example(quantity)}",
        )
    _refuse_endless(float(unit.to_si(value)), text, quantity)
    return float(unit.to_si(value)), unit.quantity


@lru_cache(maxsize=1024)
def named(quantity: str, factor: float) -> Unit:
    """The unit of a quantity that has this factor to SI, under its usual name where it has one."""
    for text in _USUAL:
        unit = known(text)
        if unit is not None and unit.quantity == quantity and not unit.offset and same_factor(unit.factor, factor):
            return unit
    return Unit(f"{factor:.6g} {SI_UNIT.get(quantity, '')}".strip(), factor, quantity)


def same_factor(one: float, other: float) -> bool:
    """Whether two factors are those of one unit, which data set 164 of universal files states with seven digits."""
    return abs(one / other - 1) < 1e-5


@lru_cache(maxsize=1024)
def of_frf(text: str) -> tuple[Unit, Unit] | None:
    """Units of response and force of an FRF in a unit such as ``g/lbf``; one that has no such parts is taken per N."""
    whole, (above, _, below) = known(text), text.rpartition("/")
    if whole is None or whole.quantity not in FRF_UNIT:
        return None
    bracket = re.fullmatch(r"\s*\(([^()]*)\)\s*", above)
    response, force = known(bracket[1] if bracket else above), known(below)
    if (
        response is not None
        and force is not None
        and response.quantity in FRF_OF_RESPONSE
        and force.quantity == "force"
    ):
        return response, force
    quantity = next(response for response, kind in FRF_OF_RESPONSE.items() if kind == whole.quantity)
    return Unit(f"{text} times N", whole.factor, quantity), parse("N")


def example(quantity: str) -> str:
    """A unit of that quantity."""
    return SI_UNIT.get(quantity) or FRF_UNIT.get(quantity) or _EXAMPLES.get(quantity, "1")


def sensitivity(text: str) -> tuple[float, str]:
    """Sensitivity in V per SI unit, and the quantity measured, of a text such as ``"2.25 mV/N"`` or ``"100 mV/g"``.

    Raises
    ------
    UnitError : the text is no voltage per something that is measured.
    """
    value, unit_text = split(text)
    above, slash, below = unit_text.partition("/")
    below = below.strip()
    if below.startswith("(") and below.endswith(")"):
        below = below[1:-1]
    volt = parse(above)
    if not slash or volt.quantity != "voltage":
        raise UnitError(
            "not a sensitivity", got=repr(text), expected="a voltage per unit such as 2.25 mV/N or 100 mV/g"
        )
    unit = parse(below)
    if unit.offset:
        raise UnitError("a sensitivity per degree of an offset scale", got=repr(text), expected="per K")
    volts = value * volt.factor / unit.factor
    _refuse_endless(volts, text)
    if volts == 0:
        raise UnitError("a sensitivity of zero", got=repr(text), expected="one other than 0, such as 2.25 mV/N")
    return volts, unit.quantity


def bracketed(name: str) -> tuple[str, str]:
    """Name and unit of a column title such as ``force [N]``, ``t (s)`` or ``a / g``; the unit may be empty."""
    patterns: tuple[str, ...] = (
        r"^(.*?)\s*\[([^\[\]]*)\]\s*$",
        r"^(.*?)\s*\(((?:[^()]|\([^()]*\))*)\)\s*$",
        r"^(.+?)\s+/\s+(\S+)$",
    )
    for pattern in patterns:
        title = re.match(pattern, name)
        if title:
            return title[1].strip(), title[2].strip()
    return name.strip(), ""


def known(text: str, parser: Callable[[str], Unit] = parse) -> Unit | None:
    """The unit of ``text``, or ``None`` where the text is no unit."""
    try:
        return parser(text)
    except UnitError:
        return None
