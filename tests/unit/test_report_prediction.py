"""Reports of predictions: the first screen stands in the tables, and the tables hold what was predicted."""

import csv
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import ema.report
from ema import examples, store
from ema.cli.app import app
from ema.cli.predicting_levels import _kept
from ema.data import AmplitudeDraws, Band, ForcedResonances, Forecast
from tests.unit import predicted_results
from tests.unit.report_page import Page, blank

NUMBER = r"(?<![A-Za-z_\d.])\d+(?:\.\d+)?(?:e[-+]\d+)?"
CASES = predicted_results.results()


def page(results: Any, folder: Path, language: str = "en") -> Page:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ema.report.pictures.drawn", blank)
        return Page(ema.report.write(results, folder / "p.html", language=language))


def front(shown: Page) -> list[str]:
    """Sentences of the first screen."""
    part = shown.source.split('id="answer"')[1].split("</section>")[0]
    return [line.replace("\u00a0", " ") for line in re.findall(r"<li>(.*?)</li>", part)]


def beside(folder: Path, name: str) -> list[dict[str, str]]:
    with (folder / "p_tables" / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("name", CASES)
def test_every_number_of_the_first_screen_stands_in_a_table(tmp_path: Path, name: str, language: str) -> None:
    shown = page(CASES[name], tmp_path, language)
    cells = {
        number for table in shown.tables for row in table[1:] for cell in row for number in re.findall(NUMBER, cell)
    }
    lines = [line for line in front(shown) if not line.startswith(("Findings", "Befunde"))]
    said = {number for line in lines for number in re.findall(NUMBER, re.sub("95 %|95-%|mode 1", "", line))}
    assert len(said) > 12 and said - cells == set()


def test_values_bands_and_distances_are_those_of_the_prediction(tmp_path: Path) -> None:
    at = CASES["predicted levels"]["prediction"]
    shown = page(CASES["predicted levels"], tmp_path)
    rows = beside(tmp_path, "predicted")
    assert [float(row["amplitude"]) for row in rows] == [15.0, 60.0, 100.0]
    for n, row in enumerate(rows):
        for name, band in (("frequency_Hz", at.frequency), ("damping", at.damping), ("force_N", at.force)):
            for end, values in (("low", band.low), ("median", band.value), ("high", band.high)):
                assert float(row[f"{name}_{end}"]) == values[n]
    where = [row["Against the data"] for row in rows]
    assert where == ["within the data", "1.5 times the highest in the data", "2.5 times the highest in the data"]
    lines = front(shown)
    assert "4 measured levels, 5 to 40 m/s²" in lines[0]
    assert any("At 60 m/s² (1.5 times the highest in the data)" in line for line in lines)
    assert any("warning: The prediction lies far outside the data." in line for line in lines)
    basis = {row["Quantity"]: row["Value"] for row in beside(tmp_path, "basis")}
    assert basis["Held-out levels compared"] == basis["Of these inside the bands"] == "1"
    assert [row["File"] for row in beside(tmp_path, "inputs")] == ["levels.mat"]


def test_a_held_out_level_outside_its_band_does_not_confirm(tmp_path: Path) -> None:
    results = predicted_results.levels()
    every = results["measured"]
    higher = Band(3 * every.damping.low, 3 * every.damping.value, 3 * every.damping.high)
    (line,) = (
        one
        for one in front(page(results | {"measured": replace(every, damping=higher)}, tmp_path))
        if "Held-out" in one
    )
    assert "0 of 1" in line
    del results["measured"]
    assert any("nothing confirms it" in one for one in front(page(results, tmp_path)))


def test_laws_have_their_weights_and_parameters_their_reason(tmp_path: Path) -> None:
    shown = page(CASES["predicted levels"], tmp_path)
    assert any(line.endswith("equal share: power law 55 % and masing 30 %.") for line in front(shown))
    assert [float(row["Weight [%]"]) for row in beside(tmp_path, "laws")] == pytest.approx([55, 30, 10, 5])
    known, unknown = beside(tmp_path, "law_parameters")
    assert known["Identifiable"] == "yes" and known["Meaning"].endswith("slip amplitude of the law, spring 1")
    assert unknown["Identifiable"] == "no" and unknown["Reason"].count(";") == 1


def test_the_response_has_the_columns_and_numbers_of_the_prediction(tmp_path: Path) -> None:
    page(CASES["predicted levels"], tmp_path)
    response = CASES["predicted levels"]["response_2"]
    rows = beside(tmp_path, "response_1.5_N")
    assert [float(row["frequency_Hz"]) for row in rows] == response.frequencies.tolist()
    assert [float(row["up_median"]) for row in rows] == response.up.value.tolist()
    assert [float(row["phase_down_rad"]) for row in rows] == response.phase_down.value.tolist()
    top = int(np.argmax(response.up.value))
    assert float(beside(tmp_path, "peaks")[1]["at f [Hz]"]) == response.frequencies[top]


def test_a_bound_beyond_the_draws_is_open(tmp_path: Path) -> None:
    amplitude, known = Band([9.0], [10.0], [np.inf]), (Band([39.0], [39.5], [40.0]), Band([0.01], [0.02], [0.03]))
    shown = page(ForcedResonances([0.5], amplitude, *known, beyond=[2.0], several=[0.25]), tmp_path)
    (row,) = shown.tables[1][1:]
    assert [cell.replace("\u00a0", " ") for cell in row[:4]] == [
        "0.5",
        "10.0",
        "9.0 to open",
        "2 times the highest in the data",
    ]
    assert row[8] == "25"


def test_conditions_of_a_map(tmp_path: Path) -> None:
    shown = page(CASES["predicted map"], tmp_path)
    rows = beside(tmp_path, "predicted")
    # the map was measured at 5 and 20 N, and at 200 to 1000 N
    first = rows[0]
    assert first["F_E against the data"] == "the lowest in the data over 2.5"
    assert [row["F_N against the data"] for row in rows[:2]] == ["within the data", "2 times the highest in the data"]
    assert [float(first[f"damping_{end}"]) for end in ("low", "value", "high")] == pytest.approx(
        [0.0088, 0.011, 0.0143]
    )
    assert rows[3]["damping_value"] == "" and rows[3]["ζ [%]"] == ""
    assert any("F_N 2000 N (2 times the highest in the data): no resonance" in line for line in front(shown))
    assert [row["Identifiable"] for row in beside(tmp_path, "parameters")] == ["yes", "no"]
    alone = page(CASES["predicted map"]["prediction"], tmp_path)
    assert any("The highest normal force is 2 times the highest measured one." in line for line in front(alone))


def test_locations_beside_the_structure_without_the_beam(tmp_path: Path) -> None:
    shown = page(CASES["predicted locations"], tmp_path)
    there = CASES["predicted locations"]["forecast_2"]
    rows = [row for row in beside(tmp_path, "predicted") if float(row["x_m"]) == 0.2]
    assert len(rows) == there.damping.size
    for row in rows:
        level = there.force_levels.tolist().index(float(row["force_N"]))
        force = there.normal_forces.tolist().index(float(row["normal_force_N"]))
        assert float(row["damping_high"]) == there.damping_high[0, level, force]
        assert float(row["bare_frequency_Hz_value"]) == there.bare_frequencies[0]
        assert row["Beam and location"] == "steel 60 x 50 at (0.200, 0.130) m, 90°"
    assert "The other conditions stand in the table of predicted values." in front(shown)
    assert "F_E and F_N lie within the ranges of the recipe." in front(shown)
    outside = replace(predicted_results.FAR, code="outside-recipe")
    far: Forecast = replace(there, findings=(outside,))
    assert any("outside the ranges of the recipe" in line for line in front(page({"forecast_1": far}, tmp_path)))


@pytest.mark.parametrize("name", ["draws", "prediction", "resonances", "response_1", "surface"])
def test_each_part_alone_has_a_report(tmp_path: Path, name: str) -> None:
    shown = page({name: CASES["predicted levels"][name]}, tmp_path)
    assert "Prediction of mode 1 from" in front(shown)[0] and len(shown.images) == 1 - (name == "resonances")


def test_modes_of_two_names_are_reported_one_after_the_other(tmp_path: Path) -> None:
    at = CASES["predicted levels"]["prediction"]
    shown = page({"a": at, "b": replace(at, name="mode 2")}, tmp_path)
    assert [line.split(" from")[0] for line in front(shown) if line.startswith("Prediction of")] == [
        "Prediction of mode 1",
        "Prediction of mode 2",
    ]
    anchors = re.findall(r' id="([^"]+)"', shown.source)
    assert len(set(anchors)) == len(anchors)
    assert "What the bands contain: mode 2" in shown.source


def test_another_prediction_rests_on_the_levels_that_were_fitted(tmp_path: Path) -> None:
    store.save(tmp_path / "p.h5", predicted_results.levels())
    kept = _kept(tmp_path / "p.h5")
    assert kept is not None and isinstance(kept[1], AmplitudeDraws)
    assert kept[0] is not None and len(kept[0].amplitude) == 4


def test_the_command_draws_a_stored_prediction_in_each_format(tmp_path: Path) -> None:
    docx = pytest.importorskip("docx")
    parts = predicted_results.levels()
    store.save(tmp_path / "p.h5", {name: parts[name] for name in ("mode", "draws", "prediction")})
    done = CliRunner().invoke(app, ["report", str(tmp_path / "p.h5"), "--format", "html,docx", "--language", "de"])
    assert done.exit_code == 0, done.output
    shown = Page(tmp_path / "p.html")
    assert "Vorhersage: mode 1" in shown.source and len(shown.images) == 1
    written = docx.Document(str(tmp_path / "p.docx"))
    texts = [cell.text for table in written.tables for row in table.rows for cell in row.cells]
    assert "das 1.5-Fache des höchsten Werts der Daten" in texts and len(written.inline_shapes) == 1


def test_modes_without_a_prediction_are_no_prediction(tmp_path: Path) -> None:
    with pytest.raises(ema.errors.InputError, match="nothing to report"):
        page({"modes": examples.modal_model()}, tmp_path)
