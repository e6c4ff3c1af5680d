"""The file format of the project (HDF5): every data type is saved and loaded, in blocks larger than memory.

``save(path, container)`` and ``load(path)`` are all that most callers need. ``Writer`` and ``blocks`` write and read
records that are larger than memory, ``describe`` says what a file holds without reading signals, ``replacing`` writes
any file atomically.
"""

from ema.arguments import checked_names
from ema.lazy import attach
from ema.store import steady_states as _steady_states  # noqa: F401

_HOMES = {
    "Writer": "ema.store.writing",
    "blocks": "ema.store.reading",
    "describe": "ema.store.reading",
    "is_store": "ema.store.reading",
    "load": "ema.store.reading",
    "load_fields": "ema.store.fields",
    "replacing": "ema.store.atomic",
    "save": "ema.store.writing",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
__getattr__ = checked_names(__name__, __getattr__)
