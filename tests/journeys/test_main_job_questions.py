"""Questions to the report of the main job, answered from its page alone and held against the data.

The page is read as by a person: sentences of the first screen, and tables found by their titles of columns. Data are the
arrays of the stored result and the table that was mounted; neither makes sentences.
"""

import hashlib
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from ema import store
from ema.data import StudyResult
from ema.datasets import fetch_recipe, work_table
from tests.unit.report_page import Page

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, StudyResult]:
    folder = tmp_path_factory.mktemp("main_job")
    recipe = fetch_recipe("table_placement", folder / "home")
    finished = ROOT / "reports" / "_build" / "table_placement"
    if finished.is_dir():  # used again, which it is for equal inputs, code and packages
        shutil.copytree(finished, folder / "work" / "table_placement")
    # in a process of its own, as a user does it and without the checks of shapes, which cost more than the work itself
    command = [sys.executable, "-m", "ema", "run", "--resume", "--output", folder / "work", recipe]
    subprocess.run(list(map(str, command)), check=True)
    return Page(folder / "work" / "table_placement.html"), store.load(folder / "work" / "table_placement.h5")


def answer(page: Page, pattern: str) -> list[str]:
    """What a sentence of the page says in the groups of a pattern."""
    match = re.search(pattern, page.words())
    assert match, f"no sentence of the page answers {pattern}"
    return list(match.groups())


def numbers(page: Page, pattern: str) -> list[float]:
    return [float(one) for one in answer(page, pattern)]


def digits(shown: float | str, truth: float) -> None:
    """A number as printed is the true one to its last digit."""
    text = str(shown)
    last = 10.0 ** -len(text.partition(".")[2])
    assert abs(float(text) - truth) <= 0.51 * last, f"the page says {shown}, the data {truth:.8g}"


def row(page: Page, columns: tuple[str, ...], **wanted: str) -> dict[str, str]:
    """The row of a table with these columns in which those of ``wanted`` say so."""
    rows = [one for one in page.table(*columns) if all(one[name] == value for name, value in wanted.items())]
    assert len(rows) == 1
    return rows[0]


FORECAST = ("F_N [N]", "F_E [N]", "measured", "inside")
LEAST = ("Least ζ [%]", "By mass [Hz]")
PLACES = ("Rank", "Objective [%]")


def which_beam_goes_where(page: Page, result: StudyResult) -> None:
    beam, *ends = answer(page, r"Bolt (.+?) at \(([\d.]+), ([\d.]+)\) m and \(([\d.]+), ([\d.]+)\) m and press")
    x1, y1, x2, y2 = map(float, ends)
    forecast, mounted = result.placement.forecast, work_table.PLACED
    assert beam == forecast.beam
    assert ((x1 + x2) / 2, (y1 + y2) / 2) == pytest.approx(forecast.centre, abs=1e-3)
    assert ((x1 + x2) / 2, (y1 + y2) / 2) == pytest.approx(mounted.middle, abs=1e-3)
    assert np.hypot(x2 - x1, y2 - y1) == pytest.approx(mounted.spacing, abs=1e-3)


def how_hard_is_it_pressed(page: Page, result: StudyResult) -> None:
    assert numbers(page, r"press every joint with ([\d.]+) N")[0] == result.placement.ranking.best.normal_force


def at_which_modes_does_it_aim(page: Page, result: StudyResult) -> None:
    modes = re.findall(r"Mode (\d+): [\d.]+ -> at least", page.words())
    assert tuple(map(int, modes)) == result.placement.forecast.modes


def how_much_damping_is_there_without_it(page: Page, _: StudyResult) -> None:
    for mode in (1, 3):
        shown = answer(page, rf"Mode {mode}: ([\d.]+) -> at least")[0]
        digits(shown, 100 * work_table.PLACED.host_damping[mode - 1])


def how_much_at_least_with_it(page: Page, result: StudyResult) -> None:
    for mode, values in zip((1, 3), result.placement.forecast.damping[:, :, 1]):
        digits(answer(page, rf"Mode {mode}: [\d.]+ -> at least ([\d.]+)")[0], 100 * values.min())
        assert row(page, LEAST, Mode=str(mode))["Least ζ [%]"] == f"{100 * values.min():.2f}"


def how_sure_is_that(page: Page, result: StudyResult) -> None:
    for mode, measured in zip((1, 3), result.forecast_check.measured_damping[:, :, 1]):
        low, high = numbers(page, rf"Mode {mode}: [\d.]+ -> at least [\d.]+ \[([\d.]+), ([\d.]+)\] %")
        shown = row(page, LEAST, Mode=str(mode))
        assert (float(shown["low"]), float(shown["high"])) == (low, high)
        assert low < 100 * measured.min() < high


def at_which_levels(page: Page, result: StudyResult) -> None:
    levels = result.placement.forecast.force_levels
    assert numbers(page, r"Mode 1: .+? % damping at ([\d.]+) to ([\d.]+) N") == [levels.min(), levels.max()]


def what_is_meant_by_damping(page: Page, result: StudyResult) -> None:
    for mode, values in zip((1, 3), result.placement.ranking.best.damping):
        shown = answer(page, rf"Mode {mode}: .+? as a linear fit of the test reads it \(([\d.]+) % by the power")[0]
        digits(shown, 100 * values.min())


def where_do_the_frequencies_go_and_why(page: Page, result: StudyResult) -> None:
    forecast = result.placement.forecast
    for index, mode in enumerate((1, 3)):
        worst = forecast.damping[index, :, 1].argmin()
        pattern = (
            rf"Mode {mode}: .+? ([\d.]+) -> ([\d.]+) Hz \(mass ([-+][\d.]+) Hz, sticking joints ([-+][\d.]+) Hz, "
            r"sliding, other modes and higher order ([-+][\d.]+) Hz\)"
        )
        bare, there, *parts = numbers(page, pattern)
        digits(f"{bare:.1f}", forecast.bare_frequencies[index])
        digits(f"{there:.1f}", forecast.frequency[index, worst, 1])
        assert bare + sum(parts) == pytest.approx(there, abs=0.2)


def what_damping_and_frequency_are_forecast_at_every_level_and_force(page: Page, result: StudyResult) -> None:
    forecast = result.placement.forecast
    rows = page.table(*FORECAST)
    assert len(rows) == forecast.damping.size
    for shown, f, zeta in zip(rows, _by_force(forecast.frequency), _by_force(forecast.damping), strict=True):
        digits(shown["f [Hz]"], f)
        digits(shown["ζ [%]"], 100 * zeta)


def what_was_measured_there(page: Page, result: StudyResult) -> None:
    check = result.forecast_check
    table = next(one for one in page.tables if "measured" in one[0])
    places = [place for place, title in enumerate(table[0]) if title == "measured"]
    for shown, f, zeta in zip(
        table[1:], _by_force(check.measured_frequency), _by_force(check.measured_damping), strict=True
    ):
        digits(shown[places[0]], f)
        digits(shown[places[1]], 100 * zeta)


def how_many_of_the_bands_held(page: Page, result: StudyResult) -> None:
    forecast, check = result.placement.forecast, result.forecast_check
    inside = (forecast.frequency_low <= check.measured_frequency) & (
        check.measured_frequency <= forecast.frequency_high
    )
    damped = (forecast.damping_low <= check.measured_damping) & (check.measured_damping <= forecast.damping_high)
    held, of = numbers(page, r"(\d+) of (\d+) measured values lie inside the 95 % bands")
    assert (held, of) == (inside.sum() + damped.sum(), inside.size + damped.size)


def how_many_should_have(page: Page, result: StudyResult) -> None:
    at_least, of_100 = numbers(page, r"\((\d+) or more in (\d+) of 100 cases")
    values = result.forecast_check.measured_damping.size * 2
    assert stats.binom.sf(at_least - 1, values, 0.95) >= of_100 / 100 > stats.binom.sf(at_least, values, 0.95)


def what_is_simulated_by_what(page: Page, _: StudyResult) -> None:
    front = page.words()[: page.words().index("Where the beam goes")]
    assert "Nothing here was measured on hardware" in front
    assert "come from the same simulator and the same contact law, with other joint parameters" in front


def which_force_is_best_at_which_level(page: Page, result: StudyResult) -> None:
    best = result.placement.ranking.best.normal_forces
    for level, force in zip(result.placement.forecast.force_levels, best, strict=True):
        digits(row(page, ("Best F_N [N]",), **{"F_E [N]": f"{level:.1f}"})["Best F_N [N]"], force)


def which_place_is_next_best(page: Page, result: StudyResult) -> None:
    second = result.placement.ranking.places[1]
    shown = row(page, PLACES, Rank="2")
    assert (float(shown["x [m]"]), float(shown["y [m]"])) == pytest.approx(second.centre, abs=1e-3)
    digits(shown["Objective [%]"], 100 * second.score)


def what_makes_the_bands_wide(page: Page, result: StudyResult) -> None:
    forecast = result.placement.forecast
    for index, mode in enumerate((1, 3)):
        shown = {one["Source"]: float(one[f"mode {mode}: ζ [%]"]) for one in page.table("Source", "mode 1: f [%]")}
        widest = forecast.sources[int(forecast.damping_shares[index].argmax())]
        assert max(shown, key=lambda source: shown[source]) == widest


def which_test_comes_next(page: Page, result: StudyResult) -> None:
    trials = result.placement.trials
    best = trials.trials[int(np.argmax([gain / one.hours for gain, one in zip(trials.narrowing, trials.trials)]))]
    pattern = (
        r"Next best test: beam at \(([\d.]+), ([\d.]+)\) m, \d+ deg, F_E ([\d.]+) N, F_N ([\d.]+) N \(([\d.]+) h\); "
        r"it is expected to narrow the bands of the damping ratio from ±([\d.]+) to ±([\d.]+) %"
    )
    x, y, level, force, hours, before, after = numbers(page, pattern)
    assert (x, y) == pytest.approx(best.centre, abs=1e-3)
    assert (level, force, hours) == (best.force_level, best.normal_force, best.hours)
    digits(f"{before:.1f}", 100 * trials.damping_width)
    digits(f"{after:.1f}", 100 * best.damping_width)


def does_a_controlled_force_help(page: Page, result: StudyResult) -> None:
    energies = {line.law: line.energy for line in result.placement.control.lines}
    constant = energies.pop("constant")
    least = 1 - min(energies.values()) / constant
    assert least < numbers(page, r"no controlled force removes the energy by more than ([\d.]+)% sooner")[0] / 100
    assert numbers(page, r"than the best constant one of ([\d.]+) N")[0] == result.placement.control.lines[0].force


def where_is_a_linear_fit_not_to_be_trusted(page: Page, result: StudyResult) -> None:
    for one in result.maps:
        shown = numbers(page, rf"{one.name}: a linear mode leaves up to .+? more than 5 % in (\d+) of (\d+) conditions")
        assert shown == [np.sum(one.chart.misfit > 0.05), one.chart.misfit.size]


def from_which_files(page: Page, _: StudyResult) -> None:
    shown = row(page, ("File", "SHA-256"), File="campaign.toml")["SHA-256"]
    campaign = ROOT / "datasets" / "work_table_placed" / "campaign.toml"
    assert hashlib.sha256(campaign.read_bytes()).hexdigest().startswith(shown)


def _by_force(values: np.ndarray) -> np.ndarray:
    """Values of (mode, level, force) in the order of the table: mode by mode, force by force."""
    return values.transpose(0, 2, 1).ravel()


QUESTIONS: tuple[Callable[[Page, StudyResult], None], ...] = (
    which_beam_goes_where,
    how_hard_is_it_pressed,
    at_which_modes_does_it_aim,
    how_much_damping_is_there_without_it,
    how_much_at_least_with_it,
    how_sure_is_that,
    at_which_levels,
    what_is_meant_by_damping,
    where_do_the_frequencies_go_and_why,
    what_damping_and_frequency_are_forecast_at_every_level_and_force,
    what_was_measured_there,
    how_many_of_the_bands_held,
    how_many_should_have,
    what_is_simulated_by_what,
    which_force_is_best_at_which_level,
    which_place_is_next_best,
    what_makes_the_bands_wide,
    which_test_comes_next,
    does_a_controlled_force_help,
    where_is_a_linear_fit_not_to_be_trusted,
    from_which_files,
)


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda one: one.__name__)
def test_the_report_alone_answers(job: tuple[Page, StudyResult], question: Callable[[Page, StudyResult], None]) -> None:
    question(*job)
