"""Results -> sections -> HTML, PDF, Word."""

from typing import Any

__all__ = ["write"]


def __getattr__(name: str) -> Any:
    if name == "write":
        from ema.report.writing import write

        return write
    raise AttributeError(f"module 'ema.report' has no attribute {name!r}")
