"""Quantities in our TOML files: texts with a unit that become numbers in SI, nodes and DOFs."""

import re
from collections.abc import Callable
from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from acquisition import units
from acquisition.units import measure
from ema.dof import Dof
from ema.errors import EmaError

__all__ = [
    "Axis",
    "Band",
    "Coordinate",
    "Damping",
    "Density",
    "Ends",
    "Force",
    "Forces",
    "Frequency",
    "HalfHeight",
    "Length",
    "Mass",
    "Modulus",
    "Nodes",
    "NormalForce",
    "NormalForces",
    "Place",
    "Places",
    "Ratio",
    "Seconds",
    "Stiffness",
    "Tolerance",
    "Velocity",
    "measure",
]


def in_si(quantity: str, plain: bool = False) -> BeforeValidator:
    """A text with a unit as the number in SI; a bare number only where ``plain`` says it needs no unit."""

    def convert(value: Any) -> Any:
        if isinstance(value, str):
            return explained(lambda: units.measure(value, quantity)[0])
        if plain or isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            return value
        raise ValueError(f'a number without a unit; write it as a text such as "{value} {units.example(quantity)}"')

    return BeforeValidator(convert)


def explained(work: Callable[[], Any]) -> Any:
    """What ``work`` gives; an error of ours becomes one that keeps the line of the text."""
    try:
        return work()
    except EmaError as error:
        raise ValueError(str(error)) from error


def as_list(value: Any) -> Any:
    """Return a list as it is, and anything else as a list with one element."""
    return value if isinstance(value, list) else [value]


def _as_nodes(value: Any) -> Any:
    """``"3-11"``, ``"3-11 by 2"`` or a list of nodes."""
    if not isinstance(value, str):
        return value
    span = re.fullmatch(r"\s*(\d+)\s*-\s*(\d+)\s*(?:by\s+(\d+)\s*)?", value)
    if span is None:
        raise ValueError(f'not a range of nodes: {value!r}; write "3-11", "3-11 by 2" or [3, 5, 8]')
    first, last, step = int(span[1]), int(span[2]), int(span[3] or 1)
    if step < 1:
        raise ValueError("a range of nodes needs a step of 1 or more")
    return list(range(first, last + 1, step)) if first <= last else list(range(first, last - 1, -step))


def _as_dof(value: Any) -> Any:
    return explained(lambda: Dof.parse(value)) if isinstance(value, str) else value


def _as_axis(value: Any) -> Any:
    return value.upper() if isinstance(value, str) else value


Axis = Annotated[Literal["X", "Y"], BeforeValidator(_as_axis)]
Damping = Annotated[float, in_si("damping", plain=True), Field(ge=0)]
Velocity = Annotated[float, in_si("velocity", plain=True), Field(gt=0)]
Length = Annotated[float, in_si("displacement"), Field(gt=0)]
Coordinate = Annotated[float, in_si("displacement")]
HalfHeight = Annotated[float, in_si("displacement"), Field(ge=0)]
Modulus = Annotated[float, in_si("pressure"), Field(gt=0)]
Mass = Annotated[float, in_si("mass"), Field(gt=0)]
Density = Annotated[float, in_si("density"), Field(gt=0)]
Force = Annotated[float, in_si("force")]
NormalForce = Annotated[float, in_si("force"), Field(ge=0)]
Stiffness = Annotated[float, in_si("stiffness"), Field(gt=0)]
Frequency = Annotated[float, in_si("frequency"), Field(gt=0)]
Seconds = Annotated[float, in_si("time"), Field(gt=0)]
Ratio = Annotated[float, in_si("ratio", plain=True), Field(ge=0, lt=1)]
Tolerance = Annotated[float, in_si("ratio", plain=True), Field(gt=0, lt=1)]
Nodes = Annotated[list[int], BeforeValidator(_as_nodes), Field(min_length=1)]
Forces = Annotated[list[Annotated[float, in_si("force"), Field(gt=0)]], BeforeValidator(as_list), Field(min_length=1)]
NormalForces = Annotated[list[NormalForce], BeforeValidator(as_list), Field(min_length=1)]
Band = Annotated[list[Frequency], Field(min_length=2, max_length=2)]
Place = Annotated[Dof, BeforeValidator(_as_dof)]
Places = Annotated[list[Place], BeforeValidator(as_list)]
Ends = Annotated[list[Literal["clamped", "free"]], Field(min_length=2, max_length=2)]
