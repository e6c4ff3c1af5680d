"""Types and shapes checked at run time, as ``jaxtyping.jaxtyped`` does, at a fraction of its cost.

``jaxtyped`` checks the parameters of a function twice, binds them by ``inspect`` at every call, and makes the check of an
inner function anew whenever the outer one is called: half the time of many tests. Here parameters and result
are checked once, names of axes are kept only where a hint has axes, every piece of code gets its check once, an
array is compared with plain axes (names and lengths) without a copy of all that is known of the call, and a function
that one test calls thousands of times is checked at its first calls and then at some of the others.
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

FIRST, EVERY = 25, 200
"""Calls of a function within a test of which each is checked, and which of those after them is."""

original = jaxtyping.jaxtyped
# an int is a float where one is declared, as PEP 484 has it
_beartyped = beartype(conf=BeartypeConf(is_pep484_tower=True))


class _Admitted(dict[np.dtype, bool]):
    """Whether a type of values is among those of a hint, as jaxtyping has it, asked once for each."""

    def __init__(self, hint: type) -> None:
        self._within = hint.dtype[np.ndarray, "..."]

    def __missing__(self, kind: np.dtype) -> bool:
        self[kind] = self._within.__instancecheck_str__(np.empty(0, kind)) == ""
        return self[kind]


_memo = _storage._shape_storage
"""Of every thread: a stack of what is known of the axes of the calls that run."""


def _axes(hint: type) -> list[str | int | None] | None:
    """Names and lengths of axes, ``None`` for any; ``None`` in place of all where jaxtyping has to look."""
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
    return axes


def _judge(hint: type) -> Callable[[object], bool]:
    """Whether a value is what a hint of an array says, beside what is known of the axes of the call."""
    axes = _axes(hint)
    if axes is None:
        return lambda value: hint.__instancecheck_str__(value) == ""
    array, count, admitted = hint.array_type, len(axes), _Admitted(hint)
    fixed = [(place, axis) for place, axis in enumerate(axes) if isinstance(axis, int)]
    named = [(place, axis) for place, axis in enumerate(axes) if isinstance(axis, str)]

    def judged(value: object) -> bool:
        if not isinstance(value, array) or not admitted[value.dtype]:
            return False
        shape = value.shape
        if len(shape) != count:
            return False
        for place, length in fixed:
            if shape[place] != length:
                return False
        if named:
            stack = getattr(_memo, "memo_stack", None)
            lengths = stack[-1][0] if stack else {}
            before = len(lengths)
            for place, name in named:
                if lengths.setdefault(name, shape[place]) != shape[place]:
                    while len(lengths) > before:  # a value that is refused leaves nothing behind
                        lengths.popitem()
                    return False
        return True

    return judged


class _Judges(dict[type, Callable[[object], bool]]):
    """The judge of each hint, made when it is first asked for."""

    def __missing__(self, hint: type) -> Callable[[object], bool]:
        self[hint] = _judge(hint)
        return self[hint]


_judges = _Judges()


def fits(hint: type, value: object) -> bool:
    """Whether a value is what a hint of an array says, beside what is known of the axes of the call."""
    return _judges[hint](value)


_array_types._MetaAbstractArray.__instancecheck__ = fits


class _Test:
    """The test that runs: a number."""

    number = 0


def next_test() -> None:
    """Check the first calls of every function again."""
    _Test.number += 1


def _sampled(target: types.FunctionType, check: Callable) -> Callable:
    """A function that is checked at its first calls in a test and at some of the others."""
    test, calls = _Test.number, 0

    @functools.wraps(target)
    def outer(*args, **named):  # type: ignore[no-untyped-def]
        __tracebackhide__ = True
        nonlocal test, calls
        if test != _Test.number:
            test, calls = _Test.number, 0
        calls += 1
        return (check if calls <= FIRST or calls % EVERY == 0 else target)(*args, **named)

    return outer


class _Running(threading.local):
    """Inner functions that are called, the last one last."""

    def __init__(self) -> None:
        self.functions: list[Callable] = []


_running = _Running()
_made: dict[types.CodeType, tuple[dict[str, object], Callable]] = {}
"""Hints and check of every inner function."""
_calls: dict[types.CodeType, tuple[int, int]] = {}
"""The test in which an inner function was called last, and how often in it."""


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
    return _inner_function(target) if "<locals>" in target.__qualname__ else _sampled(target, _function(target, target))


def _inner_function(target: types.FunctionType) -> Callable:
    """A function that another one defines whenever that is called: its check is that of a stand-in, which calls it."""
    hints, check = _made.get(target.__code__, (None, None))
    if hints is None or not _alike(tuple(hints.items()), tuple(target.__annotations__.items())):

        def stand_in(*args, **named):  # type: ignore[no-untyped-def]
            __tracebackhide__ = True
            return _running.functions[-1](*args, **named)

        check = _function(target, functools.wraps(target)(stand_in))
        _made[target.__code__] = target.__annotations__, check

    @functools.wraps(target)
    def outer(*args, **named):  # type: ignore[no-untyped-def]
        __tracebackhide__ = True
        test, calls = _calls.get(target.__code__, (-1, 0))
        calls = calls + 1 if test == _Test.number else 1
        _calls[target.__code__] = _Test.number, calls
        if calls > FIRST and calls % EVERY:
            return target(*args, **named)
        _running.functions.append(target)
        try:
            return check(*args, **named)
        finally:
            _running.functions.pop()

    return outer


def _alike(one: object, other: object) -> bool:
    """Whether two hints are one: those of arrays are classes made anew whenever an inner function is defined."""
    if one is other:
        return True
    if isinstance(one, _array_types._MetaAbstractArray) and isinstance(other, _array_types._MetaAbstractArray):
        return (one.dtype, one.array_type, one.dim_str) == (other.dtype, other.array_type, other.dim_str)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(_alike, one, other))
    if not typing.get_args(one) or typing.get_origin(one) is not typing.get_origin(other):
        return bool(one == other)
    return _alike(typing.get_args(one), typing.get_args(other))


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
        try:
            stack = _memo.memo_stack
        except AttributeError:
            stack = _memo.memo_stack = []
        stack.append(({}, {}, {}, {}))
        try:
            return inner(*args, **named)
        finally:
            stack.pop()

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
