"""Walls that the import linter does not see: whole packages, names of modules in texts, private parts of acquisition."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

import acquisition

MODULE = re.compile(r"(ema|acquisition)(\.[a-z_]+)+")


@pytest.fixture(scope="module")
def floors(root: Path) -> dict[str, int]:
    """The floor of every top-level module, 0 the highest."""
    settings = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = (one["layers"] for one in settings["tool"]["importlinter"]["contracts"] if one["type"] == "layers")
    return {name.strip(" ()"): floor for floor, line in enumerate(layers) for name in line.split("|")}


def part(module: str) -> str:
    """The top-level module that a module belongs to: ``ema.fit`` of ``ema.fit.modal``, ``acquisition``."""
    return "acquisition" if module.startswith("acquisition") else ".".join(module.split(".")[:2])


def modules(root: Path) -> Iterator[tuple[str, ast.Module]]:
    for package in ("ema", "acquisition"):
        for path in sorted((root / package).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
            yield name, ast.parse(path.read_text(encoding="utf-8"))


def test_every_top_level_module_has_a_floor(root: Path, floors: dict[str, int]) -> None:
    present = {part(name) for name, _ in modules(root)} - {"ema", "ema.__main__"}
    assert present == set(floors)


def whole_package_imports(tree: ast.Module) -> list[int]:
    """Lines that bind the whole package, behind which every floor can be reached: ``import ema``, ``import ema.data``."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [node.lineno for alias in node.names if alias.name.split(".")[0] == "ema" and not alias.asname]
    return found


def test_the_whole_package_is_imported_by_the_command_line_alone(root: Path) -> None:
    found = [f"{name}:{line}" for name, tree in modules(root) for line in whole_package_imports(tree)]
    assert [place for place in found if part(place.split(":")[0]) not in ("ema.cli", "ema.study", "ema.__main__")] == []


def named_modules(tree: ast.Module) -> list[str]:
    """Modules of ours that texts of the module name, whole or the beginning of a formatted text."""
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [text.strip(".") for text in texts if MODULE.fullmatch(text.strip("."))]


def test_modules_named_in_texts_keep_to_the_floors(root: Path, floors: dict[str, int]) -> None:
    """``import_module("ema.cli.app")`` is an import too."""
    broken = []
    for name, tree in modules(root):
        if name == "ema":
            continue
        for target in named_modules(tree):
            below = part(target) == part(name) or floors.get(part(target), -1) > floors.get(part(name), -1)
            if part(target) in floors and not below:
                broken.append(f"{name} names {target}")
    assert broken == []


def outside_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """What a module takes from ``acquisition``: line and dotted name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name.startswith("acquisition."))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "acquisition":
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def is_public(dotted: str) -> bool:
    """Whether a name is one of ``acquisition`` or of one of its public modules."""
    first, *rest = dotted.removeprefix("acquisition.").split(".")
    if first not in acquisition.__all__:
        return False
    return not rest or (len(rest) == 1 and rest[0] in import_module(f"acquisition.{first}").__all__)


def test_only_public_names_of_acquisition_are_used_outside_it(root: Path) -> None:
    private = [
        f"{name}:{line} {dotted}"
        for name, tree in modules(root)
        if not name.startswith("acquisition")
        for line, dotted in outside_names(tree)
        if not is_public(dotted)
    ]
    assert private == []


def test_the_rules_notice_what_they_forbid(floors: dict[str, int]) -> None:
    assert whole_package_imports(ast.parse("import ema\nimport ema.fit\nfrom ema import fit\nimport ema.fit as f")) == [
        1,
        2,
    ]
    assert named_modules(ast.parse('import_module("ema.cli.app"); import_module(f"ema.{x}"); "ema is"')) == [
        "ema.cli.app"
    ]
    assert [is_public(name) for _, name in outside_names(ast.parse("from acquisition import read, folder"))] == [
        True,
        False,
    ]
    assert not is_public("acquisition.model_file.CATALOGUE") and is_public("acquisition.model_file.load")
    assert floors["ema.cli"] < floors["ema.data"] < floors["ema.errors"]


def test_importing_writes_nothing(root: Path, tmp_path: Path) -> None:
    """Neither beside the modules nor in the home, the working or the cache folder of a user."""
    places = {name: tmp_path / name for name in ("home", "work", "cache", "temporary")}
    for place in places.values():
        place.mkdir()
    before = _state(root)
    code = (
        "import sys, pkgutil, importlib; sys.dont_write_bytecode = True\n"
        "import ema, acquisition\n"
        "for package in (ema, acquisition):\n"
        "    for one in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        "        if not one.name.endswith('__main__'): importlib.import_module(one.name)\n"
    )
    environment = os.environ | {
        "HOME": str(places["home"]),
        "XDG_CACHE_HOME": str(places["cache"]),
        "TMPDIR": str(places["temporary"]),
        "NUMBA_CACHE_DIR": str(places["cache"] / "numba"),
        "MPLCONFIGDIR": str(tmp_path / "matplotlib"),
        "PYTHONPATH": str(root),
    }
    subprocess.run([sys.executable, "-c", code], cwd=places["work"], env=environment, check=True, timeout=300)
    written = [path for place in places.values() for path in place.rglob("*")]
    assert written == [] and _state(root) == before


def _state(root: Path) -> dict[str, tuple[int, int]]:
    paths = [path for package in ("ema", "acquisition") for path in (root / package).rglob("*")]
    states = {str(path): path.stat() for path in paths if "__pycache__" not in path.parts}
    return {name: (state.st_size, state.st_mtime_ns) for name, state in states.items() if not name.endswith(".pyc")}
