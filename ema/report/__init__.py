"""Results -> sections -> HTML."""

from typing import Any

__all__ = ["write"]


def __getattr__(name: str) -> Any:
    if name == "write":
        from ema.report.html import write

        return write
    raise AttributeError(f"module 'ema.report' has no attribute {name!r}")
