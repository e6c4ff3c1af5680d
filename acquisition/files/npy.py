"""NumPy files: one array (npy) or several (npz)."""

from pathlib import Path

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout
from acquisition.files.reconcile import differs
from ema.data import Finding


def read(path: Path, layout: Layout) -> Contents:
    """Read an array; nothing that is stored as Python objects is loaded.

    Raises
    ------
    InputError : damaged, holding objects, or in need of a layout.
    """
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        notes = _trailing(path, loaded.nbytes, layout)
        return arrange(Arrays(path.name, {"": loaded}, findings=notes), layout)
    with loaded:
        return arrange(Arrays(path.name, {name: loaded[name] for name in loaded.files}), layout)


def _trailing(path: Path, values: int, layout: Layout) -> tuple[Finding, ...]:
    """Compare the length of the file with that of the header and the values."""
    with path.open("rb") as file:
        major = np.lib.format.read_magic(file)[0]
        file.seek(8)
        width = 2 if major == 1 else 4
        header = 8 + width + int.from_bytes(file.read(width), "little")
    there = path.stat().st_size
    if there == header + values:
        return ()
    return differs(
        "bytes behind the array that its header does not announce", where=path.name, layout=layout,
        got=there - header, expected=values, recovered="the announced values are read",
    )  # fmt: skip
