"""Importing the packages and their rooms loads numpy and nothing heavy, and changes nothing in the process."""

import json
import subprocess
import sys

import pytest

HEAVY = (
    "pandas",
    "pyvista",
    "vtkmodules",
    "matplotlib",
    "numba",
    "scipy.signal",
    "scipy.optimize",
    "pint",
    "pydantic",
    "pyuff",
    "h5py",
    "typer",
    "rich",
    "jinja2",
    "nptdms",
    "asammdf",
    "soundfile",
    "openpyxl",
)
ROOMS = (
    "ema.data",
    "ema.datasets",
    "ema.store",
    "ema.synthesis",
    "ema.shapes",
    "ema.estimate",
    "ema.fit",
    "ema.simulate",
    "ema.show",
    "ema.proposal",
    "ema.report",
    "ema.app",
    "ema.study",
    "ema.cli",
    "acquisition.files",
)

PROBE = """
import json, sys, warnings
import numpy
before, error_state = list(warnings.filters), numpy.geterr()
import ema, acquisition
{more}
changed = list(warnings.filters) != before or numpy.geterr() != error_state
print(json.dumps([sorted(sys.modules), changed]))
"""


def loaded_by(more: str) -> tuple[list[str], bool]:
    done = subprocess.run(
        [sys.executable, "-c", PROBE.format(more=more)], capture_output=True, text=True, timeout=120, check=True
    )
    modules, changed = json.loads(done.stdout)
    return [name for name in HEAVY if name in modules], changed


@pytest.mark.parametrize("more", ["", *(f"import {room}" for room in ROOMS)])
def test_import_is_light_and_has_no_side_effects(more):
    heavy, changed = loaded_by(more)
    assert heavy == []
    assert not changed


def test_a_command_loads_what_it_needs_and_no_more():
    """The workbench, and with it the fit and scipy.stats, was loaded by every command: a second of processor time."""
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "ema", "--version"], capture_output=True, text=True, check=True
    )
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines()}
    assert "ema.cli.app" in loaded
    assert not loaded & {"ema.app.state", "ema.fit.modal", "scipy.stats", "scipy.linalg"}


def test_the_probe_notices_a_heavy_import():
    heavy, changed = loaded_by("import h5py, warnings; warnings.simplefilter('ignore')")
    assert heavy == ["h5py"] and changed
