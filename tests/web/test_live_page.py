"""The page of `ema record --demo` in a real Chromium: every take is shown as it is kept."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema import store


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[tuple[Any, str, Path]]:
    folder = tmp_path / "a <b>table</b>"
    command = ["record", str(folder), "--demo", "--no-open", "--port", "0", "--takes", "6"]
    process = subprocess.Popen(
        [sys.executable, "-c", "from ema.cli import main; main()", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    said = process.stdout.readline() + process.stdout.readline()
    found = re.search(r"Open (\S+)", said)
    assert found, said + process.stdout.read()
    yield process, found[1], folder
    process.kill()
    process.wait(30)


def curve(one: Any, plot: str, number: int = 0) -> np.ndarray:
    data = one.page.evaluate(
        "([plot, number]) => { const found = document.getElementById(plot).data[number]; return [found.x, found.y]; }",
        [plot, number],
    )
    return np.array(data, dtype=float)


def test_a_session_is_followed_take_by_take(recording: tuple[Any, str, Path], window: Any) -> None:
    process, address, folder = recording
    one = window(address)
    one.eventually(lambda: (one.page.get_attribute("body", "data-revision") or "") >= "3", 60)
    assert one.page.inner_text("#title") == f"run in {folder}"
    one.waits(6)
    assert process.wait(60) == 0
    # takes 1 to 3 are of point 1, takes 4 to 6 of point 5
    assert one.page.inner_text("#verdict").startswith("Point 5, take 3: accepted. Peak ")
    assert "F_N J1 1020" in one.page.inner_text("#verdict")
    assert one.page.inner_text("#asked").startswith("Strike point 34 (7 of 15")
    record = store.load(folder / "raw" / "run_5_003.h5")
    force = record.signals[0]
    time, shown = curve(one, "force")
    assert shown.max() == pytest.approx(force.max(), rel=1e-4) and time[np.argmax(shown)] == 0
    # the spectrum of the force by its own sum over time
    lines, decibels = curve(one, "spectrum")
    row = int(np.argmin(np.abs(lines - 500)))
    turns = np.exp(-2j * np.pi * np.outer([0.0, lines[row]], np.arange(len(force)) / record.sampling_rate))
    constant, there = np.abs(turns @ force)
    assert decibels[row] == pytest.approx(20 * np.log10(there / constant), abs=0.2)
    frequency, coherence = curve(one, "frf", 2)
    assert frequency[-1] == pytest.approx(record.sampling_rate / 2, rel=0.01) and np.nanmedian(coherence) > 0.9
    peaks = curve(one, "peaks")
    assert peaks.shape == (2, 6) and peaks[1, -1] == pytest.approx(force.max(), rel=1e-4)
    one.eventually(lambda: one.error().startswith("The measurement has ended"))
    assert one.page.inner_text("#verdict").startswith("Point 5, take 3")  # what is shown stays


def test_a_page_only_follows(recording: tuple[Any, str, Path], window: Any) -> None:
    _, address, _ = recording
    one = window(address)
    for path, method, status in (("api/drop", "POST", 400), ("api/poles", "GET", 400), ("export?kind=csv", "GET", 400)):
        answer = one.page.request.fetch(address + path, method=method, headers={"X-Ema": "1"}, data="{}")
        assert answer.status == status and "there is no such" in answer.json()["error"]
