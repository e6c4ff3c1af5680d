"""Shapes as types are checked in every test run; a tool that is missing in CI is a failure, not a skip."""

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jaxtyping
import pytest
import scipy.linalg  # noqa: F401 (loads linear algebra, so that its threads can be limited)
from filelock import FileLock
from hypothesis import settings
from threadpoolctl import threadpool_limits

from ema.fingerprint import compiled_modules
from tests.checked_types import checked, next_test

ROOT = Path(__file__).resolve().parent.parent

# Compiled modules are kept, whatever the environment says: without them every process of the tests compiles all of them.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# One thread: several test processes share the cores, and idle threads of linear algebra would take them from each other.
threadpool_limits(1, user_api="blas")

# The same examples in every run, and no bound on the clock.
settings.register_profile("suite", derandomize=True, deadline=None)
settings.load_profile("suite")


def _checked_modules() -> list[str]:
    """All modules but the compiled kernels, whose cached compilation the checker would break."""
    modules, compiled = [], compiled_modules(ROOT / "ema")
    for package in ("ema", "acquisition"):
        for path in (ROOT / package).rglob("*.py"):
            if path not in compiled and path.name != "__init__.py":
                modules.append(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return modules


# the hook puts `@jaxtyping.jaxtyped(typechecker=...)` above every function and class
jaxtyping.jaxtyped = lambda **unused: checked
jaxtyping.install_import_hook(_checked_modules(), None)


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def datasets() -> Path:
    """The folder of real measurements; tests that need it are skipped where it is absent."""
    from acquisition.datasets import dataset_folder

    folder = (ROOT / dataset_folder()).resolve()
    if not folder.is_dir():
        pytest.skip(f"no real measurements: {folder} is absent (set EMA_DATASETS)")
    return folder


@pytest.fixture(scope="session")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Folder of a built-in campaign by its name, to be read: its signals are written by the first test of the session that
    asks for them, in a process that the shape checker does not slow down, while the other processes wait.
    """
    from ema.datasets.builtin import is_generated

    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def written(name: str) -> Path:
        folder = ROOT / "datasets" / name
        task = f"from pathlib import Path; from ema.datasets.builtin import ensure; ensure(Path({str(folder)!r}), {name!r})"
        with FileLock(shared / f"{name}.lock"):
            if not is_generated(folder):
                subprocess.run([sys.executable, "-c", task], cwd=ROOT, check=True)
        return folder

    return written


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports are drawn elsewhere: here a blank page will do."""
    import ema.report

    monkeypatch.setattr(
        ema.report,
        "write",
        lambda result, path, **more: Path(path).write_text("blank"),
        raising=False,
    )


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of reports and commands are made and not rendered, for tests that read words and numbers."""
    from tests.unit.report_page import BLANK, blank

    monkeypatch.setattr("ema.report.pictures.drawn", blank)
    monkeypatch.setattr("ema.report.pictures.as_svg", lambda figure: b"<svg/>")
    monkeypatch.setattr("ema.report.pictures.as_png", lambda figure: BLANK.content)


@pytest.fixture
def unfitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """`ema check` without the fit by which it looks for late channels, for tests of what else it says."""
    monkeypatch.setattr("ema.cli.checking.QUICK", 0)


def _of_everything(config: pytest.Config) -> bool:
    """Whether no files were named: the command of the README."""
    return config.args_source is not pytest.Config.ArgsSource.ARGS


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """A process for each core where everything is run, and no further process where files are named."""
    return (os.cpu_count() or 1) if _of_everything(config) else 0


def pytest_configure(config: pytest.Config) -> None:
    """A run that names neither files nor markers leaves out the slow tests, which ``.ci/run`` runs by themselves."""
    if _of_everything(config) and not config.option.markexpr:
        config.option.markexpr = "not slow"


def pytest_report_header(config: pytest.Config) -> str | None:
    """What is left out."""
    return "left out: tests marked slow (`-m slow` runs them)" if config.option.markexpr == "not slow" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests or a bound on time of their own first, then the other comparisons with truth, and the many of
    `tests/unit` last: the files that several processes end with are short, and none waits long for another.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow") or item.get_closest_marker("timeout")}

    def place(item: pytest.Item) -> tuple[bool, bool, bool]:
        return item.path not in slow, "validation" not in item.path.parts, "unit" in item.path.parts

    items.sort(key=place)


def pytest_collection_finish() -> None:
    """What is loaded by now stays to the end: looking through it for garbage, again and again, took a seventh of the time
    of tests that make many objects (15 % of those of reports and placements, now 7 %).
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 10, 10)


def pytest_runtest_setup() -> None:
    """The first calls of every function are checked in each test."""
    next_test()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo):  # type: ignore[no-untyped-def]
    """With CI=true a test skipped because something is missing fails."""
    outcome = yield
    report = outcome.get_result()
    if os.environ.get("CI") == "true" and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {report.longrepr}"
