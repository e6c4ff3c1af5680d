"""Recipes as users run them: by the command in a process of its own, which also spares them the shape checker."""

import os
import subprocess
import sys
from pathlib import Path

from ema.data import StudyResult
from ema.store import load


def run_recipe(recipe: Path, output: Path, datasets: Path | None = None) -> StudyResult:
    """The stored result of ``ema run``; its status is 0 when every expected number and verdict is met."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if datasets is not None:
        environment["EMA_DATASETS"] = str(datasets)
    return result_of(["run", recipe, "--output", output], output / f"{recipe.stem}.h5", environment)


def result_of(
    words: list[str | Path],
    result: Path,
    environment: dict[str, str],
    said: str = "expected numbers met",
    cwd: Path = Path(),
) -> StudyResult:
    """What the command has stored beside its report when it ended with status 0."""
    command = [sys.executable, "-m", "ema", *words]
    done = subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, timeout=1100)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "expected numbers met" in done.stdout and said in done.stdout
    assert result.with_suffix(".html").stat().st_size > 100_000
    return load(result)
