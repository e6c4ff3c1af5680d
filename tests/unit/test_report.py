"""The report, read as a reader's browser does: numbers, order, escaping, and nothing fetched from elsewhere."""

import base64
import csv
import errno
import hashlib
import html
import io
import json
import os
from collections.abc import Callable
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from datetime import UTC, datetime
from importlib.resources import files
from multiprocessing import get_context
from pathlib import Path
from urllib.parse import unquote

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import ema.report
from ema.cli.common import save_pictures
from ema.data import (
    Condition,
    Excitation,
    Expectation,
    Finding,
    JointForce,
    LevelEffect,
    Provenance,
    Run,
    SingleMode,
    StudyResult,
)
from ema.dof import Dof
from ema.errors import FailureError
from ema.report import pictures
from ema.report.blocks import Book
from ema.report.comparison import comparisons
from ema.report.modes import equivalent_table, run_sentence
from tests.unit.report_corpus import EXPECTATIONS, JOINTS, REPAIRS, plate, run_result, set_up_shifts, study
from tests.unit.report_page import Page, described


@pytest.fixture(scope="module")
def two_runs() -> StudyResult:
    geometry = plate(5, 4)
    runs = (run_result("bare", geometry), run_result("beam_1kN", geometry, shift=1.013, factor=1.9, joints=JOINTS))
    return study(
        runs,
        geometry,
        repairs=REPAIRS,
        expectations=EXPECTATIONS,
        provenance=Provenance(
            versions=(("numpy", "2.4.6"),), steps=("open", "fit"), created=datetime(2026, 11, 21, tzinfo=UTC)
        ),
    )


@pytest.fixture(scope="module")
def page(two_runs: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Page:
    folder = tmp_path_factory.mktemp("Bericht über Tisch")
    return Page(ema.report.write(two_runs, folder / "Tisch & Balken.html"))


def test_mode_table_has_the_numbers_rounded_by_their_uncertainty(page: Page):
    """Standard deviations of 0.005 Hz and 0.0019 %: 95 % of a normal distribution lie within 1.960 of them
    (`scipy.stats.norm.ppf(0.975)`), which is 0.0098 Hz and 0.0037 %. Reports took 2, the other pages 1.96.
    """
    rows = page.table("Mode", "F_N J1 [N]")
    assert next(row["f [Hz]"] for row in rows) == "243.1200 ± 0.0098"
    assert rows[0]["ζ [%]"] == "0.1900 ± 0.0037"
    assert [row["MPC [-]"] for row in rows] == ["1.000"] * 4
    assert rows[0]["F_N J1 [N]"] == "1018 ± 27"
    assert rows[0]["Confidence [-]"] == "0.97"


def test_only_words_that_no_column_has_room_for_are_broken_within(page: Page):
    """The longest German words of the report, 24 letters with their punctuation, are not among them; a SHA-256 is."""
    table = Book().table("words", "", ("Word",), [("-",)], 1)
    for cell in ("sticking", "Beschleunigungsaufnehmer", "many words that are short", "", "Stabilisierungsdiagramm:"):
        assert table.style(cell) == ""
    assert table.style("sha256 " + 64 * "0") == "long" and table.style(3) == "n"
    assert "td.long { overflow-wrap: anywhere; }" in page.source and '<td class="n">' in page.source


@pytest.mark.usefixtures("undrawn")
def test_set_ups_that_differ_have_a_table(two_runs: StudyResult, tmp_path: Path):
    modes = two_runs.runs[0].modes
    runs = (replace(two_runs.runs[0], modes=replace(modes, set_ups=set_up_shifts(modes))), *two_runs.runs[1:])
    page = Page(ema.report.write(replace(two_runs, runs=runs), tmp_path / "set-ups.html"))
    rows = page.table("Mean f [Hz]", "Set-up A [%]")
    assert [row["Set-up A [%]"] for row in rows] == ["+0.2100 ± 0.0020", "+0.1900 ± 0.0020", "+0.2000 ± 0.0014"]
    assert [row["Set-up B [%]"] for row in rows] == ["-0.2100 ± 0.0020", "", "-0.2000 ± 0.0014"]
    assert rows[0]["f without sensors [Hz]"] == f"{1.01 * modes.natural_frequencies[0]:.3f} ± 0.020"
    assert "sensors of 5.20 ± 0.20 g each explain the differences" in page.words()


def test_answer_comes_first(page: Page):
    words = page.words()
    places = [
        words.index(text)
        for text in (
            "Table with a friction beam",
            "In short",
            "Table 1.",
            "Runs compared",
            "Findings error",
            "Expected and found",
            "Repairs Table",
            "Run bare Condition and normal force",
            "Provenance Table",
        )
    ]
    assert places == sorted(places)
    assert "Run beam_1kN (mean normal force 1007 N over 2 joints): 4 modes from 243.12 to 1316.9 Hz" in words
    assert "beam_1kN against bare, 4 pairs of modes: frequency +1.30 %, damping times 1.90." in words


def test_comparison_pairs_the_modes_and_says_what_the_interval_holds(page: Page):
    rows = page.table("Mode", "Mode in beam_1kN")
    assert [(row["Mode"], row["Mode in beam_1kN"]) for row in rows] == [(str(n), str(n)) for n in (1, 2, 3, 4)]
    assert {row["Change of f [%]"] for row in rows} == {"+1.30"}
    assert {row["ζ ratio [-]"] for row in rows} == {"1.90"}
    assert {row["MAC [-]"] for row in rows} == {"1.000"}
    assert "noise only; assembly scatter unknown" in page.words()


def test_changes_of_both_signs_are_listed_and_have_no_median():
    """+1 %, -7e-5 % and -4 %: a median says -7e-5 %, which is true of no mode that matters."""
    geometry = plate(5, 4)
    base, other = run_result("bare", geometry, 3), run_result("beam", geometry, 3)
    factors = np.array([1.01, 1 - 7e-7, 0.96])
    other = replace(other, modes=replace(other.modes, poles=other.modes.poles * factors))
    (line, *_), _ = comparisons([base, other], Book())
    assert line == "beam against bare, 3 pairs of modes: frequency +1.00, 0.00 and -4.00 %, damping times 1.00."
    many = run_result("bare", geometry, 6), run_result("beam", geometry, 6)
    poles = many[1].modes.poles * np.linspace(0.96, 1.02, 6)
    (line, *_), _ = comparisons([many[0], replace(many[1], modes=replace(many[1].modes, poles=poles))], Book())
    assert "frequency -4.00 to +2.00 %" in line


def test_a_figure_is_drawn_once_for_each_format_and_is_what_savefig_writes(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    """SVG at its layout, PNG with the layout of the SVG at 150 dots per inch; the same beside what commands write."""
    figures = [Figure(figsize=(4, 3), layout="constrained") for _ in range(3)]
    for figure in figures:
        axes = figure.subplots(1, 2)
        axes[0].plot(np.random.default_rng(3).normal(size=4000), ".", label="noise")
        axes[1].set(ylabel="A long label\nof two lines", title="Title")
        figure.legend()
    saved = []
    with matplotlib.rc_context(pictures._SVG):
        for kind, metadata in (("svg", {"Date": None, "Creator": None}), ("png", {"Software": None})):
            target = io.BytesIO()
            figures[0].savefig(target, format=kind, dpi=150, metadata=metadata)
            figures[0].set_layout_engine("none")
            saved.append(target.getvalue())
    count, draw = [], Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda figure, renderer: count.append(figure) or draw(figure, renderer))
    smaller, png = pictures.drawn(figures[1], png=True)
    assert len(count) == 2
    assert png.content == saved[1] and smaller.content == min(saved, key=len)
    vector, none = pictures.drawn(Figure(figsize=(4, 3), layout="constrained"))
    assert vector.mime == "image/svg+xml" and none is None and len(count) == 3
    written = save_pictures(tmp_path, {"noise": figures[2]})
    assert [path.name for path in written] == ["noise.svg", "noise.png"] and len(count) == 5
    assert [path.read_bytes() for path in written] == saved


def test_what_a_linear_fit_reads_at_the_level_stands_beside_small_amplitudes():
    result = run_result("beam", plate(5, 4), 1)
    at = (Dof(1, "+Z"),)
    single = SingleMode(
        "local fit", 489.43, 0.0176, np.zeros((1, 1), complex), at, at, (480.0, 498.0), 37, 0.04, 1e-4, 0.17
    )
    finding = Finding("warning", "slip-then-ring", "run beam", "It slips.")
    effect = LevelEffect(0.35, 0.33, 0.37, 682.4, 1203.6)
    result = replace(result, findings=(finding,), level_effect=effect, equivalent=(single,))
    expected = (
        "One linear mode fitted to the FRFs about each of them reads 489.4 Hz with 1.8 % at impacts of 682 to 1204 N."
    )
    assert run_sentence(result).endswith(expected)
    book = Book()
    equivalent_table(result, book)
    assert [str(cell) for cell in book.tables[0].rows[0]] == ["489.430 ± 0.078", "1.760 ± 0.020", "0.170", "480 to 498"]
    assert equivalent_table(replace(result, equivalent=()), book) is None


def test_a_mode_with_two_likely_partners_is_named_and_not_counted():
    """Mode 2 comes back in two parts that are about equally like it."""
    geometry = plate(5, 4)
    base, other = run_result("bare", geometry, 3), run_result("slipping", geometry, 4, 1.01, 2.0)
    shapes = np.array(other.modes.shapes)
    tail = shapes[:, 3] * np.linalg.norm(shapes[:, 1]) / np.linalg.norm(shapes[:, 3])
    shapes[:, 3] = 0.8 * shapes[:, 1] + 0.6 * tail
    shapes[:, 1] = 0.8 * shapes[:, 1] - 0.6 * tail
    other = replace(other, modes=replace(other.modes, shapes=shapes))
    (line, *_), _ = comparisons([base, other], Book())
    assert line.startswith("slipping against bare, 2 pairs of modes")
    assert line.endswith("resembles modes 2 and 4 of slipping: not counted.")


def test_findings_are_grouped_and_sorted_by_severity(page: Page):
    words = page.words()
    places = [
        words.index(text) for text in ("reversed-sensor 2 times", "low-coherence 4 times", "frequency-shift 2 times")
    ]
    assert places == sorted(places)
    assert "Findings: 2 errors, 4 warnings, 2 remarks." in words


def test_missed_expectations_come_first(page: Page):
    rows = page.table("Expected", "Found")
    assert [(row["What"], row["Found"], row["Result"]) for row in rows] == [
        ("zeta", "0.710", "missed"),
        ("f of mode 1 [Hz]", "240.00", "met"),
    ]


def test_every_figure_has_a_telling_alternative_text(page: Page):
    assert len(page.images) == 2 * 10 + 1 + 2, "each run, the normal force, MAC and FRF before and after"
    for image in page.images:
        assert len(image["alt"]) > 30
    told = " ".join(image["alt"] for image in page.images)
    assert "3 of 4 accepted; rejected for: double hit" in told
    assert "76 poles; selected modes at 240, 593.33, 946.67, 1300 Hz" in told


def test_figures_and_tables_are_numbered_in_order(page: Page):
    words = page.words()
    for kind, count in (("Figure", len(page.images)), ("Table", sum(link.endswith(".csv") for link in page.links))):
        places = [words.index(f"{kind} {number}.") for number in range(1, count + 1)]
        assert places == sorted(places)
        assert f"{kind} {count + 1}." not in words


def test_nothing_is_fetched_and_only_our_script_runs(page: Page):
    assert "link" not in page.tags and "iframe" not in page.tags
    *data, script = page.scripts
    assert [len(json.loads(each)["shapes"]) for each in data] == [4, 4]
    assert script.startswith((files("ema.show") / "moving.js").read_text(encoding="utf-8"))
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{allowed}'" in (
        html.unescape(page.source)
    )
    assert all(
        image["src"].startswith(("data:image/png;base64,", "data:image/svg+xml;base64,")) for image in page.images
    )
    for image in page.images:
        base64.b64decode(image["src"].split(",")[1], validate=True)
    assert all(link.startswith("#") or link.endswith(".csv") for link in page.links)
    assert "http://" not in page.source and "https://" not in page.source and "url(" not in page.source


def test_text_from_files_stays_text(page: Page):
    assert "<script>alert" not in page.source
    assert page.words().count("<script>alert('x')</script> & <b>") >= 3


def test_every_link_inside_the_page_has_a_target(page: Page):
    for link in page.links:
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in page.source


def test_every_table_lies_beside_the_report_with_its_full_numbers(page: Page, two_runs: StudyResult):
    files = [page.path.parent / unquote(link) for link in page.links if link.endswith(".csv")]
    assert len(set(files)) == len(files) > 10
    assert {file.parent.name for file in files} == {"Tisch & Balken_tables"}
    tables = {file.stem: list(csv.DictReader(file.open(encoding="utf-8"))) for file in files}
    modes = two_runs.runs[1].modes
    np.testing.assert_array_equal([float(row["f [Hz]"]) for row in tables["modes_beam_1kN"]], modes.natural_frequencies)
    assert [float(row["std f [Hz]"]) for row in tables["modes_beam_1kN"]] == pytest.approx([0.005] * 4)
    assert len(tables["findings"]) == 8
    assert len(tables["frf_errors_bare"]) == 40


def test_repairs_and_provenance(page: Page):
    assert page.table("What", "Who", "Why")[0]["Who"] == "A. Tester"
    files = {row["File"]: row["SHA-256"] for row in page.table("File", "SHA-256")}
    assert files == {"campaign.toml": "cd" * 32, "bare.h5": "ab" * 32, "beam_1kN.h5": "ab" * 32}
    assert "Steps: open → fit." in page.words()


def test_normal_force_table(page: Page):
    rows = page.table("Joint", "Run-in")
    assert rows[0] == {
        "Joint": "J1",
        "F_N [N]": "1018 ± 27",
        "std [N]": "27",
        "drift [N]": "-12",
        "Torque [N m]": "12.0",
        "Loading": "up",
        "Run-in": "20",
        "Calibration": "cell 17",
    }


def test_the_same_result_gives_the_same_file(tmp_path: Path):
    geometry = plate(5, 4)
    first, second = (
        ema.report.write(study((run_result("one", geometry, count=2),), geometry), tmp_path / folder / "r.html")
        for folder in ("a", "b")
    )
    assert first.read_text(encoding="utf-8") == second.read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn")
def test_one_mode_no_geometry_no_coherence_no_blows(tmp_path: Path):
    run = run_result("one", plate(5, 4), count=1)
    bare = replace(
        run,
        frfs=replace(run.frfs, coherence=None),
        hits=None,
        poles=None,
        reconstruction=None,
        findings=(),
        modes=replace(run.modes, covariance=None, confidence=None),
    )
    words = (page := Page(ema.report.write(study((bare,), None), tmp_path / "r.html"))).words()
    for told in (
        "1 mode at 240 Hz",
        "no geometry, so shapes cannot be drawn in space",
        "No coherence came with these FRFs",
        "came as finished FRFs",
        "no stabilisation diagram",
        "No FRFs of the modal model were computed",
        "no uncertainty was estimated",
        "Findings: none.",
        "No metadata was repaired.",
    ):
        assert told in words
    assert page.table("Mode", "MPC [-]")[0]["f [Hz]"] == "240.000"


@pytest.mark.usefixtures("undrawn")
def test_no_mode_is_said(tmp_path: Path):
    run = run_result("none", plate(5, 4), count=0)
    words = Page(ema.report.write(study((run,), plate(5, 4)), tmp_path / "r.html")).words()
    assert "Run none (no friction beam): 0 modes." in words
    assert "no mode was found, so there are no modal parameters to show" in words


@pytest.mark.usefixtures("undrawn")
def test_no_run_at_all(tmp_path: Path):
    assert "No run was analysed." in Page(ema.report.write(study((), None), tmp_path / "r.html")).words()


@pytest.mark.usefixtures("undrawn")
def test_unknown_normal_force_is_called_unknown(tmp_path: Path):
    run = run_result("beam", plate(5, 4), joints=(JointForce("J1"),))
    page = Page(ema.report.write(study((run,), None), tmp_path / "r.html"))
    assert page.table("Mode", "F_N J1 [N]")[0]["F_N J1 [N]"] == "unknown"
    assert "normal force unknown in 1 of 1 joint" in page.words()


@pytest.mark.usefixtures("undrawn")
def test_repeats_bound_the_assembly_scatter(tmp_path: Path):
    geometry = plate(5, 4)
    runs = (
        run_result("first", geometry, joints=JOINTS, repeat="1kN"),
        run_result("second", geometry, shift=1.002, factor=1.1, joints=JOINTS, repeat="1kN"),
    )
    words = Page(ema.report.write(study(runs, geometry), tmp_path / "r.html")).words()
    assert "Repeats of 1kN (first, second): 2 repeats." in words
    assert "No difference" not in words
    rows = Page(tmp_path / "r.html").table("Mode", "Repeats")
    assert [row["Repeats"] for row in rows] == ["2"] * 4
    # two values 0.2 % apart: scatter 0.48 / sqrt(2), and Student's 12.7 for the interval
    assert rows[0]["between f [Hz]"].startswith("0.34 (0.15 to 11")
    assert rows[0]["f [Hz]"] == "240.2 ± 3.0"


@pytest.mark.usefixtures("undrawn")
def test_runs_on_different_points_are_not_compared(tmp_path: Path):
    one, other = run_result("one", plate(5, 4)), run_result("other", plate(5, 4))
    moved = replace(other, modes=replace(other.modes, dofs=tuple(Dof(d.node + 100, "+Z") for d in other.modes.dofs)))
    words = Page(ema.report.write(study((one, moved), plate(5, 4)), tmp_path / "r.html")).words()
    assert "the models have no DOF in common" in words
    assert "No measured DOF is a direction at a point of the geometry" in words


@pytest.mark.usefixtures("undrawn")
def test_names_that_no_file_system_likes(tmp_path: Path):
    geometry = plate(5, 4)
    runs = tuple(replace(run_result("a", geometry), run=Run(name, Condition())) for name in ("a/b", "a b", "a:b"))
    page = Page(ema.report.write(study(runs, geometry), tmp_path / "r.html"))
    files = [tmp_path / unquote(link) for link in page.links if link.endswith(".csv")]
    assert len(set(files)) == len(files)
    assert all(file.is_file() for file in files)


def test_a_run_of_160_frfs_and_20_modes_takes_less_than_half_of_15_megabytes(tmp_path: Path):
    geometry = plate(10, 8)
    run = run_result("beam", geometry, 20, joints=(JointForce("J1", 1000.0, 20.0),), lines=1601)
    path = ema.report.write(study((run,), geometry), tmp_path / "r.html")
    assert path.stat().st_size < 7.5e6


@pytest.mark.usefixtures("undrawn")
def test_sixty_modes(tmp_path: Path):
    run = run_result("many", plate(10, 8), 60)
    page = Page(ema.report.write(study((run,), plate(10, 8)), tmp_path / "r.html"))
    assert len(page.table("Mode", "MPC [-]")) == 60
    told = [image["alt"] for image in page.images if image["alt"].startswith("Mode shapes")]
    assert len(told) == 5
    assert "60 at 1300 Hz" in told[-1]


def test_a_place_that_cannot_be_written_is_said(two_runs: StudyResult, tmp_path: Path):
    (tmp_path / "file").write_text("")
    small = study((), None)
    with pytest.raises(FailureError, match="cannot be written"):
        ema.report.write(small, tmp_path / "file" / "r.html")
    with pytest.raises(FailureError, match="a folder has its name"):
        ema.report.write(small, tmp_path)
    assert FailureError.exit_code == 3


def test_a_full_disk_leaves_the_old_report(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    path = tmp_path / "r.html"
    path.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(FailureError, match="No space left"):
        ema.report.write(study((), None, provenance=Provenance(versions=(("a", "1"),))), path)
    assert path.read_text() == "old"
    assert [file for file in tmp_path.rglob("*") if file.name.startswith(".")] == []


@pytest.mark.usefixtures("undrawn")
def test_photographs_are_inside_and_the_missing_ones_named(tmp_path: Path):
    (tmp_path / "table.jpg").write_bytes(b"\xff\xd8\xff" + bytes(50))
    (tmp_path / "note.txt").write_text("no picture")
    result = study((), None)
    shown = replace(result.campaign, folder=str(tmp_path), photos=("table.jpg", "note.txt", "gone.png"))
    page = Page(ema.report.write(replace(result, campaign=shown), tmp_path / "out" / "r.html"))
    assert [image["alt"] for image in page.images] == ["Photograph of the test: table.jpg"]
    assert "note.txt is not shown: it is neither JPEG, PNG nor GIF" in page.words()
    assert "gone.png cannot be read" in page.words()


@pytest.mark.usefixtures("undrawn")
def test_a_count_is_expected_exactly(tmp_path: Path):
    result = study((), None, expectations=(Expectation("number of modes", 8.0, 0.0, 9.0, False),))
    row = Page(ema.report.write(result, tmp_path / "r.html")).table("Expected", "Found")[0]
    assert (row["Expected"], row["Found"]) == ("8", "9")


@pytest.mark.usefixtures("undrawn")
def test_blows_give_the_level_where_none_is_stated(tmp_path: Path):
    run = run_result("bare", plate(5, 4))
    unstated = replace(run, run=replace(run.run, condition=Condition(Excitation("hammer"))))
    page = Page(ema.report.write(study((unstated,), None), tmp_path / "r.html"))
    assert {"What": "Peak of the impacts [N]", "Value": "median 801, 800 to 803"} in page.table("What", "Value")


class _Deferred(Executor):
    """Draws what was submitted when somebody waits for it; ``die`` as a worker that was killed."""

    def __init__(self, die: bool = False) -> None:
        self.die, self.waiting, self.most = die, 0, 0

    def submit(self, function: Callable, /, *args: object, **named: object) -> Future:
        executor = self
        self.waiting += 1
        self.most = max(self.most, self.waiting)

        class Late(Future):
            def result(self, timeout: float | None = None) -> object:
                executor.waiting -= 1
                if executor.die:
                    raise BrokenProcessPool("a process in the process pool was terminated abruptly")
                return function(*args, **named)

        return Late()


def test_figures_drawn_by_other_processes_are_the_same(
    two_runs: StudyResult, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """And all of them are: none that cannot be sent is made here without a word."""
    german = ema.report.write(two_runs, tmp_path / "de.html", language="de").read_bytes()
    made: list[object] = []
    monkeypatch.setattr(pictures, "drawn", lambda figure, png: made.append(figure) or _NOTHING)
    ema.report.write(two_runs, tmp_path / "here.html")
    here, made[:] = len(made), []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        path = ema.report.write(two_runs, tmp_path / "Tisch & Balken.html", executor=pool)
        spoken = ema.report.write(two_runs, tmp_path / "de.html", language="de", executor=pool).read_bytes()
    assert here > 10 and not made
    assert path.read_bytes() == page.path.read_bytes()
    assert spoken == german != path.read_bytes()


_NOTHING = pictures.Image(b"", "image/png"), None
"""A figure drawn as nothing."""


@pytest.fixture(scope="module")
def described_page(two_runs: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """The report with what its figures say in place of them, made here one after the other."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "drawn", described)
        return Page(ema.report.write(two_runs, tmp_path_factory.mktemp("described") / "Tisch & Balken.html"))


@pytest.fixture
def figures_described(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a figure says in place of its picture, for tests of which figure is drawn where."""
    monkeypatch.setattr(pictures, "drawn", described)


@pytest.mark.usefixtures("figures_described")
def test_a_report_holds_few_figures_at_once_and_survives_their_workers(
    two_runs: StudyResult, page: Page, described_page: Page, tmp_path: Path
):
    drawn, told = ({image["src"] for image in one.images} for one in (page, described_page))
    assert len(told) == len(drawn) >= 20, "a figure in the place of another shows as it does where all are drawn"
    for die in (False, True):
        path = ema.report.write(two_runs, tmp_path / "Tisch & Balken.html", executor=(executor := _Deferred(die)))
        assert path.read_bytes() == described_page.path.read_bytes()
        assert (executor.waiting, executor.most) == (0, 9)


@pytest.mark.usefixtures("figures_described")
def test_a_report_is_drawn_here_where_the_processes_have_died(
    two_runs: StudyResult, described_page: Page, tmp_path: Path
):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        with pytest.raises(BrokenProcessPool):
            pool.submit(os._exit, 1).result()
        path = ema.report.write(two_runs, tmp_path / "Tisch & Balken.html", executor=pool)
    assert path.read_bytes() == described_page.path.read_bytes()
