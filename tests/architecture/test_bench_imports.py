"""Benches run by hand, and some for hours: what they import has to be there when they are started."""

import importlib
from pathlib import Path

import pytest

import tests.bench

FOLDER = Path(tests.bench.__file__).parent
MODULES = sorted(
    ".".join(["tests.bench", *path.relative_to(FOLDER).with_suffix("").parts])
    for path in FOLDER.rglob("*.py")
    if path.name != "__init__.py" and "peers" not in path.parts
)


@pytest.mark.parametrize("name", MODULES)
def test_a_bench_can_be_imported(name: str) -> None:
    importlib.import_module(name)
