"""Beam and friction in the report: placement, before and after, ring-downs, loops, the logo; and reports of no study."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ema.report
from ema import examples, show
from ema.data import Condition, Finding, FrfSet, JointForce, Run, StudyResult
from ema.dof import Dof
from ema.errors import InputError
from ema.report.blocks import Book
from ema.report.change import _common
from ema.report.friction import ring_down_sentences, ring_downs
from ema.report.pictures import drawn
from ema.report.placement import answer as placement_answer
from ema.show.placement import seen_edges
from tests.unit.friction_nouns import decay, loop, placement
from tests.unit.report_corpus import EVIL, JOINTS, plate, run_result, study
from tests.unit.report_page import BLANK, Page, blank


def rows(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "r_tables" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def result() -> StudyResult:
    geometry = plate(4, 3)
    small = {"count": 2, "lines": 100}
    runs = (
        run_result("bare", geometry, **small),
        run_result("beam_1kN", geometry, shift=1.013, factor=1.9, joints=JOINTS, **small),
    )
    return study(
        runs, geometry, placement=placement(geometry), decays=(decay(), decay(EVIL)), loops=(loop(500.0, "J1"),)
    )


@pytest.fixture(scope="module")
def page(result: StudyResult, tmp_path_factory: pytest.TempPathFactory) -> Page:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ema.report.pictures.drawn", blank)
        return Page(ema.report.write(result, tmp_path_factory.mktemp("friction") / "r.html"))


def test_the_recommended_place_and_normal_force_come_first(page: Page):
    words = page.words()
    answer = words.index("Bolt steel 60 x 50 at")
    assert "press every joint with 123 N" in words
    assert "at least 1.87 [1.50, 2.00] % damping at 10 to 40 N" in words
    assert words.index("In short") < answer < words.index("Run bare (no friction beam)") < words.index("Modes Table")
    assert words.index("A controlled force removes the energy 17 % faster.") < words.index("Modes Table")
    first = page.images[0]["alt"]
    assert (
        first
        == "Map of 15 places of the beam on the structure; the best is at (1.000, 0.400) m with F_N 123 N in every joint."
    )


def test_the_warning_of_a_model_that_does_not_agree_is_the_first_sentence(tmp_path: Path, undrawn: None):
    words = Page(ema.report.write(placement(warning="THE JOINT MODEL DOES NOT AGREE."), tmp_path / "r.html")).words()
    assert "In short THE JOINT MODEL DOES NOT AGREE. Bolt steel" in words


def test_places_forces_and_control_are_tables(page: Page):
    folder = page.path.parent
    (first, *_others) = rows(folder, "places")
    assert [float(first[key]) for key in ("x [m]", "y [m]", "F_N [N]")] == pytest.approx([1.0, 0.4, 123.0])
    assert float(first["Objective [%]"]) == pytest.approx(1.9) and first["95 % of ζ1 [%]"] == "1.50 ... 2.00"
    levels = rows(folder, "recommended_force")
    assert [float(row["Best F_N [N]"]) for row in levels] == [110.0, 140.0]
    assert [float(row["ζ1 high [%]"]) for row in levels] == pytest.approx([2.3, 2.0])
    assert [float(row["J [ms]"]) for row in rows(folder, "control")] == pytest.approx([12.0, 10.0])
    assert [float(row["ζ, one for each [%]"]) for row in rows(folder, "control_steady")] == pytest.approx([2.11, 1.99])
    assert page.table("F_E [N]", "Best F_N [N]")[1]["Best F_N [N]"] == "140"


def test_the_map_lies_on_the_structure():
    geometry = plate(5, 4)
    edges = seen_edges(placement(geometry))
    assert len(edges) == 5 * 3 + 4 * 4
    assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) == pytest.approx(
        np.where(np.isclose(edges[:, 0, 0], edges[:, 1, 0]), 0.8 / 3, 0.3)
    )
    assert len(seen_edges(placement())) == 0
    figure = show.placement_map(placement(geometry))
    assert len(drawn(figure)[0].content) > 10_000
    (panel, *_rest) = figure.axes
    assert max(panel.get_xlim()) >= 1.2


def test_mac_between_runs_is_a_picture_and_a_table(page: Page, result: StudyResult):
    found = np.array([[float(row[str(k)]) for k in range(1, 3)] for row in rows(page.path.parent, "mac_bare_beam_1kN")])
    assert np.diag(found) == pytest.approx(1) and (found - np.eye(2)).max() < 0.1
    alts = [image["alt"] for image in page.images]
    assert any(
        alt.startswith("MAC between modes of bare and beam_1kN: 2 pairs with a MAC from 1.00 to 1.00") for alt in alts
    )
    assert any(alt == "FRF 1:+Z/1:+Z, the drive point, in runs bare, beam_1kN." for alt in alts)


def test_mac_of_modes_after_sticking_is_withheld(result: StudyResult, tmp_path: Path, undrawn: None):
    """A joint that slips takes another part of a mode at every point struck: what is compared is no shape."""
    finding = Finding(
        "info", "modes-after-sticking", "run beam_1kN", "The modes are those of the decay after sticking."
    )
    bare, beam = result.runs
    runs = (bare, replace(beam, findings=(*beam.findings, finding)))
    page = Page(ema.report.write(replace(result, runs=runs), tmp_path / "r.html"))
    assert "The MAC between bare and beam_1kN is withheld: modes of beam_1kN are those after sticking" in page.words()
    assert not (page.path.parent / "r_tables" / "mac_bare_beam_1kN.csv").exists()


def test_frfs_are_laid_over_each_other_at_the_drive_point_in_one_sense():
    lines = np.linspace(1, 10, 10)
    one = FrfSet(lines, np.full((10, 1, 2), 2.0 + 0j), (Dof(1, "+Z"),), (Dof(2, "+Z"), Dof(1, "-Z")), "accelerance")
    two = FrfSet(lines, np.full((10, 1, 1), 3.0 + 0j), (Dof(1, "-Z"),), (Dof(1, "-Z"),), "accelerance")
    assert _common([one, two]) == (True, [(0, 1), (0, 0)])
    magnitude, phase = show.frf_overlay([one, two], [(0, 1), (0, 0)], ["bare", "beam"]).axes
    assert [line.get_ydata()[0] for line in magnitude.lines] == [2.0, 3.0]
    assert [abs(line.get_ydata()[0]) for line in phase.lines] == [180.0, 0.0], "the hammer stood against the sensor"
    far = replace(two, outputs=(Dof(7, "+Z"),))
    assert _common([one, far]) is None
    crossed = replace(two, outputs=(Dof(1, "+Z"),), inputs=(Dof(2, "+Z"),))
    assert _common([one, crossed]) == (False, [(0, 0), (0, 0)])


@pytest.mark.usefixtures("undrawn")
def test_runs_without_a_common_frf_or_unit_are_said(tmp_path: Path):
    geometry = plate(5, 4)
    base, other = run_result("bare", geometry), run_result("beam", geometry, joints=JOINTS)
    unlike = replace(
        other,
        frfs=replace(other.frfs, quantity="mobility"),
        reconstruction=replace(other.reconstruction, quantity="mobility"),
    )
    words = Page(ema.report.write(study((base, unlike), geometry), tmp_path / "r.html")).words()
    assert "FRFs of beam are of another quantity or unit than those of bare." in words
    moved = replace(other, frfs=replace(other.frfs, outputs=(Dof(900, "+Z"), Dof(901, "+Z"))))
    words = Page(ema.report.write(study((base, moved), geometry), tmp_path / "r.html")).words()
    assert "bare, beam have no FRF in common" in words


def test_ring_downs_have_phases_knee_and_curves(page: Page):
    words, folder = page.words(), page.path.parent
    assert (
        "Ring-down of release 1: sliding 16.7 Hz with 4.30 % damping, sticking 31.6 Hz with 0.100 % damping; "
        "the joint begins to stick at 0.500 s." in words
    )
    found = [row for row in rows(folder, "ring_downs") if row["Ring-down"] == "release 1"]
    assert [row["Phase"] for row in found] == ["sliding", "sticking"]
    assert [float(row["f [Hz]"]) for row in found] == [16.7, 31.6]
    assert float(found[0]["Exponential over straight"]) > 1 > float(found[1]["Exponential over straight"])
    curve = [row for row in rows(folder, "ring_down_curves") if row["Ring-down"] == "release 1"]
    assert len(curve) == 500 and float(curve[0]["Amplitude"]) == pytest.approx(1e-3)
    assert EVIL in page.text and "<script>alert" not in page.source


def test_phases_have_intervals_and_the_normal_forces_of_their_runs():
    known = replace(decay("release, record 2"), frequency_reach=np.full(2000, 0.12), damping_reach=np.full(2000, 4e-4))
    runs = (
        Run("release", Condition(joints=(JointForce("J1", mean=505.0, std=1.0), JointForce("J2")))),
        Run("other", Condition(joints=(JointForce("J3", mean=1.0, std=0.1),))),
    )
    *_, phases, curves = ring_downs((known, decay("free")), Book(), runs)
    assert phases.columns[2:4] == ("F_N J1 [N]", "F_N J2 [N]") and phases.columns[-2:] == ("± f [Hz]", "± ζ [%]")
    pressed, _, free, _ = ([str(cell) for cell in row] for row in phases.rows)
    assert pressed[2:4] == ["505.0 ± 1.0", "unknown"] and free[2:4] == ["", ""]
    assert pressed[7:9] == ["16.70 ± 0.12", "4.300 ± 0.040"] and free[7:9] == ["16.70", "4.300"]
    assert pressed[-2:] == ["0.12", "0.040"] and phases.shown == len(phases.columns) - 2
    assert [str(cell) for cell in curves.rows[0][-2:]] == ["0.120000", "0.0400000"]


def test_loops_have_their_energy(page: Page):
    (found,) = rows(page.path.parent, "loops")
    slip = 100.0
    area = 4 * slip * (2e-5 - slip / 2e7)
    assert float(found["Energy per cycle [mJ]"]) == pytest.approx(1e3 * area)
    assert float(found["Loss factor"]) == pytest.approx(area / (np.pi * 2e-5 * slip))
    assert float(found["Largest force [N]"]) == pytest.approx(slip)


def test_figures_and_tables_stay_in_order_with_everything_in(page: Page):
    for what in ("Figure", "Table"):
        numbers = [int(n) for n in re.findall(rf"<b>{what} (\d+)\.", page.source)]
        assert numbers == list(range(1, len(numbers) + 1)) and len(numbers) > 10
    assert all(image["alt"] for image in page.images)


@pytest.mark.usefixtures("undrawn")
def test_every_format_says_the_same_of_placement_and_friction(result: StudyResult, tmp_path: Path):
    docx, pypdf = pytest.importorskip("docx"), pytest.importorskip("pypdf")
    pytest.importorskip("weasyprint")
    (tmp_path / "logo.png").write_bytes(BLANK.content)
    result = replace(
        result, runs=result.runs[:1], campaign=replace(result.campaign, folder=str(tmp_path), logo="logo.png")
    )
    ema.report.write(result, tmp_path / "r.html", ("html", "pdf", "docx"))
    page = Page(tmp_path / "r.html")
    words = re.sub(r"\s+", "", "".join(one.extract_text() for one in pypdf.PdfReader(tmp_path / "r.pdf").pages))
    text = docx.Document(str(tmp_path / "r.docx"))
    told = [[[cell.text for cell in row.cells] for row in table.rows] for table in text.tables[1:]]
    assert told == page.tables
    for columns in (("Best F_N [N]",), ("Phase", "Knee [s]"), ("Loss factor",), ("J [ms]",)):
        for row in page.table(*columns):
            assert all(re.sub(r"\s+", "", cell) in words for cell in row.values()), row
    assert page.images[0]["alt"] == "Logo"
    assert text.inline_shapes[0]._inline.docPr.get("descr") == "Logo"


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"<svg/>", "neither JPEG, PNG nor GIF"),
        (b"\xff\xd8\xff" + bytes(4_000_000), "4.0 MB, limit 3 MB"),
        (None, "cannot be read"),
    ],
)
def test_a_logo_that_cannot_be_shown_is_told(tmp_path: Path, content: bytes | None, told: str):
    if content is not None:
        (tmp_path / "logo.png").write_bytes(content)
    geometry = plate(5, 4)
    result = study((run_result("bare", geometry),), geometry)
    result = replace(result, campaign=replace(result.campaign, folder=str(tmp_path), logo="logo.png"))
    page = Page(ema.report.write(result, tmp_path / "r.html"))
    assert "The logo logo.png" in page.words() and told in page.words()
    assert page.images[0]["alt"] != "Logo"


@pytest.mark.usefixtures("undrawn")
def test_stored_simulations_are_reported(tmp_path: Path):
    held = {"decay 200 N": decay(), "loop 20 µm, F_N 500 N": loop(500.0)}
    page = Page(ema.report.write(held, tmp_path / "r.html"))
    assert "Ring-down of 200 N: sliding" in page.words()
    assert page.table("Loop", "F_N [N]")[0]["Loop"] == "20 µm, F_N 500 N"


def test_what_cannot_be_reported_is_refused(tmp_path: Path):
    with pytest.raises(InputError, match="nothing to report; got Geometry"):
        ema.report.write({"a": plate(2, 2)}, tmp_path / "r.html")
    assert not (tmp_path / "r.html").exists()


def test_many_ring_downs_do_not_bury_the_front_page():
    told = ring_down_sentences([decay(f"release {n}") for n in range(7)])
    assert len(told) == 5 and told[3].startswith("Ring-down of release 3")
    assert told[4] == "3 more ring-downs in the table of phases."


def test_the_first_screen_says_of_the_place_what_the_forecast_says(tmp_path: Path, undrawn: None):
    """The ranking's own values and intervals, which leave out most of what is not known, are not its answer."""
    told = examples.placement()
    best, levels = told.ranking.best, told.ranking.prediction.force_levels
    ranked = replace(told, forecast=None)
    shape = (1, len(levels), 2)
    rng = np.random.default_rng(8)
    middle = {"frequency": rng.uniform(480, 490, shape), "damping": rng.uniform(0.010, 0.014, shape)}
    wide = {f"{name}_{end}": one * f for name, one in middle.items() for end, f in (("low", 0.7), ("high", 1.4))}
    axes = {"force_levels": levels, "normal_forces": np.array([0.5, 1.0]) * best.normal_force}
    forecast = replace(told.forecast, **axes, **middle, **wide)
    least = int(np.argmin(middle["damping"][0, :, 1]))
    answer = placement_answer(replace(told, forecast=forecast))
    damping, frequency = (middle[name][0, least, 1] for name in ("damping", "frequency"))
    assert f"at least {100 * damping:.2f} [{70 * damping:.2f}, {140 * damping:.2f}] % damping" in answer
    assert f"-> {frequency:.1f} Hz" in answer and answer != placement_answer(ranked)
    page = Page(ema.report.write(replace(told, forecast=forecast), tmp_path / "r.html"))
    assert f"at least {100 * damping:.2f} [" in page.words()
    table = rows(tmp_path, "forecast")
    (row,) = (
        one for one in table if float(one["F_N [N]"]) == best.normal_force and float(one["F_E [N]"]) == levels[least]
    )
    assert float(row["ζ [%]"]) == pytest.approx(100 * damping, rel=5e-3)
    assert float(row["f [Hz]"]) == pytest.approx(frequency, abs=0.01)
    # no value of the forecast: those of the ranking stay
    holes = {name: np.full(shape, np.nan) for name in (*middle, *wide)}
    assert placement_answer(replace(told, forecast=replace(forecast, **holes))) == placement_answer(ranked)
    elsewhere = replace(forecast, normal_forces=np.array([0.3, 0.4]) * best.normal_force)
    assert placement_answer(replace(told, forecast=elsewhere)) == placement_answer(ranked)


def test_every_number_of_the_answer_is_found_in_a_table(page: Page, result: StudyResult):
    cells = {cell for table in page.tables for row in table[1:] for cell in row}
    assert result.placement is not None
    said = placement_answer(result.placement)
    # "at 10 to 40 N": the levels of the ranking, which the recommended forces list
    numbers = re.findall(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?= %|, | Hz|\)|\])", said)
    numbers += re.findall(r"\((\d\.\d{3}), (\d\.\d{3})\) m", said)[0]
    assert len(numbers) > 8
    assert [number for number in numbers if number.lstrip("+") not in cells] == []
