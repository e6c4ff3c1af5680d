"""The public names are a promise: none comes or goes unnoticed.

Run with ``EMA_WRITE_PUBLIC_NAMES=1`` to write ``public_names.txt`` anew, and read the difference before committing it.
"""

import os
import pkgutil
from importlib import import_module
from inspect import isclass, ismodule, isroutine
from pathlib import Path

import pytest

ROOMS = (
    "ema",
    "ema.app",
    "ema.archive",
    "ema.compare",
    "ema.data",
    "ema.datasets",
    "ema.elements",
    "ema.estimate",
    "ema.fit",
    "ema.interop",
    "ema.messages",
    "ema.place",
    "ema.proposal",
    "ema.report",
    "ema.shapes",
    "ema.show",
    "ema.simulate",
    "ema.store",
    "ema.study",
    "ema.tables",
    "acquisition",
)
SNAPSHOT = Path(__file__).with_name("public_names.txt")


def test_public_names_are_those_of_the_snapshot():
    present = [f"{room}.{name}" for room in ROOMS for name in sorted(import_module(room).__all__)]
    if os.environ.get("EMA_WRITE_PUBLIC_NAMES"):
        SNAPSHOT.write_text("\n".join(present) + "\n", encoding="utf-8")
    promised = SNAPSHOT.read_text(encoding="utf-8").split()
    assert present == promised, "see the first lines of this test"


@pytest.mark.parametrize("room", ROOMS)
def test_every_public_name_is_listed_and_is_what_it_is_called(room):
    """Names are looked up when they are asked for: one that is not listed cannot be completed."""
    module = import_module(room)
    for name in module.__all__:
        public = getattr(module, name)
        assert name in dir(module)
        assert not (isclass(public) or isroutine(public)) or public.__name__ == name


def test_no_module_bears_the_name_of_a_public_verb():
    """Importing a module sets its name in its package: a function of that name would be gone."""
    for room in ROOMS:
        package = import_module(room)
        for module in pkgutil.iter_modules(package.__path__):
            if module.name in package.__all__:
                assert ismodule(getattr(package, module.name)), f"{room}.{module.name} is both a module and a function"
