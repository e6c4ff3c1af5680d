"""MATLAB files, v5 to v7.3; structures become names with dots: ``HIdata.acc1``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.quiet import quiet


def read(path: Path, layout: Layout) -> Contents:
    """Read the variables of a MATLAB file.

    Raises
    ------
    InputError : damaged, or in need of a layout.
    """
    return arrange(variables(path), layout)


def variables(path: Path) -> Arrays:
    """All numeric and text variables by name."""
    with path.open("rb") as file:
        v73 = file.read(128)[:10] == b"MATLAB 7.3"
    if v73:
        tree = _v73(path)
    else:
        from scipy.io import loadmat

        with quiet():
            tree = loadmat(path, simplify_cells=True)
    found = {name: value for key, top in tree.items() if not key.startswith("__") for name, value in _walk(key, top)}
    metadata = tuple((name, value) for name, value in found.items() if isinstance(value, str))
    numeric = {name: value for name, value in found.items() if not isinstance(value, str)}
    main = next(iter(numeric)) if len(numeric) == 1 else ""
    return Arrays(path.name, numeric, main, metadata=metadata)


def _walk(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Leaves of nested structures; the items of a cell array are numbered from 0."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _walk(f"{name}.{key}", inner)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = list(np.ravel(np.asarray(value, dtype=object))) if isinstance(value, np.ndarray) else value
        if items and all(isinstance(item, str) for item in items):
            yield name, np.array(items)
        else:
            for number, inner in enumerate(items):
                yield from _walk(f"{name}.{number}", inner)
    elif isinstance(value, (str, np.ndarray, int, float, complex, np.generic)):
        yield name, value


def _v73(path: Path) -> dict[str, Any]:
    """Variables of a v7.3 file, which is HDF5 with the axes reversed."""
    import h5py

    with h5py.File(path, "r") as file:
        return {name: _node(file, item) for name, item in file.items() if not name.startswith("#")}


def _node(file: Any, item: Any) -> Any:
    """A structure, a cell array, a text or an array."""
    if hasattr(item, "items"):
        return {name: _node(file, inner) for name, inner in item.items()}
    kind = item.attrs.get("MATLAB_class", b"").decode()
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.zeros(0)
    if item.dtype == object:
        return [_node(file, file[reference]) for reference in item[...].T.ravel()]
    array = item[...].T
    if kind == "char":
        return "".join(map(chr, array.ravel("F")))
    if array.dtype.names == ("real", "imag"):
        array = array["real"] + 1j * array["imag"]
    return np.squeeze(array)
