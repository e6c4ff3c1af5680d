"""Recipes as users run them: by the command in a process of its own, which also spares them the shape checker."""

import os
import subprocess
import sys
from pathlib import Path

from ema.data import StudyResult
from ema.store import load
from tests.unit.report_page import UNDRAWN


def run_recipe(recipe: Path, output: Path, datasets: Path | None = None, *, drawn: bool = True) -> StudyResult:
    """The stored result of ``ema run``; its status is 0 when every expected number and verdict is met.

    Of recipes whose report has the kinds of pictures of another one that is ``drawn``, a quarter of a second each, all is
    written but the pictures.
    """
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if datasets is not None:
        environment["EMA_DATASETS"] = str(datasets)
    words: list[str | Path] = ["run", recipe, "--output", output]
    return result_of(words, output / f"{recipe.stem}.h5", environment, drawn=drawn)


def result_of(
    words: list[str | Path],
    result: Path,
    environment: dict[str, str],
    said: str = "expected numbers met",
    cwd: Path = Path(),
    drawn: bool = True,
) -> StudyResult:
    """What the command has stored beside its report when it ended with status 0."""
    code = "import sys; sys.argv[0] = 'ema'; from ema.cli import main; main()"
    command = [sys.executable, *(["-m", "ema"] if drawn else ["-c", UNDRAWN + code]), *words]
    done = subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, timeout=1100)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "expected numbers met" in done.stdout and said in done.stdout
    assert result.with_suffix(".html").stat().st_size > 100_000
    return load(result)
