"""MATLAB files, v5 to v7.3; structures become names with dots: ``HIdata.acc1``."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from acquisition.contents import Contents
from acquisition.files.array_contents import contents_of
from acquisition.files.arrays import Arrays
from acquisition.files.hdf5 import compare_length, not_read
from acquisition.files.layout import Layout
from acquisition.files.reconcile import refuse_doubles
from acquisition.files.scales import is_unit
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.isolated import call
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read the variables of a MATLAB file.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        Which variable is what; ``salvage``: read a file that is not as long as it announces.

    Returns
    -------
    Contents
        What the layout names; text variables become metadata.

    Raises
    ------
    InputError
        The file is damaged, or needs a layout.
    """
    notes = compare_length(path, layout)
    contents = contents_of(variables(path), layout)
    return replace(contents, findings=(*notes, *contents.findings))


def variables(path: Path) -> Arrays:
    """All numeric and text variables by name."""
    _check_elements(path)
    there = call("matlab", path)
    values: dict[str, Any] = there["values"]
    metadata = tuple((name, value) for name, value in values.items() if isinstance(value, str))
    numeric = {name: value for name, value in values.items() if not isinstance(value, str)}
    main = next(iter(numeric)) if len(numeric) == 1 else ""
    notes = (not_read(path.name, there["left"]),) if there["left"] else ()
    return Arrays(
        path.name, numeric, main, metadata=metadata, labels=_labels(values), findings=notes, left_out=there["left"]
    )


def tree(path: Path) -> dict[str, Any]:
    """The ``values`` of a file by name, texts or arrays, and the names of the objects that are ``left`` out.

    Raises
    ------
    InputError : it leads to another file, or holds what was never written.
    """
    with path.open("rb") as file:
        v73 = file.read(128)[:10] == b"MATLAB 7.3"
    left: dict[str, str] = {}
    try:
        top = _v73(path, left) if v73 else _v5(path)
        leaves = [leaf for key, value in top.items() if not key.startswith("__") for leaf in _walk(key, value)]
    except InputError as error:
        raise InputError(
            error.what, where=str(path), got=error.got, expected=error.expected, advice=error.advice
        ) from error
    left |= {name: value.what for name, value in leaves if isinstance(value, _Object)}
    return {"values": {name: value for name, value in leaves if not isinstance(value, _Object)}, "left": left}


def _v5(path: Path) -> dict[str, Any]:
    """Variables of a file before v7.3."""
    from scipy.io import loadmat, whosmat

    with suppressed_warnings():
        refuse_doubles([name for name, _, _ in whosmat(path)], path)
        return dict(loadmat(path, simplify_cells=True))


def _check_elements(path: Path) -> None:
    """Compare the sizes that the top elements of a v5 file state with the length of the file.

    Source: MAT-File Format (MathWorks), level 5: behind a header of 128 bytes follow elements, each a tag of 8 bytes
    (type, size) and as many bytes as it says.

    Raises
    ------
    InputError : the elements do not end where the file does.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(128)
        order: Literal["little", "big"] = "little" if head[126:128] == b"IM" else "big"
        if head[126:128] not in (b"IM", b"MI") or int.from_bytes(head[124:126], order) != 0x0100:
            return  # v4, or v7.3
        place = 128
        while place < size:
            file.seek(place)
            tag = file.read(8)
            place += 8 + int.from_bytes(tag[4:], order)
            if len(tag) < 8 or place > size:
                raise InputError(
                    "the file ends inside a variable",
                    where=path.name,
                    got=f"{size} bytes",
                    expected=f"{place}",
                    advice="copy or export it again",
                )


_OBJECT = "an object, or what is no number"


@dataclass(frozen=True)
class _Object:
    """Stands for an object of MATLAB (a table, a function, a string array), which is never built."""

    what: str = _OBJECT


_FULL = 1 << 22
"""Numbers of a sparse matrix in full, from which on it is left out: 32 MB. Such matrices are those of models: square
ones of up to 2048 degrees of freedom are read; with half or twice the limit, of up to 1448 or 2896."""


def _in_full(matrix: Any, name: str) -> "np.ndarray | _Object":
    """A sparse matrix as an array, where that is not large.

    Raises
    ------
    InputError : its places are not inside of it.
    """
    rows, columns = matrix.shape
    if rows * columns > _FULL:
        return _Object(f"a sparse matrix that is large in full, {rows} by {columns}")
    try:
        matrix.check_format(full_check=True)
    except ValueError as error:
        raise InputError(
            "a sparse matrix whose places do not fit",
            got=f"{name}, {error}",
            advice="save the matrix again, or in full",
        ) from error
    full: np.ndarray = matrix.toarray()
    return full


def _sparse(group: Any, name: str, left: dict[str, str]) -> Any:
    """A sparse matrix of a v7.3 file: numbers by column, their rows, and where each column begins.

    Raises
    ------
    InputError : these do not fit together.
    """
    from scipy.sparse import csc_matrix

    from ema.store import untrusted

    parts = [group[key] if key in group else np.zeros(0) for key in ("data", "ir", "jc")]  # none where all are zero
    for part, key in zip(parts, ("data", "ir", "jc")):
        if not isinstance(part, np.ndarray):
            untrusted.check(part, f"{name}.{key}")
    data, rows, begins = (np.ravel(part[...]) for part in parts)
    if data.dtype.names == ("real", "imag"):
        data = data["real"] + 1j * data["imag"]
    try:
        shape = (int(group.attrs["MATLAB_sparse"]), max(len(begins) - 1, 0))
        matrix = csc_matrix((data, rows.astype(np.int64), begins.astype(np.int64)), shape=shape)
    except (ValueError, TypeError) as error:
        raise InputError(
            "a sparse matrix whose places do not fit",
            got=f"{name}, {error}",
            advice="save the matrix again, or in full",
        ) from error
    full = _in_full(matrix, name)
    if isinstance(full, _Object):
        left[name] = full.what
        return None
    return full


def _labels(found: dict[str, Any]) -> dict[str, str]:
    """Units that a structure states in a text field ``units``: one for each of its arrays, in their order."""
    labels: dict[str, str] = {}
    for name, text in found.items():
        structure, _, last = name.rpartition(".")
        if last.lower() not in ("unit", "units") or not isinstance(text, str):
            continue
        inside = [n for n, value in found.items() if n.rpartition(".")[0] == structure and not isinstance(value, str)]
        stated = [part.strip() for part in re.split("[,;]", text)]
        if len(stated) == len(inside) and all(map(is_unit, stated)):
            labels.update(zip(inside, stated, strict=True))
    return labels


def _walk(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Leaves of nested structures; the items of a cell array are numbered from 0."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _walk(f"{name}.{key}", inner)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = list(np.ravel(np.asarray(value, dtype=object))) if isinstance(value, np.ndarray) else value
        if type(value).__name__ in ("MatlabObject", "MatlabOpaque", "MatlabFunction"):
            yield name, _Object()
        elif items and all(isinstance(item, str) for item in items):
            yield name, np.array(items)
        else:
            for number, inner in enumerate(items):
                yield from _walk(f"{name}.{number}", inner)
    elif hasattr(value, "toarray"):
        yield name, _in_full(value, name)
    elif isinstance(value, np.ndarray) and value.dtype.names is not None:
        yield name, _Object()
    elif isinstance(value, (str, np.ndarray, int, float, complex, np.generic, _Object)):
        yield name, value


def _v73(path: Path, left: dict[str, str]) -> dict[str, Any]:
    """Variables of a v7.3 file, which is HDF5 with the axes reversed; names of objects go to ``left``."""
    from ema.store import untrusted

    with untrusted.opened(path) as file:
        for name in file:
            untrusted.refuse_link(file.get(name, getlink=True), name)
        return {name: _node(untrusted.member(file, name), name, (), left) for name in file if not name.startswith("#")}


def _node(item: Any, name: str, users: tuple[int, ...], left: dict[str, str]) -> Any:
    """A structure, a cell array, a text or an array; ``users`` are the addresses of what holds it.

    Raises
    ------
    InputError : it holds itself, or leads outside the file.
    """
    import h5py

    from ema.store import untrusted

    address = h5py.h5o.get_info(item.id).addr
    if address in users:
        raise InputError("holds a variable that is inside itself", got=name, advice="save the file again without it")
    users = (*users, address)
    if "MATLAB_object_decode" in item.attrs:
        left[name] = _OBJECT
        return None
    if isinstance(item, h5py.Group) and "MATLAB_sparse" in item.attrs:
        return _sparse(item, name, left)
    if isinstance(item, h5py.Group):
        return {key: _node(untrusted.member(item, key), f"{name}.{key}", users, left) for key in item}
    kind = _class(item)
    if item.attrs.get("MATLAB_empty", 0):
        return "" if kind == "char" else np.zeros(0)
    untrusted.check(item, name)
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        # an object reference is an address in this very file
        inside = [item.file[reference] for reference in item[...].T.ravel() if reference]
        return [_node(one, f"{name}.{number}", users, left) for number, one in enumerate(inside)]
    if item.dtype.kind not in "biufc" and item.dtype.names != ("real", "imag"):
        left[name] = _OBJECT
        return None
    array = item[...].T
    if kind == "char":
        return "".join(map(chr, array.ravel("F")))
    if array.dtype.names == ("real", "imag"):
        array = array["real"] + 1j * array["imag"]
    return np.squeeze(array)


def _class(item: Any) -> str:
    """The class that MATLAB notes beside a variable."""
    value = item.attrs.get("MATLAB_class", b"")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
