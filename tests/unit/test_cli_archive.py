"""`ema archive`: from finished studies to answers and pictures, and sentences where that cannot be."""

import csv
import json
import shutil
from pathlib import Path

import pytest

from ema import store
from tests.bench import archive_campaigns as generated
from tests.journeys.small_campaign import ema_command

SEED = 41177


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def campaigns(tmp_path: Path) -> Path:
    for number in range(3):
        generated.write(tmp_path / "tests" / f"20{number}" / f"c{number}", number, 7, SEED)
    return tmp_path / "tests"


def test_a_study_that_was_run_is_found_with_its_modes(
    small_study: Path, analysed_once, without_report, tmp_path, capsys
) -> None:
    archive = tmp_path / "archive"
    assert ema_command(capsys, "run", small_study, "--json").status in (0, 1)
    added = ema_command(capsys, "archive", "add", archive, small_study)
    assert added.status == 0 and "1 new, 0 changed, 0 moved, 0 unchanged; 2 runs" in added.out
    told = json.loads(
        ema_command(capsys, "archive", "find", archive, "--frequency", "300 Hz", "0.35 kHz", "--json").out
    )
    kept = store.load(small_study.parent / "_build" / "recipe.h5")
    truth = [one.modes for one in kept.runs]
    assert [row["run"] for row in told["modes"]] == ["first", "second"]
    for row, modes in zip(told["modes"], truth, strict=True):
        assert row["frequency"] == modes.natural_frequencies[2] and row["damping"] == modes.damping_ratios[2]
        half = 1.959964 * modes.covariance[2, 1, 1] ** 0.5
        assert row["damping_high"] - row["damping"] == pytest.approx(half, rel=1e-9)
        assert row["normal_force"] is None and row["date"] == "" and row["kind"] == "hammer"


def test_a_campaign_that_was_never_run_is_named(small_study: Path, tmp_path: Path, capsys) -> None:
    added = ema_command(capsys, "archive", "add", tmp_path / "archive", small_study.parent / "campaign")
    assert added.status == 0 and "2 of 2 runs not analysed: indexed without modes (first, second)" in added.out
    told = ema_command(capsys, "archive", "find", tmp_path / "archive")
    assert "0 modes in 1 campaigns with 2 runs" in told.out and "not analysed" in told.out


def test_a_folder_of_campaigns_is_searched_and_all_are_added_again_without_arguments(campaigns, tmp_path, capsys):
    archive = tmp_path / "archive"
    assert "3 new" in ema_command(capsys, "archive", "add", archive, campaigns).out
    assert "3 unchanged; 21 runs" in ema_command(capsys, "archive", "add", archive).out
    assert "0 new" in ema_command(capsys, "archive", "add", tmp_path / "other", archive).out
    one, two = (
        json.loads(ema_command(capsys, "archive", "find", folder, "--json").out)
        for folder in (archive, tmp_path / "other")
    )
    assert one == two and len(one["modes"]) == 3 * 7 * 6


def test_a_renamed_folder_keeps_its_results(campaigns: Path, tmp_path: Path, capsys) -> None:
    ema_command(capsys, "archive", "add", tmp_path / "archive", campaigns)
    shutil.move(campaigns / "201" / "c1", campaigns / "201" / "table, first test")
    assert "1 campaign (campaign 00001" in ema_command(capsys, "archive", "find", tmp_path / "archive").out
    told = ema_command(capsys, "archive", "add", tmp_path / "archive", campaigns / "201" / "table, first test")
    assert "0 new, 0 changed, 1 moved" in told.out and "not analysed" not in told.out


def test_conditions_have_units_and_the_table_and_csv_hold_the_modes(campaigns: Path, tmp_path: Path, capsys) -> None:
    archive = tmp_path / "archive"
    ema_command(capsys, "archive", "add", archive, campaigns)
    asked = ("--normal-force", "100 N", "0.3 kN", "--frequency", "490 Hz", "510 Hz", "--damping", "1 %", "3 %")
    told = ema_command(
        capsys, "archive", "find", archive, *asked, "--since", "2001-01-01", "--output", tmp_path / "a.csv"
    )
    truth = [generated.truth(campaign, run, SEED) for campaign in range(3) for run in (2, 3, 4)]
    assert f"{len(truth)} modes in 3 campaigns with 21 runs" in told.out
    with (tmp_path / "a.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = {(row["campaign"], row["run"]): float(row["frequency"]) for row in rows}
    assert found == {(one.campaign, one.run): pytest.approx(one.frequencies[3]) for one in truth}


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_picture_is_written(campaigns: Path, tmp_path: Path, capsys, suffix: str) -> None:
    ema_command(capsys, "archive", "add", tmp_path / "archive", campaigns)
    path = tmp_path / f"damping.{suffix}"
    told = ema_command(capsys, "archive", "trend", tmp_path / "archive", "--frequency", "490 Hz", "510 Hz", "-o", path)
    assert told.status == 0 and f"Written: {path}" in told.out.replace("\n", "") and path.stat().st_size > 5000


def test_bad_input_is_one_sentence(campaigns: Path, tmp_path: Path, capsys) -> None:
    archive = tmp_path / "archive"
    ema_command(capsys, "archive", "add", archive, campaigns)
    (tmp_path / "nothing").mkdir()
    (tmp_path / "modes.uff").write_text("")
    for arguments, parts in (
        (("find", tmp_path / "nothing"), ("there is no archive here", "ema archive add")),
        (("find", archive, "--frequency", "490", "510"), ("--frequency", "a number without a unit")),
        (("find", archive, "--normal-force", "1 Hz", "2 Hz"), ("--normal-force", "not a force")),
        (("find", archive, "--normal-force", "300 N", "100 N"), ("lowest normal force", "300 and 100")),
        (("find", archive, "--damping", "low", "high"), ("--damping", "not a damping ratio")),
        (("find", archive, "--since", "last year"), ("--since", "a day such as")),
        (("trend", archive, "-o", tmp_path / "a.xyz"), ("not a picture", ".png")),
        (("add", archive, tmp_path / "absent"), ("no such file or folder",)),
        (("add", archive, tmp_path / "nothing"), ("no campaign in this folder",)),
        (("add", archive, tmp_path / "modes.uff"), ("is no campaign",)),
    ):
        ema_command(capsys, "archive", *arguments).says(2, *parts)


def test_a_wrong_campaign_is_named_and_the_others_are_added(campaigns: Path, tmp_path: Path, capsys) -> None:
    (campaigns / "201" / "c1" / "campaign.toml").write_text("[campaign]\nnam = 1\n")
    told = ema_command(capsys, "archive", "add", tmp_path / "archive", campaigns)
    assert told.status == 1 and "2 new" in told.out and "it was not indexed" in told.out
