"""VTK is asked for by one function only: everything else works where it is absent, and its absence is one sentence."""

import ast
import os
import subprocess
import sys
from pathlib import Path

from tests.journeys.small_campaign import campaign

ABSENT = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("pyvista", "vtk", "vtkmodules"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
sys.modules.pop("pyvista", None)
"""
"""A process in which VTK is not installed."""


def without_vtk(code: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, "-c", ABSENT + code, *arguments], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_a_study_with_its_report_is_done_without_vtk(tmp_path: Path) -> None:
    campaign(tmp_path / "four")
    code = "sys.argv[0] = 'ema'\nfrom ema.cli import main\nmain()\n"
    done = without_vtk(code, "run", "four", "--output", str(tmp_path / "out"), folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert list((tmp_path / "out").glob("*.html"))


def test_its_absence_is_one_sentence_with_the_command_that_installs_it(tmp_path: Path) -> None:
    code = """
from ema.errors import MissingExtraError
from ema.examples import geometry, modal_model
from ema.show import rendered_shape
try:
    rendered_shape(modal_model(), geometry(), 0)
except MissingExtraError as error:
    print(error)
"""
    done = without_vtk(code, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    assert "need the package pyvista" in done.stdout and "-m pip install pyvista" in done.stdout


def test_one_module_names_it(root: Path) -> None:
    """In imports and in texts that are imported."""
    named = set()
    for package in ("ema", "acquisition"):
        for path in (root / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                names += [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []
                if any(name.split(".")[0] in ("pyvista", "vtk", "vtkmodules") for name in names):
                    named.add(path.relative_to(root).as_posix())
    assert named == {"ema/show/renderer.py", "ema/cli/doctor.py"}  # the latter asks for its version
