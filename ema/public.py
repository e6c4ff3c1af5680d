"""Public names of packages: imported when first used, and guarded against arguments of other types than they declare.

What guards them is imported with the first name, so that importing a package loads nothing but this.
"""

from collections.abc import Callable, Mapping
from typing import Any

from ema import lazy


def attach(
    package: str, homes: Mapping[str, str], former: Mapping[str, str] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package whose functions and classes check arguments.

    Functions are guarded for those who take them from the package; modules that import them from where they are
    defined get them as they are. Constructors of classes are guarded for all.

    Parameters
    ----------
    package : str
        Name of the package.
    homes : mapping
        Each public name with the module that defines it, as for :func:`ema.lazy.attach`.
    former : mapping, optional
        Functions that still take the fields of an argument one by one (:mod:`ema.deprecation`), with that argument.

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
            known[name] = _guarded(plain(name), package, (former or {}).get(name))
        return known[name]

    return __getattr__, listed, names


def _guarded(target: Any, package: str, former: str | None) -> Any:
    """The public form of a function or class.

    A function that still takes the fields of its argument ``former`` one by one puts them together first, and warns its
    caller; then they are compared.
    """
    from inspect import unwrap  # these load numpy and take time
    from typing import get_type_hints

    from ema.arguments import checked
    from ema.deprecation import fields_as_arguments

    if former is None:
        return checked(target, package)
    bare = unwrap(target)
    return fields_as_arguments(former, get_type_hints(bare)[former])(checked(bare, package))
