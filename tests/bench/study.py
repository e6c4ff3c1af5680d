"""How long the study of the README takes, stage by stage: ``python -m tests.bench.study``.

The whole of ``reports/table_placement.toml``, raw signals to report, with as many processes for the places as there are
cores. Stages are those that the progress bar shows; what was computed before one is announced counts to it.
"""

import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from ema.study import Study
from tests.bench.provenance import stamp

ROOT = Path(__file__).resolve().parents[2]
RESULT = Path(__file__).with_name("results") / "study.json"
_KINDS = (
    ("measuring the virtual table", "signals of the virtual table (once)"),
    ("places", "all places by the predictor"),
    ("all modes together", "shortlist with all modes"),
    ("intervals", "intervals of the best places"),
    ("bands of the forecast", "forecast with bands"),
    ("control study", "controlled normal force"),
    ("runs of", "maps of the placed beam"),
    ("saving", "result and report"),
    ("writing", "result and report"),
)


class Stages:
    """A progress callback that books the time since the last call on what is told."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}
        self._last = time.perf_counter()

    def __call__(self, what: str, done: int, total: int) -> None:
        now = time.perf_counter()
        kind = next((name for start, name in _KINDS if what.startswith(start)), "hammer test to modes")
        self.spent[kind] = self.spent.get(kind, 0.0) + now - self._last
        self._last = now


def main() -> None:
    """Run it, print a line per stage, keep the figures."""
    stages, start = Stages(), time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool,
    ):
        result = Study.load(ROOT / "reports" / "table_placement.toml", folder).run(progress=stages, executor=pool)
    total = time.perf_counter() - start
    assert result.forecast_check is not None
    found = {
        **stamp("tests.bench.study"),
        "seconds": total,
        "stages": stages.spent,
        "inside": result.forecast_check.inside,
        "values": result.forecast_check.values,
        "met": all(one.met for one in result.expectations),
    }
    for stage, seconds in sorted(stages.spent.items(), key=lambda item: -item[1]):
        print(f"{stage:40s} {seconds:6.1f} s {seconds / total:6.0%}")
    print(f"{'all':40s} {total:6.1f} s; {found['inside']} of {found['values']} values inside their bands")
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def section(found: dict) -> str:
    """The figures as a section of the page on speed."""
    machine = found["machine"]
    lines = [
        f"| {stage} | {seconds:.1f} | {seconds / found['seconds']:.0%} |"
        for stage, seconds in sorted(found["stages"].items(), key=lambda item: -item[1])
    ]
    return "\n".join(
        [
            "## The study of the README",
            "",
            f"From raw hammer signals to the report of a placed beam, measured against its forecast ({found['inside']} of "
            f"{found['values']} values inside their bands): {found['seconds']:.0f} s of wall clock on {machine['cores']} cores "
            f"({machine['processor']}). From `python -m tests.bench.study`.",
            "",
            "| stage | wall clock [s] | share |",
            "| --- | --- | --- |",
            *lines,
        ]
    )


if __name__ == "__main__":
    main()
