"""Types and shapes checked at run time, as ``jaxtyping.jaxtyped`` does, at a fraction of its cost.

``jaxtyped`` checks the parameters of a function twice, and binds them by ``inspect``, at every call: two fifths of the
time of the tests. Here parameters and result are checked once, and names of axes are kept only where a hint has axes.
"""

import dataclasses
import functools
import inspect
import types
import typing

import jaxtyping
from beartype import BeartypeConf, beartype

original = jaxtyping.jaxtyped
_axes = original("context")
# an int is a float where one is declared, as PEP 484 has it
_beartyped = beartype(conf=BeartypeConf(is_pep484_tower=True))


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
    return _function(target)


def _function(target: types.FunctionType) -> types.FunctionType:
    hints = {name: _resolved(hint, target.__globals__) for name, hint in target.__annotations__.items()}
    plain = types.FunctionType(
        target.__code__, target.__globals__, target.__name__, target.__defaults__, target.__closure__
    )
    functools.update_wrapper(plain, target, updated=("__dict__",))
    plain.__kwdefaults__ = target.__kwdefaults__
    plain.__annotations__ = hints
    inner = _beartyped(plain)
    inner.__annotations__ = target.__annotations__
    if not any(_has_axes(hint) for hint in hints.values()):
        return inner

    @functools.wraps(target)
    def outer(*args, **named):  # type: ignore[no-untyped-def]
        __tracebackhide__ = True
        with _axes:
            return inner(*args, **named)

    return outer


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
