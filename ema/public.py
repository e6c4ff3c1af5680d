"""Public names of packages: imported when first used, and guarded against arguments of other types than they declare.

What guards them is imported with the first name, so that importing a package loads nothing but this.
"""

from collections.abc import Callable, Mapping
from typing import Any

from ema import lazy


def attach(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package whose functions and classes check arguments.

    Functions are guarded for those who take them from the package; modules that import them from where they are
    defined get them as they are. Constructors of classes are guarded for all.

    Parameters
    ----------
    package : str
        Name of the package.
    homes : mapping
        Each public name with the module that defines it, as for :func:`ema.lazy.attach`.

    Returns
    -------
    tuple
        The two functions and the sorted list of names.

    Examples
    --------
    >>> __getattr__, __dir__, __all__ = attach("ema.fit", {"modes": "ema.fit.modal"})
    >>> __getattr__("modes")("beam.h5")
    Traceback (most recent call last):
        ...
    ema.errors.InputError: ema.fit.modes, frfs: not what this argument takes; got 'beam.h5', expected FrfSet;
    read one by acquisition.read(file) or ema.store.load(file), or make one by FrfSet.from_arrays
    """
    plain, listed, names = lazy.attach(package, homes)
    known: dict[str, Any] = {}

    def __getattr__(name: str) -> Any:
        if name not in known:
            target = plain(name)
            from ema.arguments import checked  # it loads numpy

            known[name] = checked(target, package)
        return known[name]

    return __getattr__, listed, names
