"""The public names are a promise: none comes or goes unnoticed.

Run with ``EMA_WRITE_PUBLIC_NAMES=1`` to write ``public_names.txt`` anew, and read the difference before committing it.
"""

import os
from importlib import import_module
from pathlib import Path

ROOMS = (
    "ema", "ema.data", "ema.estimate", "ema.fit", "ema.report", "ema.shapes", "ema.show", "ema.simulate", "ema.store",
    "ema.study", "acquisition",
)  # fmt: skip
SNAPSHOT = Path(__file__).with_name("public_names.txt")


def test_public_names_are_those_of_the_snapshot():
    present = [f"{room}.{name}" for room in ROOMS for name in sorted(import_module(room).__all__)]
    if os.environ.get("EMA_WRITE_PUBLIC_NAMES"):
        SNAPSHOT.write_text("\n".join(present) + "\n", encoding="utf-8")
    promised = SNAPSHOT.read_text(encoding="utf-8").split()
    assert present == promised, "see the first lines of this test"


def test_every_public_name_can_be_had():
    for room in ROOMS:
        module = import_module(room)
        for name in module.__all__:
            assert getattr(module, name) is not None
