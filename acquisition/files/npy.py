"""NumPy files: one array (npy) or several (npz)."""

from pathlib import Path

import numpy as np

from acquisition.contents import Contents
from acquisition.files.arrange import arrange
from acquisition.files.arrays import Arrays
from acquisition.files.layout import Layout


def read(path: Path, layout: Layout) -> Contents:
    """Read an array; nothing that is stored as Python objects is loaded.

    Raises
    ------
    InputError : damaged, holding objects, or in need of a layout.
    """
    loaded = np.load(path, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return arrange(Arrays(path.name, {"": loaded}), layout)
    with loaded:
        return arrange(Arrays(path.name, {name: loaded[name] for name in loaded.files}), layout)
