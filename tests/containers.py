"""One of each container, drawn from the types of its fields: every field set, all values different."""

import dataclasses
import types
import typing
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import count
from typing import Any, Literal, get_args, get_origin

import numpy as np

from ema import data
from ema.dof import Dof
from ema.store.steady_states import STEADY_STATES

LENGTHS = {"freq": 5, "sample": 6, "n": 3, "value": 4, "dof": 3}
"""Lengths of the axes of arrays; all others have 2."""

Drawn = dict[str, Any]


class Draw:
    """Makes containers; each value it sets is a number or a text that it has not used before."""

    def __init__(self) -> None:
        self._numbers = count(1)

    def container(self, kind: type) -> Any:
        """One container of ``kind``."""
        hints = typing.get_type_hints(kind)
        given = GIVEN.get(kind.__name__, {})
        values = {}
        for field in dataclasses.fields(kind):
            if field.init:
                default = self.value(hints[field.name], field.name) if field.name not in given else None
                values[field.name] = given[field.name](self) if field.name in given else default
        return kind(**values)

    def number(self) -> float:
        """A number that was not used before."""
        return next(self._numbers) / 8

    def value(self, hint: Any, name: str) -> Any:
        """One value of a type."""
        if hasattr(hint, "dim_str"):
            return self.array(hint)
        origin, arguments = get_origin(hint), get_args(hint)
        if origin in (typing.Union, types.UnionType):
            return self.value(next(one for one in arguments if one is not type(None)), name)
        if origin is Literal:
            return arguments[-1]
        if origin is tuple and arguments[-1] is not Ellipsis:
            return tuple(self.value(argument, name) for argument in arguments)
        if origin in (tuple, Sequence):
            return tuple(self.value(arguments[0], name) for _ in range(2))
        if hint is str:
            return f"{name} ü {next(self._numbers)}"
        if hint is bool:
            return True
        if hint is int:
            return next(self._numbers)
        if hint is float:
            return self.number()
        if hint is datetime:
            return datetime(2026, 11, 21, 10, 15, tzinfo=UTC) + timedelta(seconds=next(self._numbers))
        if hint is np.ndarray:
            return np.array([[self.number(), self.number()] for _ in range(3)])
        assert dataclasses.is_dataclass(hint), (name, hint)
        return self.container(typing.cast(type, hint))

    def array(self, hint: Any) -> np.ndarray:
        """An array of the shape and the kind of numbers that the type says."""
        shape = [int(axis) if axis.isdigit() else LENGTHS.get(axis, 2) for axis in hint.dim_str.split()]
        start, total = next(self._numbers), int(np.prod(shape))
        values = np.arange(start, start + total).reshape(shape)
        match hint.__name__.split("[")[0]:
            case "Float":
                return values / 16
            case "Complex":
                return values / 16 + 1j / (1 + values)
            case "Bool":
                return values % 2 == 0
        return values


def _dofs(number: int) -> Any:
    return lambda draw: tuple(Dof(int(next(draw._numbers)), "-X") for _ in range(number))


def _share(draw: Draw) -> float:
    return draw.number() / 1e5


def _shares(*shape: int) -> Any:
    return lambda draw: np.array([_share(draw) for _ in range(int(np.prod(shape)))]).reshape(shape)


def _below(draw: Draw) -> np.ndarray:
    """Lower bounds: below all other numbers."""
    return -np.array([[draw.number(), draw.number()], [draw.number(), draw.number()]])


GIVEN: dict[str, Drawn] = {
    "AmplitudeDependentMode": {"dofs": _dofs(3)},
    "Band": {"level": _share},
    "Candidate": {"confidence": _share},
    "Candidates": {"beams": lambda _: np.array([1, 0])},
    "Channel": {"quantity": lambda _: "force", "unit": lambda _: "N"},
    "ConditionDifference": {"mac": _shares(2)},
    "ContactPressure": {"open_time": _shares(2)},
    "Dof": {"direction": lambda _: "-RX"},
    "ForceSurface": {"force": lambda draw: data.Band(*(draw.number() + np.zeros((2, 2)) for _ in range(3)))},
    "ForcedResonances": {"several": _shares(2)},
    "ForcedResponse": {"folded": _share},
    "FrfSet": {"quantity": lambda _: "mobility", "unit": lambda _: "(m/s)/N", "coherence": _shares(5, 2, 2)},
    "HarmonicResponse": {"dofs": _dofs(3)},
    "LevelEffect": {"lower": lambda draw: -draw.number()},
    "MapComparison": {"inside": _share},
    "MapPrediction": {"frequency_low": _below, "damping_low": _below},
    "Matrices": {"dofs": _dofs(3)},
    "ModalModel": {"dofs": _dofs(3), "scaling": lambda _: "unit modal mass", "confidence": _shares(2)},
    "ModeComparison": {"dofs": _dofs(3), "mac": _shares(2), "co_mac": _shares(3)},
    "ModeQuality": {"modal_phase_collinearity": _shares(2)},
    "NonlinearMode": {"dofs": _dofs(3)},
    "PoleTable": {"letter": lambda _: np.array(["o", "s"])},
    "Response": {"dofs": _dofs(3), "slip_time": _shares(2)},
    "SteadyState": {"orders": lambda _: np.array([1, 3])},
    "SetUps": {"number": lambda _: np.array([[0, 1], [1, 0]])},
}
"""Fields whose values the types do not say."""


def kinds() -> dict[str, type]:
    """Every container by its name."""
    public = {name: getattr(data, name) for name in data.__all__} | STEADY_STATES
    return {"Dof": Dof} | {
        name: kind for name, kind in public.items() if isinstance(kind, type) and dataclasses.is_dataclass(kind)
    }


def one_of_each() -> dict[str, Any]:
    """Every container by its name, with all fields set."""
    draw = Draw()
    return {name: draw.container(kind) for name, kind in kinds().items()}
