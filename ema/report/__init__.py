"""Results as reports in HTML, PDF and Word."""

from ema.public import attach

_HOMES = {"write": "ema.report.writing"}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
