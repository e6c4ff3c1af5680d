"""Arguments of public functions and fields of data types, compared with their annotations where a caller comes in.

Annotations are written for type checkers and for the test run. Here they answer who passes a path in place of an
object, a text in place of a number or a complex number in place of a real one. What is merely written another way is
taken: a list for an array or a tuple, a text for a ``Path``, an integer for a float.
"""

import collections.abc
import functools
import inspect
import re
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np

from ema.errors import InputError
from ema.units import SI_UNIT

LONGEST = 60
"""Characters of a wrong value that an error shows."""

_READERS = {
    "Campaign": "open one by acquisition.open_campaign(folder)",
    "BeamModel": "open one by acquisition.open_model(file)",
    "FrfSet": "read one by acquisition.read(file) or ema.store.load(file), or make one by FrfSet.from_arrays",
    "Recording": "read one by acquisition.read(file) or ema.store.load(file), or make one by Recording.from_arrays",
    "Geometry": "read one by acquisition.read(file) or ema.store.load(file)",
    "ModalModel": "ema.fit.modes gives one; read a stored one by ema.store.load(file)",
    "Dof": 'write Dof(1, "+Z") or Dof.parse("1:+Z")',
}
"""How a caller comes by an object of a type."""

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s:]*)\s*")
"""A number, and the unit behind it."""
_UNSCALED = {"", "-", "Hz", "kg", "N/m", *SI_UNIT.values()}
"""Units in which the number is that of SI; those of hundredths, of g or of kN are left to the caller."""

_REAL = (int, float, np.integer, np.floating)
_REAL_KINDS, _ALL_KINDS = "fiub", "cfiub"
_KINDS = {"Float": _REAL_KINDS, "Real": _REAL_KINDS, "Int": "iub", "Bool": "b"}
_KINDS |= dict.fromkeys(("Complex", "Inexact", "Num"), _ALL_KINDS)
"""Kinds of numpy's values that arrays of a hint may have."""
_MADE = {"Float": np.float64, "Complex": np.complex128, "Inexact": np.float64}
"""Types of values that a list is given."""


class _Wrong(Exception):
    """A value does not fit a hint."""


@dataclass(frozen=True)
class Hint:
    """What an argument may be.

    Parameters
    ----------
    expected : str
        In words, such as ``a number``.
    taken : callable
        Returns the value, written as it is wanted, or raises ``_Wrong``.
    kinds : tuple of str, optional
        Names of the data types among what is expected.
    axes : tuple of str, optional
        Names of the axes of an array, where they are of a known number.
    """

    expected: str
    taken: Callable[[Any], Any]
    kinds: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()


def checked(target: Any, package: str, after: Callable[[Any], None] | None = None) -> Any:
    """Return a public function or class that refuses arguments of other types than it declares.

    Parameters
    ----------
    target : function or class
        A function comes back as one around it; of a class the constructors are exchanged. Others come back as they are.
    package : str
        Package that makes it public, for its name in errors.
    after : callable, optional
        Called with every object that the constructor of a dataclass has made.

    Returns
    -------
    function or class
        Which to call instead.

    Examples
    --------
    >>> def doubled(frequency: float) -> float:
    ...     return 2 * frequency
    >>> checked(doubled, "ema.example")("5 Hz")
    Traceback (most recent call last):
        ...
    ema.errors.InputError: ema.example.doubled, frequency: not what this argument takes;
    got '5 Hz', expected a number; write the number alone, in SI units: 5
    """
    if isinstance(target, type) and issubclass(target, tuple):
        return _named_tuple(target, package)
    if isinstance(target, type):
        for name, own in list(vars(target).items()):
            if name == "__init__" and isinstance(own, types.FunctionType):
                guarded = _guarded(own, target.__name__, shapes=not is_dataclass(target))
                follows = after is not None and is_dataclass(target)
                setattr(target, name, _followed(guarded, after) if follows else guarded)
            elif isinstance(own, classmethod) and not name.startswith("_"):
                setattr(target, name, classmethod(_guarded(own.__func__, f"{target.__name__}.{name}")))
        return target
    if not isinstance(target, types.FunctionType):
        return target
    guarded = _guarded(target, f"{package}.{target.__name__}")
    guarded.__module__ = package  # by which it is found again in another process
    return guarded


def _named_tuple(target: Any, package: str) -> Any:
    """A named tuple whose ``__new__`` is guarded."""
    make = target.__new__

    @functools.wraps(make)
    def constructor(kind: type, /, *args: Any, **named: Any) -> Any:
        return make(kind, *args, **named)

    target.__new__ = staticmethod(_guarded(constructor, f"{package}.{target.__name__}"))
    return target


def _followed(constructor: Callable[..., None], after: Any) -> Any:
    @functools.wraps(constructor)
    def followed(made: Any, *args: Any, **named: Any) -> None:
        constructor(made, *args, **named)
        after(made)

    return followed


def checked_names(package: str, get: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return ``__getattr__`` of a package whose public names refuse arguments of other types than they declare.

    Parameters
    ----------
    package : str
        Name of the package.
    get : callable
        ``__getattr__`` of the package without checks, as from :func:`ema.lazy.attach`.

    Returns
    -------
    callable
        The other ``__getattr__``; each name is wrapped once.

    Examples
    --------
    >>> get = checked_names("ema.store", {"name": len}.__getitem__)
    >>> get("name") is len  # no function of Python's own is checked
    True
    """
    known: dict[str, Any] = {}

    def __getattr__(name: str) -> Any:
        if name not in known:
            known[name] = checked(get(name), package)
        return known[name]

    return __getattr__


def _guarded(function: Callable[..., Any], name: str, *, shapes: bool = True) -> Any:
    """The function behind a check of its arguments; constructors of data types compare shapes by themselves."""
    hints: dict[str, Hint] = {}
    order: list[str] = []

    def known() -> list[str]:
        """Names of the positional parameters; annotations are read at the first call, when all modules are there."""
        if not order:
            annotations = _annotations(function)
            for parameter in inspect.signature(function).parameters.values():
                if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                    break
                order.append(parameter.name)
                if (hint := hint_of(annotations.get(parameter.name, Any), shapes=shapes)) is not None:
                    hints[parameter.name] = hint
            order.append("")  # read, also where there is none
        return order

    @functools.wraps(function)
    def guarded(*args: Any, **named: Any) -> Any:
        positional = known()
        taken = [_taken(hints, key, value, name) for key, value in zip(positional, args, strict=False)]
        named = {key: _taken(hints, key, value, name) for key, value in named.items()}
        if any(hint.axes for hint in hints.values()):
            _compare_axes(hints, dict(zip(positional, taken, strict=False)) | named, name)
        return function(*taken, *args[len(taken) :], **named)

    return guarded


def _taken(hints: Mapping[str, Hint], key: str, value: Any, name: str) -> Any:
    hint = hints.get(key)
    if hint is None:
        return value
    try:
        return hint.taken(value)
    except _Wrong as wrong:
        raise InputError(
            str(wrong) or "not what this argument takes",
            where=f"{name}, {key}" if "." in name else f"{name}.{key}",  # of a constructor its field
            got=_got(value),
            expected=hint.expected,
            advice=_advice(value, hint),
        ) from None


def _compare_axes(hints: Mapping[str, Hint], given: Mapping[str, Any], name: str) -> None:
    """Refuse arrays whose axes of one name differ in length."""
    lengths: dict[str, tuple[int, str]] = {}
    for key, value in given.items():
        if key in hints and hints[key].axes and value is not None:
            for axis, length in zip(hints[key].axes, value.shape, strict=True):
                wanted, source = lengths.setdefault(axis, (int(axis) if axis.isdigit() else length, key))
                if length != wanted and axis != "_":
                    raise InputError(
                        "arrays and axes disagree",
                        where=f"{name}, {key}",
                        got=f"{length} along {axis}",
                        expected=f"{wanted}" + ("" if axis.isdigit() else f", as in {source}"),
                    )


def _annotations(function: Callable[..., Any]) -> dict[str, Any]:
    """Hints of the parameters; those that exist for type checkers alone are left out."""
    names = getattr(inspect.unwrap(function), "__globals__", {})
    found = {}
    for key, hint in inspect.get_annotations(inspect.unwrap(function)).items():

        def holder(value: Any) -> None: ...

        holder.__annotations__ = {"value": hint}
        try:
            found[key] = typing.get_type_hints(holder, names)["value"]
        except Exception:  # whatever a name that exists for the type checker alone leads to
            continue
    return found


def hint_of(annotation: Any, *, shapes: bool = True) -> Hint | None:
    """Return what an annotation says of values, ``None`` where it says nothing that can be seen on a value.

    Parameters
    ----------
    annotation : object
        Resolved annotation.
    shapes : bool, default True
        Whether the number of axes of an array counts.

    Returns
    -------
    Hint or None
        What to expect.

    Examples
    --------
    >>> hint_of(float | None).expected
    'a number or None'
    >>> hint_of(tuple[int, int]).taken([1, 2])
    (1, 2)
    """
    if hasattr(annotation, "dim_str"):
        return _array(annotation, shapes)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin in (typing.Union, types.UnionType):
        arms = [hint_of(one, shapes=shapes) for one in arguments]
        return _any_of([arm for arm in arms if arm is not None]) if all(arms) else None
    if origin is Literal:
        words = ", ".join(map(repr, arguments))
        return Hint(
            f"one of {words}" if len(arguments) > 1 else words,
            lambda value: _where(isinstance(value, (str, int, type(None))) and value in arguments, value),
        )
    if origin is tuple:
        return _tuple(arguments, shapes)
    if origin in (collections.abc.Sequence, collections.abc.Iterable, collections.abc.Collection, list):
        return _sequence(hint_of(arguments[0], shapes=shapes))
    if origin is PathLike:
        return Hint("a path", lambda value: _where(isinstance(value, PathLike), value))
    if origin is collections.abc.Callable:
        return Hint("a function", lambda value: _where(callable(value), value))
    if annotation is None or (isinstance(annotation, type) and origin is None):
        return _PLAIN.get(annotation) or _class(annotation)
    return None


def _class(kind: Any) -> Hint | None:
    """An object of a class; what a protocol asks for is seen where it is used."""
    if kind is Any or kind is object or getattr(kind, "_is_protocol", False):
        return None
    name = kind.__name__
    return Hint(
        f"a {name}" if name.lower() == name else name, lambda value: _where(isinstance(value, kind), value), (name,)
    )


def _where(fits: bool, value: Any) -> Any:
    if not fits:
        raise _Wrong
    return value


def _real(value: Any) -> Any:
    return _where(isinstance(value, _REAL) or _single(value, "fiu"), value)


def _single(value: Any, kinds: str) -> bool:
    """Whether it is an array of no axis, which counts as a number."""
    return isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in kinds


def _path(value: Any) -> Any:
    return Path(_where(isinstance(value, str | PathLike), value))


def _whole(value: Any) -> Any:
    """An array of any values, with one axis or more."""
    if isinstance(value, np.ndarray) and value.ndim:
        return value
    return _made(_where(isinstance(value, list | tuple) or hasattr(value, "to_numpy"), value), None)


def _none(value: Any) -> Any:
    return _where(value is None, value)


_PLAIN: dict[Any, Hint] = {
    float: Hint("a number", _real),
    int: Hint("an integer", lambda value: _where(isinstance(value, int | np.integer) or _single(value, "iu"), value)),
    bool: Hint("True or False", lambda value: _where(isinstance(value, bool | np.bool_), value)),
    str: Hint("a text", lambda value: _where(isinstance(value, str), value)),
    complex: Hint("a number", lambda value: _where(isinstance(value, (*_REAL, complex, np.complexfloating)), value)),
    Path: Hint("a path", _path),
    None: Hint("None", _none),
    type(None): Hint("None", _none),
    np.ndarray: Hint("an array", _whole),
}


def _any_of(arms: Sequence[Hint]) -> Hint:
    nothing = any(arm.expected == "None" for arm in arms)

    def taken(value: Any) -> Any:
        if value is None and nothing:
            return None
        said = ""
        for arm in arms:
            try:
                return arm.taken(value)
            except _Wrong as wrong:
                said = said or str(wrong)
        raise _Wrong(said)

    words = list(dict.fromkeys(arm.expected for arm in arms))
    kinds = tuple(kind for arm in arms for kind in arm.kinds)
    return Hint(" or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words), taken, kinds)


def _tuple(arguments: tuple[Any, ...], shapes: bool) -> Hint | None:
    """A tuple, or a list or array that becomes one; each item is taken."""
    if not arguments:
        return None
    if arguments[-1] is Ellipsis:
        return _sequence(hint_of(arguments[0], shapes=shapes), tuple)
    items = [hint_of(one, shapes=shapes) for one in arguments]
    words = ", ".join("a value" if one is None else one.expected for one in items)

    def taken(value: Any) -> Any:
        listed = _listed(value)
        _where(len(listed) == len(items), value)
        return tuple(one if hint is None else hint.taken(one) for hint, one in zip(items, listed, strict=True))

    return Hint(f"{len(items)} values ({words})", taken, tuple(kind for one in items if one for kind in one.kinds))


def _sequence(item: Hint | None, kind: type | None = None) -> Hint:
    """A sequence; items of tuples, lists and arrays are taken, those that are made when asked for are left."""

    def taken(value: Any) -> Any:
        if kind is None and not isinstance(value, str | bytes | Mapping | list | tuple):
            array = isinstance(value, np.ndarray) and value.ndim > 0
            if array and item is not None and len(value):
                item.taken(value[0])
            iterable = isinstance(value, collections.abc.Iterable) and getattr(value, "ndim", 1) == 1
            return _where(array or iterable, value)
        listed = _listed(value)
        made = listed if item is None else [item.taken(one) for one in listed]
        return tuple(made) if kind is tuple or isinstance(value, tuple) else made

    name = "" if item is None else f" of {item.expected}"
    return Hint(f"a sequence{name}", taken, () if item is None else item.kinds)


def _listed(value: Any) -> list[Any]:
    if isinstance(value, np.ndarray) and value.ndim:
        return list(value)
    return list(_where(isinstance(value, list | tuple), value))


def _array(annotation: Any, shapes: bool) -> Hint:
    """An array of numbers, or what numpy makes one of."""
    name = annotation.__name__.split("[")[0]
    kinds = _KINDS.get(name, "")
    axes = annotation.dim_str.split()
    known = tuple(axes) if shapes and _plain(axes) else ()
    words = {"Bool": "True and False", "Int": "integers", "Float": "real numbers"}.get(name, "numbers")

    def taken(value: Any) -> Any:
        array = value
        if not isinstance(value, annotation.array_type):
            made = isinstance(value, (list, tuple, complex, *_REAL)) or hasattr(value, "to_numpy")
            array = _made(_where(made and annotation.array_type is np.ndarray, value), _MADE.get(name))
        if array.dtype.kind in "iub" and name in _MADE:
            array = array.astype(np.float64)
        if kinds and array.dtype.kind not in kinds and array.size and not (name == "Int" and _integers(array)):
            raise _Wrong("complex numbers where real ones are expected" if array.dtype.kind == "c" else "")
        if known and len(array.shape) != len(known):
            raise _Wrong("an array has the wrong number of axes")
        return array

    return Hint(f"an array of {words}" + (f" ({', '.join(axes)})" if _plain(axes) else ""), taken, (), known)


def _plain(axes: list[str]) -> bool:
    """Whether the axes are of a known number."""
    return not any(axis.startswith(("*", ".", "#", "?")) for axis in axes)


def _made(values: Any, kind: Any) -> np.ndarray:
    """The array of a list; ``_Wrong`` where it is ragged, or has texts or nothing among its numbers."""
    try:
        array = np.asarray(values)
        if array.dtype.kind in ("O" if kind is None else "OUS") and array.size:
            raise _Wrong
        return array if array.dtype.kind == "c" or kind is None or not array.size else array.astype(kind)
    except (ValueError, TypeError):
        raise _Wrong from None


def _integers(array: np.ndarray) -> bool:
    return array.dtype.kind == "f" and bool(np.all(array == np.rint(array)))


def _got(value: Any) -> str:
    """A wrong value in a few words."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}, {value.dtype}"
    if hasattr(value, "shape") and not isinstance(value, np.generic):
        return f"a {type(value).__name__} of shape {tuple(value.shape)}"
    if is_dataclass(value) and not isinstance(value, type):
        return f"a {type(value).__name__}"
    text = repr(value)
    text = text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
    return text if isinstance(value, str | None | PathLike) else f"{text} ({type(value).__name__})"


def _advice(value: Any, hint: Hint) -> str:
    """The next step, where the value shows which one."""
    for kind in hint.kinds:
        if kind in _READERS:
            return _READERS[kind]
    if isinstance(value, str | PathLike) and hint.kinds:
        return "read what is stored in a file by ema.store.load(file)"
    if isinstance(value, str) and "number" in hint.expected and (parsed := _QUANTITY.fullmatch(value)):
        return "write the number alone, in SI units" + (f": {parsed[1]}" if parsed[2] in _UNSCALED else "")
    if hasattr(value, "to_numpy") and "array" in hint.expected:
        return "pass its numbers, as by to_numpy()"
    return ""
