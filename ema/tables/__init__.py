"""Our TOML files: tables whose every key is checked, mistakes with their line, names of earlier versions."""

from ema.lazy import attach

_HOMES = {
    "FileKind": "ema.tables.file_kind",
    "FormerNames": "ema.tables.former",
    "Table": "ema.tables.schema",
    "Trouble": "ema.tables.schema",
    "all_at_once": "ema.tables.schema",
    "document_of": "ema.tables.schema",
    "line_of": "ema.tables.lines",
    "read_text": "ema.tables.texts",
    "renamed": "ema.tables.former",
    "validated": "ema.tables.schema",
    "warn": "ema.tables.former",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
