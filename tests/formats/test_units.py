"""Unit strings as people and files write them."""

import pytest

from acquisition import units
from ema.errors import FailureError, UnitError

G = 9.80665
LBF = 4.4482216152605


@pytest.mark.parametrize(
    ("text", "factor", "quantity"),
    [
        ("N", 1, "force"),
        ("kN", 1e3, "force"),
        ("lbf", LBF, "force"),
        ("kip", 1e3 * LBF, "force"),
        ("kgf", G, "force"),
        ("g", G, "acceleration"),
        ("mg", 1e-3 * G, "acceleration"),
        ("m/s^2", 1, "acceleration"),
        ("m/s²", 1, "acceleration"),
        ("m/s2", 1, "acceleration"),
        ("m/sÂ²", 1, "acceleration"),
        ("m s-2", 1, "acceleration"),
        ("m·s⁻²", 1, "acceleration"),
        ("in/s^2", 0.0254, "acceleration"),
        ("mm/s", 1e-3, "velocity"),
        ("in", 0.0254, "displacement"),
        ("ft", 0.3048, "displacement"),
        ("µm", 1e-6, "displacement"),
        ("(m/s^2)/N", 1, "accelerance"),
        ("m/s^2/N", 1, "accelerance"),
        ("(1/N)*(m/s²)", 1, "accelerance"),
        ("g/lbf", G / LBF, "accelerance"),
        ("(m/s)/N", 1, "mobility"),
        ("mm/N", 1e-3, "receptance"),
        ("N m", 1, "torque"),
        ("Nm", 1, "torque"),
        ("N-m", 1, "torque"),
        ("rad/s", 1, "angular velocity"),
        ("rad/s^2", 1, "angular acceleration"),
        ("deg", 0.017453292519943295, "rotation"),
        ("MPa", 1e6, "pressure"),
        ("mV", 1e-3, "voltage"),
        ("ms", 1e-3, "time"),
        ("µm/m", 1e-6, "strain"),
        ("microstrain", 1e-6, "strain"),
        ("%", 0.01, "ratio"),
        ("kHz", 1e3, "frequency"),
        ("mil", 0.0254e-3, "displacement"),
        ("mils/lbf", 0.0254e-3 / LBF, "receptance"),
        ("krad/s", 1e3, "angular velocity"),
        ("mrad", 1e-3, "rotation"),
        ("rps", 6.283185307179586, "angular velocity"),
        ("unstated", 1, "unstated"),
    ],
)
def test_factor_and_quantity(text: str, factor: float, quantity: str) -> None:
    unit = units.parse(text)
    assert unit.quantity == quantity
    assert unit.factor == pytest.approx(factor, rel=1e-12)
    assert unit.offset == 0


def test_temperatures_have_an_offset() -> None:
    assert units.measure("21 degC") == (pytest.approx(294.15), "temperature")
    assert units.measure("21 °C") == (pytest.approx(294.15), "temperature")
    assert units.measure("32 degF") == (pytest.approx(273.15, abs=1e-9), "temperature")


def test_a_value_with_its_unit() -> None:
    assert units.measure("1.02 kN", "force") == (pytest.approx(1020), "force")
    assert units.measure("12 N m") == (pytest.approx(12), "torque")


def test_sensitivity_is_in_volts_per_si_unit() -> None:
    assert units.sensitivity("2.25 mV/N") == (pytest.approx(2.25e-3), "force")
    assert units.sensitivity("100 mV/g") == (pytest.approx(0.1 / G), "acceleration")
    assert units.sensitivity("10 mV/(m/s^2)") == (pytest.approx(0.01), "acceleration")


def test_an_unknown_unit_is_an_error_with_a_suggestion() -> None:
    with pytest.raises(UnitError, match=r"m/s\^2"):
        units.parse("m/s^^2")
    with pytest.raises(UnitError, match="lbf"):
        units.parse("lb")
    with pytest.raises(UnitError, match="kip"):
        units.parse("kips/")


@pytest.mark.parametrize(
    "text", ["", "dB", "kg", "9**9**9**9", "m//s", "(m/s", "m/s)", "^2", "m" * 100, "g²/Hz", "__import__('os')", "m/0"]
)
def test_what_is_no_unit_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        units.parse(text)


@pytest.mark.parametrize("text", ["kN", "1.0", "1 kN", "abc", "2 N/mV", "0 mV/N", "3 mV/degC"])
def test_what_is_no_sensitivity_is_refused(text: str) -> None:
    with pytest.raises(UnitError):
        units.sensitivity(text)


def test_the_wrong_quantity_is_refused() -> None:
    with pytest.raises(UnitError, match="not a force"):
        units.measure("3 mm", "force")


@pytest.mark.parametrize(
    ("title", "expected"),
    [
        ("force [N]", ("force", "N")),
        ("acc (m/s^2)", ("acc", "m/s^2")),
        ("a / g", ("a", "g")),
        ("plain", ("plain", "")),
        ("H [(m/s^2)/N]", ("H", "(m/s^2)/N")),
    ],
)
def test_units_in_column_titles(title: str, expected: tuple[str, str]) -> None:
    assert units.bracketed(title) == expected


def test_a_broken_table_of_units_is_not_blamed_on_the_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A version of the table that does not fit said of "mm" that it is no unit."""

    def broken(*_: object, **__: object) -> None:
        raise TypeError("metaclass conflict")

    monkeypatch.setattr("pint.UnitRegistry", broken)
    units._registry.cache_clear()
    units.parse.cache_clear()
    try:
        with pytest.raises(
            FailureError, match=r"table of units cannot be loaded .*metaclass conflict.*pip install -U pint"
        ):
            units.parse("mm")
    finally:
        units._registry.cache_clear()
