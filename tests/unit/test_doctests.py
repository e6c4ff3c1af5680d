"""Every example in a docstring runs and shows what it says, in a process as users have it, without shape checking."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROBE = """
import doctest, importlib, json, sys
flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
print(json.dumps({name: doctest.testmod(importlib.import_module(name), optionflags=flags) for name in sys.argv[1:]}))
"""


def test_examples_run(tmp_path: Path) -> None:
    modules = sorted(
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in ("ema", "acquisition")
        for path in (ROOT / package).rglob("*.py")
        if ">>>" in path.read_text(encoding="utf-8")
    )
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *modules],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout.splitlines()[-1])
    assert set(results) == set(modules) and len(modules) >= 8
    wrong = {name: counts for name, counts in results.items() if counts[0] or not counts[1]}
    assert not wrong, done.stdout
