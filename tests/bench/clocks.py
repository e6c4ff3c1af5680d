"""What a user waits for, in processor time: ``python -m pytest tests/bench/clocks.py``.

No other run collects this file: how long a machine takes is no property of the code, and a busy one would fail for no
fault. The bounds hold on an idle machine of one core; :func:`slowness` carries them over to slower ones. Types and shapes
are checked while they are measured, as in all tests; without that the same work takes about half as long.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import acquisition
from ema.app import Workbench
from ema.app.places import place_view, placement_view
from ema.app.views import frf, matrix, motion, overview, poles
from ema.fit import stabilise
from ema.simulate import Masing, double_beam, snapback
from tests.bench.simulate import FIRST_CALLS, first_call
from tests.formats import test_uff_large as universal_files
from tests.unit.report_corpus import plate, run_result, study
from tests.unit.test_app_state import workbench_of_a_plate
from tests.unit.test_friction_rig import table_under_a_roving_hammer
from tests.validation.test_placement import maps_of_scenario_b

USUAL = 0.088
"""Processor time in s of :func:`work` on the machine that the bounds were taken on, when it had nothing else to do."""


def work() -> float:
    """Processor time in s of a mixture of interpreted and of linear-algebra work."""
    start = time.process_time()
    rng = np.random.default_rng(0)
    table: dict[int, float] = {}
    for number in range(200_000):
        table[number % 1000] = table.get(number % 1000, 0.0) + 0.5 * number
    for _ in range(4):
        np.linalg.eigvals(rng.normal(size=(120, 120)))
    return time.process_time() - start


def slowness() -> float:
    """How many times longer than usual this machine takes at this moment (never below 1)."""
    return max(1.0, min(work() for _ in range(3)) / USUAL)


def processor_time(action: Callable[[], Any], *, before: Callable[[], Any] = lambda: None, repeats: int = 3) -> float:
    """Processor time in s of ``action``, the best of ``repeats``; ``before`` each of them something that does not count."""
    times = []
    for _ in range(repeats):
        before()
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return min(times)


@pytest.mark.parametrize("name", FIRST_CALLS)
def test_a_first_call_that_compiles_its_kernels_takes_less_than_20_s(name: str) -> None:
    assert first_call(FIRST_CALLS[name]) <= 20.0 * slowness()


@pytest.mark.parametrize(("force", "seconds"), [(1000.0, 0.3), (4000.0, 0.3), (8000.0, 0.2)])
def test_a_simulated_second_of_the_double_beam(force: float, seconds: float) -> None:
    """The fast mode at its default error of a thousandth."""
    model, tip = double_beam(Masing(0.3, 1e9), force), "beam 2:20:+Z"
    snapback(model, 20.0, tip, 0.01)  # compiles
    assert processor_time(lambda: snapback(model, 20.0, tip, 1.0)) <= seconds * slowness()


def test_a_simulated_roving_hammer_over_80_points_takes_less_than_two_minutes() -> None:
    rig = table_under_a_roving_hammer()
    rig.take(0)  # compiles
    assert 80 * processor_time(lambda: rig.take(1), repeats=1) < 120 * slowness()


def test_a_placement_on_the_full_grid_takes_less_than_a_minute() -> None:
    """Two modes, 8 exciting and 12 normal forces."""
    assert processor_time(maps_of_scenario_b, repeats=1) <= 60 * slowness()


def test_a_picked_mode_follows_within_a_second_on_160_frfs(tmp_path: Path) -> None:
    """A pick with all that the page draws again, on two accelerometers and 80 points."""
    geometry = plate(10, 8)
    run = run_result("table", geometry, 8, lines=2001)
    run = replace(run, poles=stabilise(run.frfs, orders=range(4, 41, 2)))
    bench = Workbench(study((run,), geometry), tmp_path / "never_written.h5")
    bench.drop(0)

    def drop() -> None:
        bench.drop(0)
        poles(bench), motion(bench), matrix(bench), frf(bench, 0, 0), overview(bench)

    assert processor_time(drop, before=bench.undo) < 1.0 * slowness()


def test_the_page_of_5000_points_and_3000_candidates_takes_less_than_2_s() -> None:
    def views(bench: Workbench, candidate: int) -> None:
        motion(bench), placement_view(bench, 0), place_view(bench, 0, candidate)

    views(workbench_of_a_plate(5, 4, candidates=4), 3)  # imports
    bench = workbench_of_a_plate(100, 50, candidates=1000)
    assert processor_time(lambda: views(bench, 1500), repeats=2) < 2.0 * slowness()


@pytest.mark.parametrize(
    "make",
    [
        universal_files.ten_thousand_channels,
        universal_files.fifty_thousand_records,
        lambda folder: universal_files.campaign_of_two_thousand_files(folder, np.zeros((2000, 2, 256))),
    ],
    ids=["10 000 channels", "50 000 records", "2000 files"],
)
def test_universal_files_of_many_data_sets_are_read_in_less_than_10_s(make: Any, tmp_path: Path) -> None:
    assert universal_files.first_values(make(tmp_path))[1] < 10.0 * slowness()


@pytest.mark.parametrize("decimal", [".", ","])
def test_a_table_of_51_201_lines_is_read_in_less_than_half_a_second(decimal: str, tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(51201, 3))
    values[:, 0] = np.arange(51201) / 8
    rows = "\n".join(";".join(f"{x:.9e}" for x in row) for row in values)
    path = tmp_path / "long.csv"
    path.write_text(("frequency;real;imaginary\n" + rows + "\n").replace(".", decimal))
    columns = {"frequency": "frequency", "real": "real", "imaginary": "imaginary", "unit": "unstated"}
    assert processor_time(lambda: acquisition.read(path, **columns)) < 0.5 * slowness()
