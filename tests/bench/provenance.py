"""What a figure belongs to: the commit, the date, the machine, and a fingerprint of the source code that made it.

The fingerprint of a bench is that of its module and of every module of the project that this one imports, directly or
through others. It is taken from the syntax trees without docstrings and without the words of errors, so that only code
counts: a figure is not made by what is raised.
"""

import ast
import hashlib
import json
import subprocess
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from tests.bench.machine import description

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("ema", "acquisition", "tests.bench", "tests.unit")
NOT_MEASURED = (
    "tests.bench.provenance",
    "tests.bench.machine",
    "tests.bench.write_docs",
    "tests.bench.workers",
    "tests.bench.accuracy_page",
    "tests.bench.judged_page",
    "tests.bench.judged_goals",
    "tests.bench.accuracy_goals",
    "tests.bench.simulate_page",
    "tests.bench.stated_errors_page",
    "tests.bench.joint_law_page",
)
"""Modules that say where a figure comes from, where it is computed, or print it, and do not make it."""


def stamp(*modules: str) -> dict:
    """Date, machine, commit, and for each bench module the fingerprint of the code that its figures rest on."""
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "machine": description(),
        "commit": commit(),
        "fingerprint": {module: fingerprint(module) for module in modules},
    }


def published() -> dict[str, dict]:
    """Everything that the pages about accuracy and speed show, by file and section: what was stored with it."""
    results = Path(__file__).parent / "results"
    found = {}
    for name in (
        *("accuracy", "fit", "simulate", "hammer", "placement", "study", "uff", "archive"),
        *("large", "machines", "recordings"),
    ):
        path = results / f"{name}.json"
        if not path.exists():
            continue
        whole = json.loads(path.read_text(encoding="utf-8"))
        parts = whole if name == "accuracy" else whole.get("rows")
        found |= {f"{name}, {part}": stored for part, stored in parts.items()} if parts else {name: whole}
    stated, cold = results / "stated_errors.json", results / "cold_starts.json"
    if stated.exists():
        kinds = json.loads(stated.read_text(encoding="utf-8"))
        found |= {f"stated_errors, {kind}": stored["stamp"] for kind, stored in kinds.items()}
    for path in (cold, *(results / f"{name}.json" for name in ("brake_reuss", "joint_law", "joint_maps"))):
        if path.exists():
            found[path.stem] = json.loads(path.read_text(encoding="utf-8"))
    return found


def outdated(stamped: dict) -> list[str]:
    """The bench modules whose code, or whose imports' code, is no longer that of the stamped figures."""
    known = stamped.get("fingerprint")
    if not known:
        return ["no fingerprint"]
    return [module for module, value in known.items() if not _exists(module) or fingerprint(module) != value]


def commit() -> str:
    """Short hash of the commit, with ``+`` where files differ from it; ``unknown`` outside a checkout."""
    try:
        head, changed = (
            subprocess.run(["git", *command], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
            for command in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain", "--untracked-files=no"))
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head + ("+" if changed else "")


@cache
def fingerprint(module: str) -> str:
    """Hash of the code of ``module`` and of all project modules that it rests on."""
    digest = hashlib.sha256()
    for name in sorted(closure(module)):
        digest.update(f"{name} {_digest(name)}\n".encode())
    return digest.hexdigest()[:16]


@cache
def _digest(module: str) -> str:
    return hashlib.sha256(code(_path(module).read_text(encoding="utf-8")).encode()).hexdigest()


def code(source: str) -> str:
    """The syntax tree without positions, comments, docstrings, other strings that stand alone, and what errors say."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            node.exc = node.exc.func
        for name in ("body", "orelse", "finalbody"):
            block = getattr(node, name, None)
            if isinstance(block, list):
                setattr(node, name, [one for one in block if not _is_remark(one)])
    return _said(tree)


def _said(node: object) -> str:
    """The tree as text; what is empty is left out, for Python versions differ in whether they say it."""
    if isinstance(node, ast.AST):
        fields = [(name, value) for name, value in ast.iter_fields(node) if name not in ("kind", "type_comment")]
        said = ",".join(f"{name}={_said(value)}" for name, value in fields if value is not None and value != [])
        return f"{type(node).__name__}({said})"
    if isinstance(node, list):
        return f"[{','.join(map(_said, node))}]"
    return repr(node)


def _is_remark(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def closure(module: str) -> set[str]:
    """``module`` and all project modules that it imports, directly or through others."""
    known: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in known:
            known.add(name)
            waiting += _imported(name) - known
    return known


@cache
def _imported(module: str) -> frozenset[str]:
    """Project modules that ``module`` imports; a name from a package counts as the module that defines it."""
    tree = ast.parse(_path(module).read_text(encoding="utf-8"))
    wanted: set[tuple[str, str | None]] = set()
    packages: dict[str, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                wanted.add((node.module, alias.name))
                packages[alias.asname or alias.name] = f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            wanted |= {(alias.name, None) for alias in node.names}
    # ``import ema.fit`` and then ``ema.fit.modes``: the attribute says which module is used.
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            owner = ast.unparse(node.value)
            wanted.add((packages.get(owner, owner), node.attr))
    found = {_defining(package, name) for package, name in wanted if package.startswith(PACKAGES)}
    return frozenset(name for name in found if name and name not in NOT_MEASURED and name != module)


def _defining(package: str, name: str | None) -> str | None:
    if name is not None and _exists(f"{package}.{name}"):
        whole = f"{package}.{name}"
        return whole if _path(whole).name != "__init__.py" else None
    if not _exists(package):
        return None
    if name is None or _path(package).name != "__init__.py":
        return package if _path(package).name != "__init__.py" else None
    return _homes(package).get(name, package)


@cache
def _homes(package: str) -> dict[str, str]:
    """Names that a package hands on and the modules that define them: from its imports, and from its maps of lazy names."""
    homes: dict[str, str] = {}
    for node in ast.walk(ast.parse(_path(package).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            homes |= {alias.asname or alias.name: node.module for alias in node.names}
        elif isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and isinstance(value, ast.Constant) and isinstance(value.value, str):
                    found = [name for name in (value.value, f"{package}.{value.value}") if _exists(name)]
                    homes |= {str(key.value): name for name in found}
    return {name: home for name, home in homes.items() if _exists(home)}


def _exists(module: str) -> bool:
    return module.startswith(PACKAGES) and _path(module).is_file()


def _path(module: str) -> Path:
    base = ROOT.joinpath(*module.split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
