"""Every public name and public method is documented: parameters, what comes back, and an example that runs.

Checked by numpydoc's validation; the examples themselves are run by ``tests/unit/test_doctests.py``.
"""

import inspect
from collections.abc import Iterator
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import GenericAlias
from typing import Any

import pytest

SNAPSHOT = Path(__file__).with_name("public_names.txt")

CHECKS = {
    "GL08": "no docstring",
    "SS01": "no summary",
    "SS02": "the summary does not start with a capital letter",
    "SS03": "the summary does not end with a full stop",
    "PR01": "a parameter is not described",
    "PR02": "an unknown parameter is described",
    "PR03": "the parameters stand in another order than in the signature",
    "PR04": "a parameter without a type",
    "PR07": "a parameter without a description",
    "PR10": "no space before the colon of a parameter",
    "RT01": "no section Returns",
    "RT03": "a return value without a description",
    "YD01": "no section Yields",
    "EX01": "no example",
}
"""Codes of numpydoc's validation that are checked; the others are of taste (capitals, verb forms, see-also lists)."""

OF_PROPERTIES = {"RT01", "RT03", "EX01"}
"""What one sentence says of an attribute; the example of its class shows it."""


def public_objects() -> Iterator[tuple[str, str, Any]]:
    """Yield public name, full name and object of each public function, class and method, one name for each object."""
    seen = set()
    for name in SNAPSHOT.read_text(encoding="utf-8").split():
        module, _, attribute = name.rpartition(".")
        thing = getattr(import_module(module), attribute)
        if inspect.ismodule(thing) or isinstance(thing, GenericAlias) or not callable(thing):
            continue
        home = f"{thing.__module__}.{thing.__qualname__}"
        if home in seen:
            continue
        seen.add(home)
        yield name, home, thing
        for method, value in vars(thing).items() if inspect.isclass(thing) else ():
            function = value.__func__ if isinstance(value, classmethod | staticmethod) else value
            written_here = inspect.isfunction(function) and function.__module__ == thing.__module__
            if not method.startswith("_") and (written_here or isinstance(value, property | cached_property)):
                yield f"{name}.{method}", f"{home}.{method}", value


def faults(home: str, thing: Any) -> list[str]:
    """Return what numpydoc finds missing in a docstring."""
    from numpydoc.validate import validate

    checked = set(CHECKS)
    if isinstance(thing, property | cached_property):
        checked -= OF_PROPERTIES
    if getattr(thing, "_is_protocol", False):  # is implemented, not called
        checked.discard("PR01")
    return [f"{code} {message}" for code, message in validate(home)["errors"] if code in checked]


def test_every_public_name_is_documented() -> None:
    pytest.importorskip("numpydoc", reason="numpydoc is in the extra 'dev'")
    wrong = {name: what for name, home, thing in public_objects() if (what := faults(home, thing))}
    assert not wrong, "\n".join(f"{name}: {'; '.join(what)}" for name, what in wrong.items())


def undescribed(frequency: float, damping: float) -> float:
    """Return something.

    Parameters
    ----------
    frequency : float
        Hz.
    """
    return frequency * damping


def test_the_check_sees_what_is_missing() -> None:
    pytest.importorskip("numpydoc", reason="numpydoc is in the extra 'dev'")
    found = " ".join(faults(f"{__name__}.undescribed", undescribed))
    assert "PR01" in found and "damping" in found and "RT01" in found and "EX01" in found
