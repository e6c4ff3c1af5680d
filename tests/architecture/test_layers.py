"""The floors of the house: a floor imports only lower ones."""

import os
import subprocess
import sys
from pathlib import Path


def test_no_room_imports_a_higher_floor_or_its_neighbour(root):
    command = Path(sys.executable).parent / ("lint-imports.exe" if os.name == "nt" else "lint-imports")
    done = subprocess.run([command, "--no-cache"], cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " 0 broken" in done.stdout
