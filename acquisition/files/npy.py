"""NumPy files: one array (npy) or several (npz)."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from acquisition.contents import Contents
from acquisition.files.array_contents import contents_of
from acquisition.files.arrays import Arrays, fields
from acquisition.files.hdf5 import not_read
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs, refuse_doubles
from acquisition.files.suppressed_warnings import suppressed_warnings
from acquisition.isolated import call
from acquisition.isolated.limits import check_zip
from ema.data import Finding
from ema.errors import InputError


def read(path: Path, layout: Layout) -> Contents:
    """Read an array, or the arrays of an archive; nothing that is stored as Python objects is loaded.

    Parameters
    ----------
    path : Path
        File that exists and whose format was recognised.
    layout : Layout
        Which array, column or field is what.

    Returns
    -------
    Contents
        What the layout names, with findings for arrays that were not read.

    Raises
    ------
    InputError
        The file is damaged, holds objects, or needs a layout.
    """
    with path.open("rb") as file:
        single = file.read(6) == b"\x93NUMPY"
    if not single:
        there = call("npz", path)
        left = (not_read(path.name, there["left"]),) if there["left"] else ()
        return contents_of(Arrays(path.name, there["arrays"], findings=left, left_out=there["left"]), layout)
    with suppressed_warnings():
        notes = _announced(path, layout)
        array = np.load(path, allow_pickle=False)
    if array.dtype.names is not None:
        numbers, left_out = fields(array, "")
        return contents_of(Arrays(path.name, numbers, findings=notes, left_out=left_out), layout)
    return contents_of(Arrays(path.name, {"": array}, findings=notes), layout)


def members(path: Path) -> dict[str, Any]:
    """The ``arrays`` of numbers and texts in a ZIP archive by name, and the names of what is ``left`` out.

    Raises
    ------
    InputError : they grow beyond measure when they are unpacked, or two have one name.
    """
    check_zip(path)
    arrays: dict[str, Any] = {}
    left: dict[str, str] = {}
    with np.load(path, allow_pickle=False) as archive:
        refuse_doubles(archive.files, path)
        for name in archive.files:
            array = archive[name]
            if isinstance(array, np.ndarray) and array.dtype.kind in "biufcSU":
                arrays[name] = array
            elif isinstance(array, np.ndarray) and array.dtype.names is not None:
                numbers, others = fields(array, f"{name}/")
                arrays.update(numbers)
                left.update(others)
            else:
                left[name] = "no numbers and no texts"
    return {"arrays": arrays, "left": left}


def _announced(path: Path, layout: Layout) -> tuple[Finding, ...]:
    """Compare the length of the file with that of the header and the values, before any memory is taken for them.

    Raises
    ------
    InputError : values are missing or objects; bytes are left over and salvage was not asked for.
    """
    with path.open("rb") as file:
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = header(file)
        begin = file.tell()
    if dtype.hasobject:
        raise InputError(
            "holds Python objects (pickle), which are never loaded", where=path.name, advice="save it as numbers"
        )
    there, values = path.stat().st_size - begin, math.prod(shape) * dtype.itemsize
    if there < values:
        raise InputError(
            "damaged: the file ends inside the array",
            where=path.name,
            got=f"{there} bytes",
            expected=values,
            advice="copy or export it again",
        )
    if there == values:
        return ()
    return differs(
        "bytes behind the array that its header does not announce",
        where=path.name,
        layout=layout,
        got=there,
        expected=values,
        recovered="the announced values are read",
    )
