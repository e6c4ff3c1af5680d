"""How functions are compiled, and kept on disk.

Numba compares the source file of a compiled function with the one it was compiled from, and not those of the functions
called in it. Here every compiled function belongs to the texts of all compiled modules. Nothing is read or written
before a function is called for the first time.

A compiled function carries copies of those that it calls, in each of which the compiler may have put sums in another
order, and the linker takes the first one that the process has. So each function is linked by itself, from what is kept,
also in the process that has just compiled it: results do not depend on who compiled, nor on what was called before.
Where nothing can be kept, Numba links as it always does, and last digits may differ.
"""

import ctypes
import hashlib
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any
from uuid import uuid4

import numba as nb
from numba.core import sigutils
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCPUCodegen
from numba.core.serialize import dumps

from ema.fingerprint import compiled_modules, of_compiled

_PACKAGE = Path(__file__).resolve().parent
_MODULES = frozenset(compiled_modules(_PACKAGE))
_FINGERPRINT = of_compiled(_PACKAGE)

FAST = {"reassoc", "contract", "nsz", "arcp"}
"""Freedoms of the compiler that let it use vector instructions and change results by rounding only."""
_CALLED: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_PLAIN: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
inner: Callable[..., Any] = nb.njit(**_CALLED, **_PLAIN)
fast: Callable[..., Any] = nb.njit(**_CALLED, **_PLAIN, fastmath=FAST)
"""Decorators of functions that only compiled ones call and that make no arrays: a way in from Python would take a
quarter of the time that compiling takes."""
inner_with_arrays: Callable[..., Any] = nb.njit(**_CALLED)
fast_with_arrays: Callable[..., Any] = nb.njit(**_CALLED, fastmath=FAST)
"""The same of functions that make arrays."""


def compiled(**options: Any) -> Callable[..., Any]:
    """Decorator of a compiled function that Python calls, kept on disk; ``options`` of ``numba.njit``.

    Raises
    ------
    ImportError : the function is in a module that the fingerprint does not see.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        """Compile when first called, or read what is kept."""
        path = Path(function.__code__.co_filename).resolve()
        if path not in _MODULES and path.is_file():
            raise ImportError(f"compiled functions belong in modules named *_kernels.py of this package, not in {path}")
        dispatcher = nb.njit(**options)(function)
        if path in _MODULES:  # elsewhere, as in an archive, no text says when a kept function is of no use any more
            dispatcher._cache = _Kept(function, dispatcher._compiler)
        return dispatcher

    return decorate


kernel: Callable[..., Any] = compiled(**_PLAIN)
"""Decorator of a compiled function that Python calls and that makes no arrays."""


class _Kept(FunctionCache):
    """Numba's compiled functions on disk, opened or compiled when first used: one file for every signature.

    A file begins with the hash of what it belongs to and of its content. One of other sources, a damaged one, and one
    that another process replaced meanwhile are compiled again, and no index has to agree with them.
    """

    def __init__(self, function: Callable[..., Any], compiler: Any) -> None:
        self._py_func, self._name, self._compiler = function, repr(function), compiler
        self.enable()

    @cached_property
    def _impl(self) -> Any:
        try:
            return self._impl_class(self._py_func)
        except RuntimeError:  # nothing can be written beside the source, nor in the folder of the user
            return None

    @property
    def cache_path(self) -> str | None:
        """The folder in which the function is kept, ``None`` where there is no such folder."""
        return None if self._impl is None else str(self._impl.locator.get_cache_path())

    def _path(self, key: Any) -> Path:
        name = hashlib.sha256(repr(key).encode()).hexdigest()[:16]
        return Path(str(self.cache_path), f"{self._impl.filename_base}-{name}.nbc")

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        """A compiled function as it is kept, compiled before that if need be."""
        if self._impl is None:
            return None
        key = self._index_key(sig, target_context.codegen())
        content = self._read(key)
        if content is None:
            made = self._compiler.compile(*sigutils.normalize_signature(sig))
            if not self._impl.check_cachable(made):
                return made
            content = dumps(self._impl.reduce(made))
            self._write(key, content)
        alone = target_context.subtarget(_internal_codegen=JITCPUCodegen(self._py_func.__qualname__))
        return self._impl.rebuild(alone, pickle.loads(content))

    def _read(self, key: Any) -> bytes | None:
        try:
            whole = self._path(key).read_bytes()
        except OSError:
            return None
        head, content = whole[:_HEAD], whole[_HEAD:]
        return content if head == _hash(key, content) else None

    def _write(self, key: Any, content: bytes) -> None:
        path = self._path(key)
        new = path.with_suffix(f".{uuid4().hex}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            new.write_bytes(_hash(key, content) + content)
            new.replace(path)
        except OSError:  # a full disk: what cannot be kept is compiled again next time
            with suppress(OSError):
                new.unlink(missing_ok=True)

    def _save_overload(self, sig: Any, data: Any) -> None:
        """Nothing to do: what was compiled is kept before it is used."""

    def flush(self) -> None:
        """Nothing to do: what is kept belongs to the sources."""


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


_HEAD = hashlib.sha256().digest_size


def _hash(key: Any, content: bytes) -> bytes:
    return hashlib.sha256(repr((_FINGERPRINT, nb.__version__, key)).encode() + content).digest()
