"""An environment of its own for each peer, made on demand outside the checkout."""

import os
import subprocess
import sys
import venv
from pathlib import Path

PEERS = Path(__file__).parent / "peers"
NAMES = {
    "sdypy_ema": "sdypy-EMA",
    "pyfbs": "pyFBS",
    "pyyeti": "pyYeti (ERA)",
    "pyoma2": "pyOMA2",
    "pydvma": "pydvma",
    "opensees": "OpenSeesPy",
    "pyharm": "pyHarm",
}
CACHE = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser() / "friction-ema-bench"


def interpreter(peer: str, cache: Path = CACHE) -> Path:
    """The Python of the peer's environment; made, or made again, where its requirements are not the installed ones."""
    folder = cache / peer
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    wanted = (PEERS / peer / "requirements.txt").read_text()
    stamp = folder / "requirements.txt"
    if not (python.exists() and stamp.exists() and stamp.read_text() == wanted):
        print(f"making the environment of {NAMES[peer]} in {folder}", file=sys.stderr)
        venv.create(folder, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "-q", *wanted.split()], check=True)
        stamp.write_text(wanted)
    return python
