"""The door: foreign files, foreign units, FE matrices, live rigs."""

from importlib import import_module
from typing import Any

_NAMES = {
    "Contents": "acquisition.contents",
    "formats": "acquisition.registry",
    "open_campaign": "acquisition.folder",
    "open_model": "acquisition.model_file",
    "open_rig": "acquisition.taking",
    "read": "acquisition.registry",
    "record": "acquisition.taking",
    "write": "acquisition.registry",
}

__all__ = [*_NAMES]


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    raise AttributeError(f"module 'acquisition' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
