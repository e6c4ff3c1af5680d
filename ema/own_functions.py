"""Functions of the user's own: a fingerprint of each, and its name where it is a friction law."""

import ast
import hashlib
import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any


class LawName(str):
    """Name of a friction law of the user's own, which keeps of which function it is the name.

    It equals the plain text. Where it is sent to another process, the module of the function is imported there, as
    laws are usually registered in it; ``__main__`` cannot be.
    """

    fingerprint: str
    module: str

    def __new__(cls, name: str, fingerprint: str, module: str = "") -> "LawName":
        """The name with ``of_function`` of its function, and the module of that."""
        made = super().__new__(cls, name)
        made.fingerprint, made.module = fingerprint, module
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return _received, (str(self), self.fingerprint, self.module)


def _received(name: str, fingerprint: str, module: str) -> LawName:
    """The name in another process; what uses the law says so if nothing has registered it."""
    if module and module != "__main__" and module not in sys.modules:
        with suppress(Exception):
            import_module(module)
    return LawName(name, fingerprint, module)


def of_function(function: Callable[..., Any]) -> str:
    """Fingerprint of a function with all that it refers to: helpers, and values from outside, which compiling freezes.

    ``source`` and the SHA-256 of the syntax, in which the name of a function, its docstring, comments, annotations and
    layout do not count; the same for every release of Python. Where there is no source, or another one than that which
    was executed, ``bytecode`` with the release. Of functions of installed packages the name alone counts.
    """
    whole, kinds = hashlib.sha256(), set[str]()
    for text in _texts(function, kinds, []):
        whole.update(text.encode("utf-8", "surrogatepass") + b"\0")
    kind = f"bytecode {sys.version_info.major}.{sys.version_info.minor}" if "bytecode" in kinds else "source"
    return f"{kind}:{whole.hexdigest()[:32]}"


def _texts(function: Any, kinds: set[str], seen: list[CodeType]) -> Iterator[str]:
    """What a function computes, and the values of the names in it."""
    function = getattr(function, "py_func", function)
    code = function.__code__
    if code in seen:
        yield f"function {seen.index(code)}"
        return
    seen.append(code)
    syntax = _syntax(function)
    kinds.add("bytecode" if syntax is None else "source")
    yield _bytecode(code) if syntax is None else repr(_plain(syntax))
    yield from _values(function.__defaults__, (), kinds, seen)
    names = sorted({name for part in _codes(code) for name in part.co_names})
    known = {name: function.__globals__[name] for name in names if name in function.__globals__}
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        with suppress(ValueError):  # a name that has no value yet
            known[name] = cell.cell_contents
    for name in sorted(known):
        yield name
        yield from _values(known[name], names, kinds, seen)


def _values(value: Any, names: Sequence[str], kinds: set[str], seen: list[CodeType]) -> Iterator[str]:
    """A value as texts; of a module those of its ``names``."""
    if isinstance(value, ModuleType):
        yield f"module {value.__name__}"
        for name in names if _of_user(value) else ():
            if name in vars(value):
                yield name
                yield from _values(vars(value)[name], (), kinds, seen)
    elif isinstance(getattr(value, "py_func", value), FunctionType):
        plain = getattr(value, "py_func", value)
        if _of_user(sys.modules.get(plain.__module__)):
            yield from _texts(plain, kinds, seen)
        else:
            yield f"{plain.__module__}.{plain.__qualname__}"
    elif isinstance(value, tuple | list):
        yield f"{type(value).__name__} {len(value)}"
        for item in value:
            yield from _values(item, (), kinds, seen)
    elif hasattr(value, "dtype") and hasattr(value, "tobytes"):
        yield f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    else:
        yield f"{type(value).__name__} {re.sub(r' at 0x[0-9a-fA-F]+', '', repr(value))}"


def _of_user(module: ModuleType | None) -> bool:
    """Whether a module is neither of Python nor of an installed package; one that is no more may be."""
    if module is None:
        return True
    top, file = module.__name__.partition(".")[0], getattr(module, "__file__", None) or ""
    return top not in sys.stdlib_module_names - {"__main__"} and not {"site-packages", "dist-packages"} & set(
        Path(file).parts
    )


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _codes(part)


def _bytecode(code: CodeType) -> str:
    inner = [_bytecode(part) for part in code.co_consts if isinstance(part, CodeType)]
    return repr((code.co_argcount, code.co_code, _constants(code), inner, code.co_names))


_UNSEEN = ("name", "decorator_list", "returns", "annotation", "type_comment", "type_params", "kind", "ctx")
"""Fields of the syntax of functions and arguments that compute nothing, or that not every release of Python has."""


def _syntax(function: FunctionType) -> ast.AST | None:
    """The syntax of a function without its docstring, ``None`` where it cannot be had or is not what was executed."""
    code = function.__code__
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
        whole = "".join(inspect.findsource(function)[0])
        # the file may have been edited since it was executed
        codes = _codes(compile(whole, "<text>", "exec", dont_inherit=True))
        if not any(_same(part, code) for part in codes):
            return None
    except (OSError, TypeError, SyntaxError, ValueError):
        return None
    kind = ast.Lambda if code.co_name == "<lambda>" else ast.FunctionDef
    nodes = [
        node for node in ast.walk(tree) if isinstance(node, kind) and getattr(node, "name", "") in ("", code.co_name)
    ]
    if not nodes or (kind is ast.Lambda and len(nodes) > 1):
        return None
    node = nodes[0]
    if isinstance(node, ast.FunctionDef) and ast.get_docstring(node, clean=False) is not None:
        node.body = node.body[1:]
    return node


def _same(one: CodeType, other: CodeType) -> bool:
    """Whether two functions of one name and line compute the same."""
    attributes = ("co_name", "co_firstlineno", "co_code", "co_names", "co_varnames", "co_freevars")
    if any(getattr(one, name) != getattr(other, name) for name in attributes):
        return False
    return _constants(one) == _constants(other)


def _constants(code: CodeType) -> list[str]:
    return [repr(part) for part in code.co_consts if not isinstance(part, CodeType)]


def _plain(node: Any) -> Any:
    """A tree of lists and texts: fields that are empty are left out, as some releases of Python do."""
    if isinstance(node, ast.AST):
        fields = ((name, value) for name, value in ast.iter_fields(node) if name not in _UNSEEN)
        return [type(node).__name__, *([name, _plain(value)] for name, value in fields if value not in (None, []))]
    if isinstance(node, list):
        return [_plain(item) for item in node]
    return f"{type(node).__name__} {node!r}"
