"""Compiled code of functions of the user's own, kept between processes."""

import ctypes
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numba as nb

from ema.compiled import _Kept


class Compiled:
    """A function of the user's own, compiled for numbers: ``address`` as a C function, and as one of ``ctypes``."""

    def __init__(self, address: int, numbers: int) -> None:
        self.address, self._numbers = address, numbers

    @cached_property
    def ctypes(self) -> Callable[..., float]:
        """The function, to be called from Python."""
        kind: Callable[..., float] = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * self._numbers)(self.address)
        return kind


_LIBRARIES: list[Any] = []
"""Code that addresses point into, for the life of the process."""


def of_numbers(function: Callable[..., float], numbers: int, fingerprint: str) -> Compiled:
    """Compile a function of so many numbers that returns one, or read what is kept of its ``fingerprint``.

    It is kept beside the file of the function, or where Numba keeps what it may not write there; a function that is in
    no file is compiled by every process.

    Raises
    ------
    Exception : whatever Numba says of a function that it cannot compile.
    """
    options: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True}
    dispatcher: Any = nb.njit(**options)(function)
    if function.__module__ in sys.modules:  # what is kept names its module, which ``exec`` gives none
        dispatcher._cache = _KeptOfUser(function, dispatcher._compiler, fingerprint)
    signature = nb.float64(*[nb.float64] * numbers)
    dispatcher.compile(signature)
    made = dispatcher.overloads[signature.args]
    _LIBRARIES.append(made)
    return Compiled(int(made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name)), numbers)


class _KeptOfUser(_Kept):
    """What is kept of a function of the user's own belongs to the fingerprint of it and all that it refers to."""

    def __init__(self, function: Callable[..., Any], compiler: Any, fingerprint: str) -> None:
        self._fingerprint = fingerprint
        super().__init__(function, compiler)

    def _path(self, key: Any) -> Path:
        # what a former function of this name left is replaced
        return super()._path(key[1] if isinstance(key[0], str) else key)

    def _read(self, key: Any) -> bytes | None:
        return super()._read((self._fingerprint, key))

    def _write(self, key: Any, content: bytes) -> None:
        super()._write((self._fingerprint, key), content)
