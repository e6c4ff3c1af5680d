"""JSON files that hold arrays of numbers under names."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files import sniff, table
from acquisition.files.array_contents import contents_of
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read arrays; nested objects become names with dots.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        Which array is what.

    Returns
    -------
    Contents
        What the layout names; texts of the file become its metadata.

    Raises
    ------
    InputError
        The file is damaged, names a key twice, or needs a layout.
    """
    tree = json.loads(table.decode(sniff.whole(path)), object_pairs_hook=lambda pairs: _once(pairs, path.name))
    found = dict(_walk("", tree))
    arrays = {name: value for name, value in found.items() if not isinstance(value, str)}
    metadata = tuple((name, value) for name, value in found.items() if isinstance(value, str))
    tables = [name for name, value in arrays.items() if np.ndim(value) == 2]
    return contents_of(Arrays(path.name, arrays, tables[0] if len(tables) == 1 else "", metadata=metadata), layout)


def _once(pairs: list[tuple[str, Any]], where: str) -> dict[str, Any]:
    """An object whose names differ.

    Raises
    ------
    InputError : a name occurs twice, of which only one could be kept.
    """
    named = dict(pairs)
    if len(named) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError("two values of one name", where=where, got=twice, advice="export the file again")
    return named


def _walk(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _walk(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, (int, float, list)) and not isinstance(value, bool):
        array = _array(value)
        if array.dtype.kind in "iufU" and array.size:
            yield name, array
        elif isinstance(value, list):
            for number, inner in enumerate(value):
                if isinstance(inner, (dict, list)):
                    yield from _walk(f"{name}.{number}" if name else str(number), inner)


def _array(value: Any) -> Any:
    """Numbers or lists of them; ``null`` beside numbers is NaN, as which other programs write it. Else of objects."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of unequal length
        return np.asarray([], dtype=object)
    known = [one for one in array.flat if one is not None] if array.dtype == object else []
    if known and all(isinstance(one, (int, float)) and not isinstance(one, bool) for one in known):
        return array.astype(np.float64)
    return array
