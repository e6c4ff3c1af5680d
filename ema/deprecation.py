"""Calls as they were in the release before: accepted for one release more, with a warning."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import wraps
from inspect import Parameter, signature
from typing import Any, TypeVar, cast
from warnings import warn

Function = TypeVar("Function", bound=Callable[..., Any])


def fields_as_arguments(parameter: str, kind: type) -> Callable[[Function], Function]:
    """Return a decorator for a function that takes an object where it took the fields of that object one by one.

    Parameters
    ----------
    parameter : str
        Name of the argument that takes the object.
    kind : type
        Dataclass of the object, with its fields in the order in which the function took them.

    Returns
    -------
    callable
        The decorator: fields given one by one, by name or in their former places, are put together with a
        ``DeprecationWarning``.

    Examples
    --------
    >>> import warnings
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Section:
    ...     width: float
    ...     height: float = 1.0
    >>> @fields_as_arguments("section", Section)
    ... def area(section: Section) -> float:
    ...     return section.width * section.height
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", DeprecationWarning)
    ...     area(2.0, height=3.0)
    6.0
    """
    given = [field.name for field in fields(kind)]

    def decorated(function: Function) -> Function:
        """Wrap ``function`` so that it takes the fields of the object as well, with a warning."""
        parameters = signature(function).parameters
        names = list(parameters)
        place = names.index(parameter)
        former = [*names[:place], *given, *names[place + 1 :]]

        @wraps(function)
        def call(*args: Any, **options: Any) -> Any:
            """Call the function with the object, put together from fields given one by one."""
            one_by_one = len(args) > place and not isinstance(args[place], kind)
            if not one_by_one and not any(name in options for name in given):
                return function(*args, **options)
            bound = dict(zip(former if one_by_one else names, args, strict=False)) | options
            asked = {name: bound.pop(name) for name in given if name in bound}
            base = bound.pop(parameter, parameters[parameter].default)
            bound[parameter] = kind(**asked) if base is Parameter.empty else replace(base, **asked)
            shown = ", ".join(f"{name}={value!r}" for name, value in asked.items())
            name = getattr(function, "__name__", "it")
            warn(f"{name} takes {parameter}={kind.__name__}({shown})", DeprecationWarning, stacklevel=2)
            return function(**bound)

        return cast(Function, call)

    return decorated
