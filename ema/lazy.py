"""Packages whose names are imported when first used; what type checkers and editors read is the stub beside each."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def attach(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    The stub ``__init__.pyi`` beside the package says the same to type checkers, which cannot follow the mapping; a test
    compares the two and writes the stub anew on request.

    Parameters
    ----------
    package : str
        Name of the package.
    homes : mapping
        Each public name with the module that defines it. A name that is its own module says so: ``"fit": "ema.fit"``.

    Returns
    -------
    tuple
        The two functions and the sorted list of names.

    Examples
    --------
    >>> __getattr__, __dir__, __all__ = attach("ema.fit", {"modes": "ema.fit.modal"})
    >>> __dir__()
    ['modes']
    >>> __getattr__("modes").__module__
    'ema.fit.modal'
    """
    names = sorted(homes)

    def __getattr__(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(homes[name])
        return module if homes[name] == f"{package}.{name}" else getattr(module, name)

    def __dir__() -> list[str]:
        return list(names)

    return __getattr__, __dir__, names
