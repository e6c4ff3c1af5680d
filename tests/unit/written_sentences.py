"""Sentences of findings as the sources write them: with ``{}`` for what is filled in where they arise.

Read from the syntax trees: texts, choices between texts, sums, f-strings, variables of the same function, loops over
tuples that are written out, and parameters that every call of the module gives as a text.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from itertools import product
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def trees() -> dict[Path, ast.Module]:
    """The sources of both packages, read once."""
    paths = (path for package in ("ema", "acquisition") for path in sorted((ROOT / package).rglob("*.py")))
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


@cache
def written_calls() -> dict[Path, list[ast.Call]]:
    """All calls in the sources of both packages."""
    return {path: [node for node in ast.walk(tree) if isinstance(node, ast.Call)] for path, tree in trees().items()}


def findings() -> Iterator[tuple[str, ast.Call]]:
    """Calls that state a finding."""
    for path, nodes in written_calls().items():
        for node in nodes:
            if ast.unparse(node.func) in ("Finding", "Finding.of"):
                yield path.relative_to(ROOT).as_posix(), node


@cache
def enclosing() -> dict[ast.Call, ast.AST]:
    """The innermost function around each call, or its module."""
    homes: dict[ast.Call, ast.AST] = {}
    for tree in trees().values():
        scopes = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]  # outer ones come first
        for scope in (tree, *scopes):
            homes |= {node: scope for node in ast.walk(scope) if isinstance(node, ast.Call)}
    return homes


def matched(target: ast.expr, value: ast.expr, name: str) -> list[ast.expr] | None:
    """The part of a value that a name of the target gets; ``None`` where it is not written out."""
    if isinstance(target, ast.Name):
        return [value] if target.id == name else []
    if isinstance(value, ast.IfExp):
        either, other = matched(target, value.body, name), matched(target, value.orelse, name)
        return None if either is None or other is None else either + other
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
        lists = [matched(*pair, name) for pair in zip(target.elts, value.elts, strict=True)]
        return None if None in lists else [one for each in lists for one in each or ()]
    return None if any(isinstance(node, ast.Name) and node.id == name for node in ast.walk(target)) else []


def holds(node: ast.AST, name: str) -> bool:
    return any(isinstance(part, ast.Name) and part.id == name for part in ast.walk(node))


def items(node: ast.expr, scope: ast.AST) -> list[ast.expr] | None:
    """What a loop runs over, where it is written out: a tuple, or the items of a dictionary."""
    if isinstance(node, ast.Tuple | ast.List):
        return node.elts
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "items":
        name = ast.unparse(node.func.value)
        for one in ast.walk(scope):
            if isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == name and isinstance(one.value, ast.Dict):
                pairs = zip(one.value.keys, one.value.values, strict=True)
                return [ast.Tuple([key, value]) for key, value in pairs if key is not None]
    return None


def chosen(node: ast.expr, scope: ast.AST) -> list[ast.expr]:
    """What an expression may be: every value of a dictionary of the function that it looks up."""
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        pairs = items(ast.parse(f"{node.value.id}.items()", mode="eval").body, scope)
        return [pair.elts[1] for pair in pairs if isinstance(pair, ast.Tuple)] if pairs else [node]
    return [node]


def assigned(name: str, scope: ast.AST) -> list[ast.expr] | None:
    """What a variable is set to in a function; ``None`` where that is not all written there."""
    values: list[ast.expr] = []
    for node in ast.walk(scope):
        if isinstance(node, ast.Assign) and holds(node.targets[0], name):
            parts = [matched(node.targets[0], one, name) for one in chosen(node.value, scope)]
        elif isinstance(node, ast.AnnAssign) and node.value is not None and holds(node.target, name):
            parts = [matched(node.target, one, name) for one in chosen(node.value, scope)]
        elif isinstance(node, ast.For) and holds(node.target, name):
            parts = [matched(node.target, one, name) for one in items(node.iter, scope) or [node.iter]]
        elif isinstance(node, ast.AugAssign | ast.AnnAssign | ast.NamedExpr) and holds(node.target, name):
            return None
        else:
            continue
        if None in parts or any(holds(one, name) for each in parts for one in each or ()):
            return None
        values += [one for each in parts for one in each or ()]
    return values or None


def of_callers(name: str, scope: ast.AST) -> list[str] | None:
    """The sentences that a parameter gets from the calls in its module."""
    if not isinstance(scope, ast.FunctionDef) or name not in (names := [one.arg for one in scope.args.args]):
        return None
    (home,) = [tree for tree in trees().values() if scope in functions(tree)]
    calls = [node for node in ast.walk(home) if isinstance(node, ast.Call) and name_of(node) == scope.name]
    place = names.index(name) - (names[0] == "self")
    given = [call.args[place] for call in calls if len(call.args) > place and enclosing()[call] is not scope]
    lists = [alternatives(one, scope_of(one, calls)) for one in given]
    return joined_or_none(lists) if lists and len(lists) == len(calls) else None


@cache
def functions(tree: ast.Module) -> frozenset[ast.AST]:
    return frozenset(node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def name_of(call: ast.Call) -> str:
    return ast.unparse(call.func).rpartition(".")[2]


def scope_of(argument: ast.expr, calls: list[ast.Call]) -> ast.AST:
    return next(enclosing()[call] for call in calls if argument in call.args)


def alternatives(node: ast.expr | None, scope: ast.AST) -> list[str] | None:
    """The sentences that an argument may be, ``{}`` for what is filled in; ``None`` where its words are not here."""
    if node is None:
        return [""]
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [node.value]
    if isinstance(node, ast.IfExp):
        return joined_or_none([alternatives(node.body, scope), alternatives(node.orelse, scope)])
    if isinstance(node, ast.BoolOp):
        return joined_or_none([alternatives(value, scope) for value in node.values])
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Dict):
        return joined_or_none([alternatives(value, scope) for value in node.value.values])
    if isinstance(node, ast.Name):
        values = assigned(node.id, scope)
        if values is None:
            return of_callers(node.id, scope)
        return joined_or_none([alternatives(value, scope) for value in values])
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return products([alternatives(node.left, scope), alternatives(node.right, scope)])
    if isinstance(node, ast.JoinedStr):
        return products([alternatives(part, scope) for part in node.values])
    if isinstance(node, ast.FormattedValue):
        inner = node.value
        known = isinstance(inner, ast.IfExp) or (isinstance(inner, ast.Name) and assigned(inner.id, scope) is not None)
        words = alternatives(inner, scope) if known else None
        return ["{}"] if words is None else words
    return None


def joined_or_none(lists: list[list[str] | None]) -> list[str] | None:
    return None if None in lists else [one for each in lists for one in each or ()]


def products(lists: list[list[str] | None]) -> list[str] | None:
    return None if None in lists else ["".join(parts) for parts in product(*(each or () for each in lists))]


def skeleton(message: str) -> str:
    """A message without the names of its placeholders."""
    return re.sub(r"\{\w*\}", "{}", message)


def arguments(call: ast.Call) -> list[ast.expr | None]:
    """Message and advice of a finding."""
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    place = 6 if ast.unparse(call.func) == "Finding" else 99
    return [
        named.get("message") or (call.args[3] if len(call.args) > 3 else None),
        named.get("advice") or (call.args[place] if len(call.args) > place else None),
    ]


def sentences(call: ast.Call) -> list[str] | None:
    """Messages and advice of a finding; ``None`` where their words are not all written in its function."""
    given = arguments(call)
    if ast.unparse(call.func) == "Finding.of" and all(isinstance(one, ast.Name) for one in given):
        return []  # sentences of a table, each of which is marked
    parts = joined_or_none([alternatives(one, enclosing()[call]) for one in given])
    return None if parts is None else [one for one in dict.fromkeys(parts) if re.search("[a-z]", one)]
