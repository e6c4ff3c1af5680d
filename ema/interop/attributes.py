"""What objects of other packages are asked for, and DOFs that they do not know."""

from collections.abc import Sequence
from typing import Any

from ema.dof import Dof
from ema.errors import InputError


def read(thing: Any, names: Sequence[str], what: str, advice: str = "") -> list[Any]:
    """Return attributes (or items of a mapping) of an object.

    Parameters
    ----------
    thing : the object or the mapping.
    names : attributes or keys that it must have.
    what : what ``thing`` should be, with its article, for the message: ``"a modal analysis of pyFBS"``.
    advice : next step for the message.

    Returns
    -------
    Their values, in the order of ``names``.

    Raises
    ------
    InputError : one of them is missing or not filled in (None).

    Examples
    --------
    >>> read({"freq": [10.0], "damping": 0.01}, ["damping", "freq"], "a table of poles")
    [0.01, [10.0]]
    """
    values = [thing.get(name) if isinstance(thing, dict) else getattr(thing, name, None) for name in names]
    missing = [name for name, value in zip(names, values, strict=True) if value is None]
    if missing:
        raise InputError(
            f"not {what}",
            got=f"a {type(thing).__name__} without " + ", ".join(missing),
            expected="an object with " + ", ".join(names),
            advice=advice,
        )
    return values


def dofs(given: Sequence[Dof | str] | None, count: int, what: str) -> tuple[Dof, ...]:
    """Return the DOFs given, or scalars 1 ... ``count`` where none were.

    Raises
    ------
    InputError : there are more or fewer than ``count``.
    """
    if given is None:
        return tuple(Dof(number) for number in range(1, count + 1))
    if len(given) != count:
        raise InputError(f"the DOFs and {what} disagree", got=f"{len(given)} DOFs", expected=str(count))
    return tuple(Dof.parse(dof) for dof in given)
