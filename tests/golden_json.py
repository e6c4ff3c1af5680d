"""What scripts read is a promise: a key that ``--json`` of a command once printed stays, with its kind of value.

``unit/golden/json_v1.json`` lists the keys of the first version. Run the tests with ``EMA_WRITE_GOLDEN=1`` to add keys
that are new; none is ever taken away.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

RECORD = Path(__file__).parent / "unit" / "golden" / "json_v1.json"
KINDS = {dict: "table", list: "list", str: "text", bool: "truth", int: "number", float: "number", type(None): "nothing"}


def paths(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Every key of a document with its kind; items of a list share the path of their list."""
    yield path, KINDS[type(value)]
    if isinstance(value, dict):
        for key, item in value.items():
            yield from paths(item, f"{path}.{key}")
    elif isinstance(value, list):
        for item in value:
            yield from paths(item, f"{path}[]")


def assert_keys(command: str, document: Any) -> None:
    """Every recorded key is there, with a kind of value that it had before or ``null``."""
    present: dict[str, set[str]] = {}
    for path, kind in paths(document):
        present.setdefault(path, set()).add(kind)
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    known = record.get(command, {})
    if os.environ.get("EMA_WRITE_GOLDEN"):
        merged = {path: sorted(present.get(path, set()) | set(known.get(path, ()))) for path in {*present, *known}}
        RECORD.write_text(
            json.dumps(dict(sorted((record | {command: merged}).items())), indent=1, sort_keys=True) + "\n"
        )
        known = merged
    assert known, f"nothing is recorded of {command}: see the first lines of {Path(__file__).name}"
    lost = sorted(set(known) - set(present))
    assert not lost, f"{command} --json has lost keys"
    for path, kinds in known.items():
        assert present[path] <= {*kinds, "nothing"} or kinds == ["nothing"], f"{command} --json: {path}"
