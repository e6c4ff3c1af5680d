"""The browser: pick poles, watch shapes, exclude blows."""

from importlib import import_module
from typing import Any

_WHERE = {"Workbench": "ema.app.state", "serve": "ema.app.server"}

__all__ = [*_WHERE]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'ema.app' has no attribute {name!r}")
