"""The door: foreign files, foreign units, FE matrices, live rigs."""

from ema.lazy import attach

_HOMES = {
    "Contents": "acquisition.contents",
    "formats": "acquisition.registry",
    "open_campaign": "acquisition.folder",
    "open_model": "acquisition.model_file",
    "open_rig": "acquisition.taking",
    "read": "acquisition.registry",
    "record": "acquisition.taking",
    "write": "acquisition.registry",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
