"""Units of a universal file: data set 164, and the labels of the axes of data set 58."""

from dataclasses import dataclass
from typing import Any

from acquisition import units
from acquisition.files.uff import records
from acquisition.files.uff.header58 import Axis, Header, integer, mended, real, text_of
from ema.units import FRF_OF_RESPONSE, FRF_UNIT, QUANTITIES, SI_UNIT, UNSTATED

_EXPONENTS = {
    2: (-2, 1, 0),
    3: (0, 0, 0),
    5: (0, 0, 1),
    8: (1, 0, 0),
    9: (0, 1, 0),
    11: (1, 0, 0),
    12: (1, 0, 0),
    13: (0, 1, 0),
    15: (-2, 1, 0),
}
"""Powers of length, force and temperature of each specific data type, for translations."""
_ANGULAR = {
    "displacement": "rotation",
    "velocity": "angular velocity",
    "acceleration": "angular acceleration",
    "force": "torque",
}
_LINEAR = {angular: linear for linear, angular in _ANGULAR.items()}


_FACTORS = {
    1: (1.0, 1.0),
    2: (3.28084, 0.2248089),
    3: (1.0, 0.1019716),
    4: (3.28084, 7.23301),
    5: (1000.0, 1000.0),
    6: (100.0, 100.0),
    7: (39.37008, 0.2248089),
    8: (1000.0, 0.1019716),
    10: (1000.0, 1.0),
}
"""Factors of length and force that each unit code of data set 164 stands for; 9 is the user's own."""


@dataclass(frozen=True)
class UnitSystem:
    """Factors of data set 164: SI value = value in the file / factor."""

    length: float = 1.0
    force: float = 1.0
    temperature: float = 1.0
    name: str = ""
    stated: bool = False
    code: int = 9

    @property
    def contradiction(self) -> str:
        """What the code and the factors say of one unit and differs; empty where nothing does."""
        expected = _FACTORS.get(self.code)
        if expected is None or all(abs(a / b - 1) < 1e-3 for a, b in zip((self.length, self.force), expected)):
            return ""
        there, meant = f"{self.length:g} and {self.force:g}", f"{expected[0]:g} and {expected[1]:g}"
        return f"unit code {self.code} of data set 164 means the factors {meant} of length and force, not {there}"

    def to_si(self, exponents: tuple[int, int, int]) -> float:
        """Factor to SI of a value with these powers of length, force and temperature."""
        length, force, temperature = exponents
        return self.length**-length * self.force**-force * self.temperature**-temperature


def parse164(lines: list[bytes]) -> UnitSystem:
    """The unit system of data set 164.

    Raises
    ------
    ValueError : a field is no number, or a factor is not positive.
    """
    first = text_of(lines[0])
    code = integer(first, 0, 10)
    factors = [records.real(word) for raw in lines[1:] for word in records.words(raw)]
    if len(factors) > 4:
        raise ValueError(f"{len(factors)} factors, not 4")
    if len(factors) < 3:
        second = text_of(lines[1])
        factors = [real(second, 0, 25), real(second, 25, 50), real(second, 50, 75)]
    if not all(0 < factor < 1e30 for factor in factors[:3]):
        raise ValueError(f"unit factors {factors[:3]}")
    return UnitSystem(factors[0], factors[1], factors[2], mended(first[10:30]), True, code)


@dataclass(frozen=True)
class Scale:
    """How the numbers of an axis become SI; ``note`` says what is odd about its unit."""

    quantity: str
    factor: float = 1.0
    offset: float = 0.0
    stated: bool = False
    note: str = ""

    def apply(self, values: Any) -> Any:
        """Values in SI."""
        return values if self.factor == 1.0 and self.offset == 0.0 else self.factor * values + self.offset


def scale(axis: Axis, direction: int, system: UnitSystem) -> Scale:
    """Scale of an axis: by its label, else by the file's unit system, else unstated."""
    rotation = abs(direction) >= 4
    expected = _ANGULAR.get(axis.quantity, axis.quantity) if rotation else axis.quantity
    label = axis.unit
    if label.lower() == UNSTATED:
        return Scale(expected)
    if label and label.upper() != "NONE":
        unit = units.known(label)
        if unit is None:
            return Scale(expected, note=f"{label!r} is not a unit")
        if expected not in ("unstated", unit.quantity) and unit.quantity not in FRF_UNIT:
            note = f"the unit {label!r} is one of {unit.quantity}, but the data type says {expected}"
            return Scale(unit.quantity, unit.factor, unit.offset, True, note)
        return Scale(unit.quantity, unit.factor, unit.offset, True)
    if not system.stated or (axis.code not in _EXPONENTS and not (axis.code == 1 and any(axis.exponents))):
        return Scale(expected)
    exponents = _EXPONENTS.get(axis.code, axis.exponents)
    if rotation and axis.code in (8, 11, 12):
        exponents = (0, 0, 0)
    elif rotation and axis.code in (9, 13):
        exponents = (1, 1, 0)
    return Scale(expected, system.to_si(exponents), 0.0, expected != "unstated")


@dataclass(frozen=True)
class FrfScale:
    """How an FRF becomes SI."""

    quantity: Any
    unit: str
    factor: float
    note: str = ""


def frf_scale(numerator: Scale, denominator: Scale) -> FrfScale:
    """Scale of a response over a force; unstated where one of the two is, or where it is no force."""
    note = numerator.note or denominator.note
    if numerator.stated and numerator.quantity in FRF_UNIT:
        return FrfScale(numerator.quantity, FRF_UNIT[numerator.quantity], numerator.factor, note)
    response = _LINEAR.get(numerator.quantity, numerator.quantity)
    force = _LINEAR.get(denominator.quantity, denominator.quantity)
    quantity = FRF_OF_RESPONSE.get(response, "unstated")
    if force not in ("force", "unstated"):
        return FrfScale("unstated", UNSTATED, 1.0, note or f"the reference is no force but {denominator.quantity}")
    if not (numerator.stated and denominator.stated) or quantity == "unstated":
        return FrfScale(quantity, UNSTATED, 1.0, note)
    return FrfScale(quantity, FRF_UNIT[quantity], numerator.factor / denominator.factor, note)


def unit_before_si(axis: Axis, found: Scale) -> units.Unit:
    """The unit that the numbers of an axis have in the file: that of its label, else of data set 164."""
    if axis.unit.upper() in ("", "NONE"):
        return units.named(found.quantity, found.factor)
    return units.Unit(axis.unit, found.factor, found.quantity, found.offset)


def frf_units(header: Header, above: Scale, below: Scale) -> tuple[tuple[units.Unit, units.Unit], ...]:
    """Units of response and force that the numbers of an FRF have in the file."""
    if above.quantity in FRF_UNIT:
        pair = units.of_frf(header.ordinate.unit)
        return () if pair is None else (pair,)
    return ((unit_before_si(header.ordinate, above), unit_before_si(header.denominator, below)),)


def channel_unit(found: Scale) -> tuple[Any, str]:
    """Quantity and SI unit of a channel."""
    quantity = found.quantity if found.quantity in QUANTITIES else "unstated"
    return quantity, SI_UNIT[quantity] if found.stated and quantity != "unstated" else UNSTATED
