"""The three ways to contribute, from CONTRIBUTING.md alone: made on a copy, they work, and they are small."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MOST_LINES, MOST_FILES = 60, 3

LAW = """
import numpy as np
from ema.data import FrictionLaw
from ema.simulate import Dahl
from ema.simulate.loops import drive

mu, k, normal = 0.3, 1e6, 100.0
law = FrictionLaw("hardin drnevich", mu, k)
u = np.linspace(0, 2e-4, 60)
# first loading: a hyperbola through the origin that bends towards the slip force
assert np.allclose(drive(law, u, normal), k * u / (1 + k * u / (mu * normal)))
# Dahl's law with exponent 2 is the same law, in another closed form
path = np.concatenate([u, u[::-1], -u])
assert np.allclose(drive(law, path, normal), drive(Dahl(mu, k, 2.0), path, normal), rtol=1e-9, atol=1e-9)
"""

FORMAT = """
from pathlib import Path
import numpy as np, pytest
import acquisition
from ema.errors import InputError

path = Path("a.vib")
rows = np.random.default_rng(1).normal(size=(50, 2))
path.write_text("VIBLOG\\n512 kN g\\n" + "\\n".join(f"{a!r} {b!r}" for a, b in rows.tolist()))
(record,) = acquisition.read(path).recordings
assert record.sampling_rate == 512 and [one.unit for one in record.channels] == ["N", "m/s^2"]
assert np.allclose(record.signals.T, rows * [1000, 9.80665])
path.write_text("VIBLOG\\n512 kN\\n1 2\\n3 4\\n")
with pytest.raises(InputError, match="columns and units differ"):
    acquisition.read(path)
assert "viblog" in [one.name for one in acquisition.formats()]
"""

FINDING = """
import numpy as np
from ema.data import FrfSet
from ema.dof import Dof
from ema.estimate import quality

def codes(lines):
    f = np.linspace(1, 100, lines)
    values = (1 / (1 - (f / 40) ** 2 + 0.02j))[:, None, None]
    found = quality(FrfSet(f, values, (Dof(2, "+Z"),), (Dof(1, "+Z"),), "receptance", "m/N"))
    return [one.code for one in found]

assert "few-lines" in codes(40) and "few-lines" not in codes(400)
"""


def change(root: Path, heading: str) -> str:
    """The change that a section shows."""
    section = (root / "CONTRIBUTING.md").read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    (found,) = re.findall(r"```diff\n(.*?)```", section, re.S)
    return found


@pytest.mark.parametrize(
    ("heading", "program"),
    [("Add a friction law", LAW), ("Add a file format", FORMAT), ("Add a finding", FINDING)],
)
def test_a_contribution_made_from_the_page_works(root: Path, tmp_path: Path, heading: str, program: str) -> None:
    patch = change(root, heading)
    files = re.findall(r"^\+\+\+ b/(.*)$", patch, re.M)
    lines = [line for line in patch.splitlines() if re.match(r"[+-](?![+-]{2} )", line)]
    assert len(files) <= MOST_FILES and len(lines) < MOST_LINES
    for package in ("ema", "acquisition"):
        shutil.copytree(root / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "change.diff").write_text(patch, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "GIT_CEILING_DIRECTORIES": str(tmp_path.parent)}
    applied = subprocess.run(
        ["git", "apply", "-C1", "change.diff"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        env=environment,
    )
    assert applied.returncode == 0, f"{applied.stderr}: write the change of CONTRIBUTING.md anew"
    style = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--config", root / "pyproject.toml", *files],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert style.returncode == 0, style.stdout
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=300, env=environment
    )
    assert done.returncode == 0, done.stderr


def test_the_page_names_every_package_and_files_that_exist(root: Path) -> None:
    text = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    packages = {f"ema.{path.parent.name}" for path in (root / "ema").glob("*/__init__.py")} - {"ema.elements"}
    assert not {name for name in packages if f"`{name}`" not in text}
    for target in re.findall(r"\]\(([^)#]+)", text):
        assert (root / target).exists(), target
