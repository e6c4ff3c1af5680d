"""Types and shapes checked at run time, as ``jaxtyping.jaxtyped`` does, at a fraction of its cost.

``jaxtyped`` checks the parameters of a function twice, binds them by ``inspect`` at every call, and makes the check of an
inner function anew whenever the outer one is called: half the time of many tests. Here parameters and result
are checked once, names of axes are kept only where a hint has axes, every piece of code gets its check once, and an
array is compared with plain axes (names and lengths) without a copy of all that is known of the call.
"""

import dataclasses
import functools
import inspect
import threading
import types
import typing
from collections.abc import Callable

import jaxtyping
import numpy as np
from beartype import BeartypeConf, beartype
from jaxtyping import _array_types, _storage

original = jaxtyping.jaxtyped
# an int is a float where one is declared, as PEP 484 has it
_beartyped = beartype(conf=BeartypeConf(is_pep484_tower=True))


class Plain(typing.NamedTuple):
    """A hint of an array whose axes are names, lengths or anything (``None``), and the types of values that it admits, as
    far as they have been asked for."""

    array: type
    axes: tuple[str | int | None, ...]
    admitted: dict[np.dtype, bool]


_plain: dict[type, Plain | None] = {}
_ABSTRACT = _array_types._MetaAbstractArray


def plain(hint: type) -> Plain | None:
    """The hint where its axes are plain; ``None`` where jaxtyping has to look."""
    if hint._skip_instancecheck or hint.index_variadic is not None or not isinstance(hint.array_type, type):
        return None
    axes: list[str | int | None] = []
    for axis in hint.dims:
        if axis is _array_types._anonymous_dim:
            axes.append(None)
        elif isinstance(axis, _array_types._FixedDim) and not axis.broadcastable:
            axes.append(axis.size)
        elif isinstance(axis, _array_types._NamedDim) and not axis.broadcastable and not axis.treepath:
            axes.append(axis.name)
        else:
            return None
    return Plain(hint.array_type, tuple(axes), {})


def fits(hint: type, value: object) -> bool:
    """Whether a value is what a hint of an array says, beside what is known of the axes of the call."""
    try:
        known = _plain[hint]
    except KeyError:
        known = _plain[hint] = plain(hint)
    if known is None or _storage.get_treeflatten_memo():
        return hint.__instancecheck_str__(value) == ""
    if not isinstance(value, known.array):
        return False
    shape, axes = value.shape, known.axes
    try:
        admitted = known.admitted[value.dtype]
    except KeyError:
        within = hint.dtype[known.array, "..."]
        admitted = known.admitted[value.dtype] = within.__instancecheck_str__(value) == ""
    if not admitted or len(shape) != len(axes):
        return False
    stack = getattr(_storage._shape_storage, "memo_stack", None)
    lengths = stack[-1][0] if stack else {}
    new: dict[str, int] = {}
    for axis, length in zip(axes, shape, strict=True):
        if axis is None:
            continue
        stated = axis if isinstance(axis, int) else lengths.get(axis, new.get(axis))
        if stated is None:
            new[axis] = length
        elif stated != length:
            return False
    lengths.update(new)
    return True


_ABSTRACT.__instancecheck__ = fits


class _Running(threading.local):
    """Inner functions that are called, the last one last."""

    def __init__(self) -> None:
        self.functions: list[Callable] = []


_running = _Running()
_made: dict[types.CodeType, tuple[dict[str, object], Callable]] = {}
"""Hints and check of every inner function."""


def checked(target):  # type: ignore[no-untyped-def]
    """A function that checks its types, or a data class that does when one is made."""
    if inspect.isclass(target):
        if dataclasses.is_dataclass(target) and "__init__" in vars(target):
            target.__init__ = checked(target.__init__)
        return target
    if isinstance(target, classmethod | staticmethod):
        return type(target)(checked(target.__func__))
    if isinstance(target, property):
        return property(*(one and checked(one) for one in (target.fget, target.fset, target.fdel)))
    if not isinstance(target, types.FunctionType) or inspect.isgeneratorfunction(target):
        return original(target, typechecker=_beartyped)
    if not target.__annotations__:
        return target
    return _inner_function(target) if "<locals>" in target.__qualname__ else _function(target, target)


def _inner_function(target: types.FunctionType) -> Callable:
    """A function that another one defines whenever that is called: its check is that of a stand-in, which calls it."""
    hints, check = _made.get(target.__code__, (None, None))
    if hints != target.__annotations__:

        def stand_in(*args, **named):  # type: ignore[no-untyped-def]
            __tracebackhide__ = True
            return _running.functions[-1](*args, **named)

        check = _function(target, functools.wraps(target)(stand_in))
        _made[target.__code__] = target.__annotations__, check

    @functools.wraps(target)
    def outer(*args, **named):  # type: ignore[no-untyped-def]
        __tracebackhide__ = True
        _running.functions.append(target)
        try:
            return check(*args, **named)
        finally:
            _running.functions.pop()

    return outer


def _function(target: types.FunctionType, called: Callable) -> Callable:
    """A function that checks the hints of ``target`` and calls ``called``."""
    hints = {name: _resolved(hint, target.__globals__) for name, hint in target.__annotations__.items()}
    copy = _copy(target, hints)
    if called is not target:
        called.__annotations__, called.__wrapped__ = hints, copy
    inner = _beartyped(copy if called is target else called)
    inner.__annotations__ = target.__annotations__
    if not any(_has_axes(hint) for hint in hints.values()):
        return inner

    @functools.wraps(target)
    def outer(*args, **named):  # type: ignore[no-untyped-def]
        __tracebackhide__ = True
        _storage.push_shape_memo({})
        try:
            return inner(*args, **named)
        finally:
            _storage.pop_shape_memo()

    return outer


def _copy(target: types.FunctionType, hints: dict[str, object]) -> types.FunctionType:
    copy = types.FunctionType(
        target.__code__, target.__globals__, target.__name__, target.__defaults__, target.__closure__
    )
    copy.__kwdefaults__ = target.__kwdefaults__
    functools.update_wrapper(copy, target)
    del copy.__wrapped__
    copy.__annotations__ = hints
    return copy


def _resolved(hint: object, names: dict[str, object]) -> object:
    """The hint that a string stands for; any, where nothing of the name exists at run time."""

    def one(value):  # type: ignore[no-untyped-def]
        """Carries the hint."""

    one.__annotations__ = {"value": hint}
    try:
        return typing.get_type_hints(one, names, include_extras=True)["value"]
    except Exception:  # whatever a name that exists for the type checker alone leads to
        return typing.Any


def _has_axes(hint: object) -> bool:
    if isinstance(hint, list | tuple):
        return any(_has_axes(part) for part in hint)
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return _has_axes(typing.get_args(hint))
