"""A real browser of the system, and the app as a process of its own."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from ema.cli.browsing import workbench

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
)
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The browser; tests skip without it."""
    playwright = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM:
        pytest.skip("no Chromium: apt-get install -y chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def master(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small campaign of four points with its result and a geometry; to be copied, not used."""
    import ema.report
    from tests.journeys.small_campaign import HAMMER, RUN, campaign

    folder = tmp_path_factory.mktemp("web") / "four points"
    nodes = "1 = [0, 0, 0]\n2 = [1, 0, 0]\n3 = [1, 1, 0]\n4 = [0, 1, 0]\n"
    geometry = f'\n[geometry]\nunit = "m"\nfaces = [[1, 2, 3, 4]]\n[geometry.nodes]\n{nodes}'
    campaign(folder, channels=HAMMER + geometry, run=RUN)
    (folder / "recipe.toml").write_text('campaign = "."\n[fit]\nband = [20, 300]\norders = [2, 20, 2]\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ema.report, "write", lambda result, path, **more: path, raising=False)
        workbench(folder / "recipe.toml")
    return folder


@dataclass
class Served:
    """`ema app` as a process of its own."""

    folder: Path
    process: Any = None
    address: str = ""
    requests: list[str] = field(default_factory=list)
    more: tuple[str, ...] = ()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                "from ema.cli import main; main()",
                "app",
                str(self.folder / "recipe.toml"),
                "--port",
                "0",
                "--no-open",
                *self.more,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
        )
        line = self.process.stdout.readline()
        found = re.match(r"Open (\S+)", line)
        assert found, line + self.process.stdout.read()
        self.address = found[1]

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(30)


@pytest.fixture
def served(master: Path, tmp_path: Path) -> Iterator[Served]:
    folder = tmp_path / "four points"
    shutil.copytree(master, folder)
    app = Served(folder)
    app.start()
    yield app
    app.kill()


@dataclass
class Window:
    """One window, and everything that it asked for or complained about."""

    page: Any
    told: list[str]
    asked: list[str]

    def revision(self) -> int:
        return int(self.page.get_attribute("body", "data-revision"))

    def waits(self, revision: int) -> None:
        self.page.wait_for_selector(f"body[data-revision='{revision}']", timeout=30000)

    def modes(self) -> list[int]:
        cells = self.page.locator("#modes tbody td:nth-child(2)").all_text_contents()
        return [round(float(cell)) for cell in cells]

    def error(self) -> str:
        return self.page.inner_text("#what") if self.page.is_visible("#error") else ""

    def eventually(self, fact: Any, seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not fact():
            assert time.monotonic() < end, f"{self.error()} {self.told}"
            self.page.wait_for_timeout(50)


@pytest.fixture
def window(chromium: Any) -> Iterator[Any]:
    """Opens windows."""
    context = chromium.new_context(viewport={"width": 1400, "height": 1500}, accept_downloads=True)

    def opened(address: str) -> Window:
        page = context.new_page()
        one = Window(page, [], [])
        page.on("console", lambda message: one.told.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: one.told.append(str(error)))
        page.on("request", lambda request: one.asked.append(request.url))
        page.goto(address)
        page.wait_for_selector("body[data-revision]", timeout=60000)
        return one

    yield opened
    context.close()
