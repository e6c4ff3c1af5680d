"""Our one file format (HDF5): save and load any noun; versioned, atomic, blocks larger than memory.

``save(path, noun)`` and ``load(path)`` are all that most callers need. ``Writer`` and ``blocks`` write and read records
that are larger than memory, ``describe`` tells what a file holds without reading signals, ``replacing`` writes any file
atomically.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ema.store.atomic import replacing
    from ema.store.reading import blocks, describe, is_store, load
    from ema.store.writing import Writer, save

_HOMES = {
    "save": "writing",
    "Writer": "writing",
    "load": "reading",
    "blocks": "reading",
    "describe": "reading",
    "is_store": "reading",
    "replacing": "atomic",
}

__all__ = ["Writer", "blocks", "describe", "is_store", "load", "replacing", "save"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"ema.store.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'ema.store' has no attribute {name!r}")
