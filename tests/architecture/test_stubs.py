"""Type checkers and editors see the signatures behind the lazy packages.

Run with ``EMA_WRITE_STUBS=1`` to write every ``__init__.pyi`` anew from the mapping of its package.
"""

import os
import pkgutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

import acquisition
import ema


def lazy_packages() -> list[ModuleType]:
    found = []
    for root in (ema, acquisition):
        names = [one.name for one in pkgutil.iter_modules(root.__path__, f"{root.__name__}.") if one.ispkg]
        found += [module for module in (root, *map(import_module, names)) if hasattr(module, "_HOMES")]
    return found


def stub(package: ModuleType) -> str:
    name, homes = package.__name__, sorted(package._HOMES.items(), key=lambda item: (item[1], item[0]))
    parts = [
        [f"from {home} import {public} as {public}" for public, home in homes if home != f"{name}.{public}"],
        [f"from . import {public} as {public}" for public, home in homes if home == f"{name}.{public}"],
        [f"{public}: str" for public in package.__all__ if public not in package._HOMES],
    ]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


@pytest.mark.parametrize("package", lazy_packages(), ids=lambda package: package.__name__)
def test_the_stub_says_what_the_package_does(package: ModuleType) -> None:
    path = Path(str(package.__file__)).with_suffix(".pyi")
    if os.environ.get("EMA_WRITE_STUBS"):
        path.write_text(stub(package), encoding="utf-8")
    assert path.is_file(), "see the first lines of this file"
    assert path.read_text(encoding="utf-8") == stub(package), "see the first lines of this file"


@pytest.mark.parametrize("package", lazy_packages(), ids=lambda package: package.__name__)
def test_completion_offers_every_public_name_and_nothing_else(package: ModuleType) -> None:
    assert dir(package) == sorted(package.__all__)
    assert not {"Any", "import_module", "attach"} & set(dir(package))


def test_packages_are_marked_as_typed() -> None:
    for root in (ema, acquisition):
        assert (Path(str(root.__file__)).parent / "py.typed").is_file()


WRONG = """
import acquisition
import ema

ema.fit.modes(3, nonsense=4)
ema.simulate.snapback()
ema.no_such_package
acquisition.open_campaign(folder=3.0)
reveal_type(ema.store.load("a.h5"))
reveal_type(ema.fit.stabilise)
"""


def test_a_wrong_call_is_seen_by_a_type_checker(tmp_path: Path, root: Path) -> None:
    (tmp_path / "wrong.py").write_text(WRONG, encoding="utf-8")
    (tmp_path / "mypy.ini").write_text("[mypy]\nignore_missing_imports = True\nfollow_imports = silent\n")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), "wrong.py"],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(root)},
        capture_output=True,
        text=True,
        timeout=500,
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 1, done.stdout + done.stderr
    for number, words in (
        (5, 'Unexpected keyword argument "nonsense" for "modes"'),
        (5, 'Argument 1 to "modes" has incompatible type "int"'),
        (6, "Missing positional argument"),
        (7, 'Module has no attribute "no_such_package"'),
        (8, 'Unexpected keyword argument "folder"'),
        (10, "PoleTable"),
    ):
        assert any(line.startswith(f"wrong.py:{number}:") and words in line for line in lines), (number, done.stdout)
