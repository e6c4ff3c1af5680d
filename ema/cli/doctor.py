"""What works on this machine, tried out rather than guessed."""

import os
import platform
import re
import shutil
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import ema
from ema.progress import Progress, advance

_PACKAGES = ("numpy", "scipy", "pandas", "h5py", "matplotlib", "pyvista", "numba", "pydantic", "pint", "pyuff")
_ROOM = 2**30
_GRAPHICS = "libegl1 libgl1-mesa-dri libxrender1"


@dataclass(frozen=True)
class Check:
    """One thing tried: whether it works, whether the main job needs it, and what would mend it."""

    what: str
    works: bool
    detail: str
    needed: bool = True
    remedy: str = ""


def examine(progress: Progress) -> list[Check]:
    """Try everything."""
    steps = (_python, _packages, _store, _space, _formats, _renderer, _datasets)
    checks: list[Check] = []
    for number, step in enumerate(steps):
        advance(progress, "examining", number, len(steps))
        checks += step()
    advance(progress, "examining", len(steps), len(steps))
    return checks


def repair(checks: list[Check]) -> str:
    """The one command that mends what does not work; empty where there is nothing to mend by a command."""
    return " && ".join(dict.fromkeys(one.remedy for one in checks if not one.works and one.remedy))


def _pip(packages: tuple[str, ...]) -> str:
    """The command that installs our requirements of these packages."""
    stated = {re.split(r"[^\w.-]", text, maxsplit=1)[0].lower(): text.split(";")[0] for text in _requirements()}
    wanted = [stated.get(package.lower(), package).strip().replace(" ", "") for package in packages]
    return " ".join([f'"{sys.executable}" -m pip install', *(f'"{each}"' for each in wanted)])


def _requirements() -> list[str]:
    try:
        return requires("friction-ema") or []
    except PackageNotFoundError:
        return []


def _python() -> list[Check]:
    return [
        Check("friction-ema", True, f"{ema.__version__} in {Path(ema.__file__).parent}"),
        Check("Python", sys.version_info >= (3, 11), f"{platform.python_version()} on {platform.platform()}"),
        Check("processors", True, str(os.cpu_count())),
    ]


def _packages() -> list[Check]:
    checks = []
    for name in _PACKAGES:
        try:
            checks.append(Check(name, True, version(name)))
        except PackageNotFoundError:
            checks.append(Check(name, False, "not installed", remedy=_pip((name,))))
    return checks


def _store() -> list[Check]:
    """Write and read back a result, as every study does."""
    import numpy as np

    from ema import store
    from ema.data import Geometry

    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "probe.h5"
            store.save(path, Geometry(np.arange(2), np.zeros((2, 3))))
            store.load(path)
    except Exception as error:
        return [Check("result files", False, f"cannot be written and read back: {error}")]
    return [Check("result files", True, "written and read back")]


def _space() -> list[Check]:
    free = shutil.disk_usage(Path.cwd()).free
    return [Check("free space here", free > _ROOM, f"{free / 2**30:.1f} GB", needed=False)]


def _formats() -> list[Check]:
    import acquisition

    checks = []
    for one in acquisition.formats():
        detail = " ".join(one.suffixes) if one.available else f"needs the extra [{one.extra}]"
        remedy = _pip(one.packages) if one.packages else ""
        checks.append(Check(f"format {one.name}", one.available, detail, False, remedy))
    return checks


def _renderer() -> list[Check]:
    """VTK kills the process where it cannot draw, so it is tried in another one."""
    from ema.show.renderer import renderer_works

    works = renderer_works()
    detail = "draws off screen" if works else "VTK cannot draw off screen; reports use matplotlib instead"
    linux = sys.platform.startswith("linux") and shutil.which("apt-get")
    return [Check("renderer", works, detail, False, f"sudo apt-get install -y {_GRAPHICS}" if linux else "")]


def _datasets() -> list[Check]:
    from acquisition.datasets import dataset_folder

    folder = dataset_folder()
    found = folder.is_dir()
    detail = str(folder) if found else f"{folder} is absent; tests on real measurements need EMA_DATASETS"
    return [Check("reference measurements", found, detail, needed=False)]
