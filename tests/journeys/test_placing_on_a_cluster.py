"""`ema place` on a Dask cluster as its users start one: a scheduler and two workers, one of which dies on the way."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from ema import store
from tests.unit.placement_rig import RECIPE, write_recipe

pytest.importorskip("distributed")
pytestmark = pytest.mark.slow

PATIENCE = 540.0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _started(stack: ExitStack, folder: Path, name: str, *arguments: str) -> subprocess.Popen:
    """A command of Dask in a group of its own, ended with the test whatever happens."""
    log = stack.enter_context((folder / f"{name}.log").open("wb"))
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        stdout=log,
        stderr=log,
        cwd=folder,
        start_new_session=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )

    def end() -> None:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(timeout=30)

    stack.callback(end)
    return process


def _wait(what: str, done, until: float) -> None:
    while not done():
        assert time.monotonic() < until, f"waited too long for {what}"
        time.sleep(0.2)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.mark.timeout(900)
def test_a_killed_worker_changes_nothing(tmp_path):
    until = time.monotonic() + PATIENCE
    recipe = write_recipe(tmp_path, RECIPE.replace("shortlist = 3", "shortlist = 8"))
    port, out = _free_port(), tmp_path / "out"
    address = f"tcp://127.0.0.1:{port}"
    with ExitStack() as stack:
        _started(
            stack, tmp_path, "scheduler", "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"
        )
        _wait("the scheduler", lambda: _listens(port), until)
        workers = [
            _started(
                stack,
                tmp_path,
                f"worker{number}",
                "worker",
                address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--local-directory",
                str(tmp_path / f"space{number}"),
            )
            for number in (1, 2)
        ]
        command = subprocess.Popen(
            [
                sys.executable,
                "-c",
                "from ema.cli import main; main()",
                "place",
                str(recipe),
                "--output",
                str(out),
                "--cluster",
                address,
                "--json",
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            start_new_session=True,
        )
        stack.callback(lambda: command.poll() is None and command.kill())
        # the first finished places show that the work is under way
        _wait(
            "the first places",
            lambda: len(list((out / "checked").glob("*.npy"))) >= 2 or command.poll() is not None,
            until,
        )
        os.killpg(workers[0].pid, signal.SIGKILL)
        printed, wrong = command.communicate(timeout=max(until - time.monotonic(), 1))
    assert command.returncode == 0, wrong
    told = json.loads(printed)
    found = store.load(out / "placement.h5")
    assert told["checked"] == len(found.ranking.shortlist) == len(list((out / "checked").glob("*.npy")))
    alone = subprocess.run(
        [
            sys.executable,
            "-c",
            "from ema.cli import main; main()",
            "place",
            str(recipe),
            "--output",
            str(tmp_path / "alone"),
            "--json",
        ],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        cwd=tmp_path,
    )
    assert alone.returncode == 0, alone.stderr
    assert json.loads(alone.stdout)["places"] == told["places"]
