"""Read-only arrays for frozen data types, and the lengths that their axes share."""

from dataclasses import fields
from types import UnionType
from typing import Any, Union, get_args, get_origin

import numpy as np

from ema.data.window import Window
from ema.errors import InputError


def read_only(values: Any, dtype: Any = None) -> Any:
    """Return ``values`` as an array that cannot be written through (a view where no conversion is needed)."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def freeze(container: Any, **dtypes: Any) -> None:
    """Turn the named fields of a frozen dataclass into read-only arrays of the given dtype; ``None`` and windows on
    files stay what they are.
    """
    for name, dtype in dtypes.items():
        value = getattr(container, name)
        if value is not None and not isinstance(value, Window):
            object.__setattr__(container, name, read_only(value, dtype))


def check_axes(container: Any) -> None:
    """Refuse arrays whose axes of one name differ in length.

    The names are those of the type annotations: in ``Float[np.ndarray, "freq out in"]`` the axes are ``freq``, ``out``
    and ``in``. Axes of variable number (``*shape``) are not compared.

    Parameters
    ----------
    container : dataclass
        Its fields are arrays already.

    Raises
    ------
    InputError
        If an array has another number of axes than its annotation, or two axes of one name differ.
    """
    known: dict[str, tuple[int, str]] = {}
    for name, axes in _axes(type(container)):
        value = getattr(container, name)
        if value is None:
            continue
        if value.ndim != len(axes):
            raise InputError(
                "an array has the wrong number of axes",
                where=f"{type(container).__name__}.{name}",
                got=f"shape {value.shape}",
                expected=f"({', '.join(axes)})",
            )
        for axis, length in zip(axes, value.shape, strict=True):
            wanted, source = known.setdefault(axis, (int(axis) if axis.isdigit() else length, name))
            if length != wanted:
                raise InputError(
                    "arrays and axes disagree",
                    where=f"{type(container).__name__}.{name}",
                    got=f"{length} along {axis}",
                    expected=f"{wanted}" + ("" if axis.isdigit() else f", as in {source}"),
                )


_AXES: dict[type, tuple[tuple[str, tuple[str, ...]], ...]] = {}
"""Of each class that was asked for: the annotations never change."""


def _axes(kind: type) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Fields of a dataclass that are arrays with named axes, with the names of these axes."""
    if kind in _AXES:
        return _AXES[kind]
    arrays = []
    for field in fields(kind):
        for hint in get_args(field.type) if get_origin(field.type) in (Union, UnionType) else (field.type,):
            axes = tuple(getattr(hint, "dim_str", "*").split())
            if not any(axis.startswith(("*", ".")) for axis in axes):
                arrays.append((field.name, axes))
    return _AXES.setdefault(kind, tuple(arrays))
