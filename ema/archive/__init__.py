"""An index of many campaigns: runs, conditions, modes with their intervals and findings, and questions about them."""

from ema.arguments import checked_names
from ema.lazy import attach

_HOMES = {
    "Added": "ema.archive.adding",
    "Answer": "ema.archive.finding",
    "Observation": "ema.archive.finding",
    "Query": "ema.archive.finding",
    "Source": "ema.archive.record",
    "add": "ema.archive.adding",
    "find": "ema.archive.finding",
    "trend": "ema.archive.picture",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
__getattr__ = checked_names(__name__, __getattr__)
