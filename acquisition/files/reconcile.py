"""What a file announces and what it delivers: a difference is an error, or where salvage is asked for a finding."""

from collections.abc import Sequence
from pathlib import Path

from acquisition.files.layout import Layout
from ema.data import Finding
from ema.errors import InputError


def differs(
    what: str, *, where: str, layout: Layout, got: object = None, expected: object = None, recovered: str = ""
) -> tuple[Finding, ...]:
    """The finding about damage that may be salvaged.

    Parameters
    ----------
    what : the difference, as the beginning of a sentence.
    recovered : what is read all the same; empty where nothing can be.

    Raises
    ------
    InputError : salvage was not asked for, or there is nothing to recover.
    """
    if not layout.salvage or not recovered:
        advice = "copy or export the file again" + (", or read it with salvage=true" if recovered else "")
        raise InputError(what, where=where, got=got, expected=expected, advice=advice)
    numbers = f" ({got} instead of {expected})" if got is not None and expected is not None else ""
    return (Finding("error", "salvaged", where, f"{what}{numbers}; {recovered}.", advice="Export the file again."),)


def refuse_doubles(names: Sequence[str], path: Path) -> None:
    """Refuse a container with two arrays of one name, of which a library delivers the last alone.

    Raises
    ------
    InputError : it has.
    """
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError("two arrays of one name", where=str(path), got=", ".join(twice), advice="export it again")
