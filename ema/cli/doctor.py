"""What works on this machine, tried out rather than guessed."""

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import ema
from ema.progress import Progress, advance

_PACKAGES = ("numpy", "scipy", "pandas", "h5py", "matplotlib", "numba", "pydantic", "pint")
_ROOM = 2**30
_GRAPHICS = "libegl1 libgl1-mesa-dri libxrender1"
_TYPESETTING = "libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0"


@dataclass(frozen=True)
class Check:
    """One thing tried: whether it works, whether the main job needs it, and what would fix it."""

    what: str
    works: bool
    detail: str
    needed: bool = True
    remedy: str = ""


def examine(progress: Progress) -> list[Check]:
    """Try everything."""
    steps = (_python, _packages, _store, _space, _formats, _reports, _app, _daq, _renderer, _datasets)
    checks: list[Check] = []
    for number, step in enumerate(steps):
        advance(progress, "examining", number, len(steps))
        checks += step()
    advance(progress, "examining", len(steps), len(steps))
    return checks


def repair(checks: list[Check]) -> str:
    """The one command that fixes what does not work; empty where there is nothing to fix by a command."""
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


def _extra(what: str, package: str, does: str) -> Check:
    """Whether an optional package is there."""
    try:
        return Check(what, True, f"{does}, by {package} {version(package)}", needed=False)
    except PackageNotFoundError:
        return Check(what, False, f"needs {package}", False, _pip((package,)))


def _reports() -> list[Check]:
    """Set a line of text as PDF: WeasyPrint is of no use without the Pango library."""
    from ema.errors import EmaError
    from ema.report.pdf import pdf

    check = _extra("report as PDF", "weasyprint", "written")
    if check.works:
        try:
            pdf("<p>Text</p>")
        except EmaError as error:
            fix = f"sudo apt-get install -y {_TYPESETTING}" if _debian() else ""
            check = Check("report as PDF", False, str(error.what), False, fix)
    return [
        Check("report as HTML", True, "written by what every installation has"),
        check,
        _extra("report as Word file", "python-docx", "written"),
    ]


def _app() -> list[Check]:
    """The page needs plotly to serve; a browser may be on another machine."""
    names = ("chromium", "chromium-browser", "google-chrome", "firefox", "msedge", "open")
    browser = next((found for name in names if (found := shutil.which(name))), "")
    fix = "sudo apt-get install -y chromium" if _debian() else ""
    return [
        _extra("ema app", "plotly", "served"),
        Check(
            "browser",
            bool(browser),
            browser or "none found here; the page can be opened from elsewhere with --host",
            False,
            fix,
        ),
    ]


def _daq() -> list[Check]:
    """The devices that openDAQ finds, asked in a process of its own: drivers may fail in any way."""
    check = _extra("ema record", "opendaq", "measures")
    if not check.works:
        return [check]
    probe = "import opendaq; print(', '.join(d.connection_string for d in opendaq.Instance().available_devices))"
    try:
        done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return [check, Check("devices", False, "openDAQ does not answer", needed=False)]
    lines = done.stdout.strip().splitlines()
    devices = lines[-1] if done.returncode == 0 and lines else ""
    return [check, Check("devices", bool(devices), devices or "openDAQ finds none", needed=False)]


def _debian() -> bool:
    return sys.platform.startswith("linux") and shutil.which("apt-get") is not None


def _renderer() -> list[Check]:
    """VTK kills the process where it cannot draw, so it is tried in another one."""
    from ema.show.renderer import renderer_works

    check = _extra("pictures by VTK", "pyvista", "drawn")
    if not check.works:
        return [check]
    works = renderer_works()
    detail = "draws off screen" if works else "VTK cannot draw off screen; reports use matplotlib instead"
    remedy = f"sudo apt-get install -y {_GRAPHICS}" if _debian() else ""
    return [check, Check("renderer", works, detail, False, remedy)]


def _datasets() -> list[Check]:
    from acquisition import dataset_folder

    folder = dataset_folder()
    exists = folder.is_dir()
    detail = str(folder) if exists else f"{folder} is absent; tests on real measurements need EMA_DATASETS"
    return [Check("reference measurements", exists, detail, needed=False)]
