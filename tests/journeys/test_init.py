"""``ema init``: from files alone to a campaign that passes ``ema check``, with at most three answers."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.cli.beginning import asked
from ema.proposal import propose
from ema.proposal.questions import AT_MOST
from tests.journeys import small_campaign
from tests.journeys.small_campaign import ema_command

ANSWERS = {
    "01_brake_reuss_beam": {},
    # the hammer roved; its sense is opposite to that of the accelerometer at point 4, as the table of positions says
    "02_freefree_beam_roving_hammer": {"moved": "force", "fixed": "4:+Z", "coordinates": "m"},
    "03_raw_hammer_blows": {"count measurements_#.npy": "takes", "units": "unstated, unstated"},
    "04_plate_swept_sine": {"count view_*.hdf5": "takes", "units": "N, m/s^2"},
    "05_steel_subframe_mimo": {"sampling_rate": "1024", "units": "unstated, unstated"},
    "06_uff_variants": {"units": "unstated, unstated"},
    "08_sdof_frfs_with_published_answer": {"units": "unstated, unstated"},
    "09_friction_damper_band_tension": {"force": "none", "units response": "in, kip, in/s, lbf, lbf"},
}
"""What a person who knows the measurement answers: from the description of each set."""


@pytest.mark.parametrize("name", ANSWERS)
def test_a_real_set_needs_at_most_three_answers_and_passes_the_check(name, datasets, tmp_path, capsys) -> None:
    proposal, given = propose(datasets / name), []
    while proposal.questions:
        key = proposal.questions[0].key
        given.append(key)
        proposal = proposal.answered(key, ANSWERS[name][key])
    assert len(given) <= AT_MOST == 3
    assert set(given) == set(ANSWERS[name]), "every answer is one that was asked for"
    options = [part for key, text in ANSWERS[name].items() for part in ("--answer", f"{key}={text}")]
    made = ema_command(capsys, "init", datasets / name, "--output", tmp_path, *options)
    assert made.status == 0, made.err
    assert "not answered" not in made.out
    checked = ema_command(capsys, "check", tmp_path, "--json")
    assert checked.status == 0, checked.err
    assert [one["run"] for one in json.loads(checked.out)["runs"]]


@pytest.mark.parametrize("name", ["07_wing_test_analysis_correlation", "10_tree_structure_shapes"])
def test_a_set_without_a_measurement_is_refused_in_one_sentence(name, datasets, tmp_path, capsys) -> None:
    ended = ema_command(capsys, "init", datasets / name, "--output", tmp_path)
    ended.says(2, "neither records nor FRFs", "mode shapes", "ema compare")
    assert not (tmp_path / "campaign.toml").exists()


def test_what_init_says_of_real_sets_is_true(datasets) -> None:
    """Against the descriptions of the sets, which were not read by the program."""
    kinds = {
        "03_raw_hammer_blows": "hammer",
        "04_plate_swept_sine": "sweep",
        "05_steel_subframe_mimo": "random",
    }
    for name, kind in kinds.items():
        described = propose(datasets / name)
        assert f'kind = "{kind}"' in described.text
    frame = propose(datasets / "05_steel_subframe_mimo").answered("sampling_rate", "1024")
    channels = acquisition.campaign_file.parse(frame.text).channels
    assert [(one.role, one.columns) for one in channels] == [
        ("reference", [1, 2]),
        ("response", list(range(3, 31))),
    ]
    levels = propose(datasets / "01_brake_reuss_beam").text
    assert levels.count("[runs.levels]") == 2 and 'control = "force"' in levels and 'control = "response"' in levels
    beam = propose(datasets / "02_freefree_beam_roving_hammer")
    assert next(one.default for one in beam.questions if one.key == "fixed").startswith("4:")


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Universal files of a hammer test, one for each point, and nothing else."""
    folder = small_campaign.campaign(tmp_path / "written")
    (tmp_path / "files").mkdir()
    for path in (folder / "data").iterdir():
        shutil.copy(path, tmp_path / "files" / path.name)
    return tmp_path / "files"


def test_files_alone_become_the_modes_they_were_made_from(files, capsys) -> None:
    made = ema_command(capsys, "init", files, "--yes")
    assert made.status == 0, made.err
    assert "hammer" in made.out and made.out.splitlines()[-1].startswith("Next: `ema check")
    assert ema_command(capsys, "check", files).status == 0
    fitted = ema_command(capsys, "fit", files, "--band", "5", "250", "--json")
    (modes,) = json.loads(fitted.out).values()
    found = [mode["natural_frequency"] for mode in modes]
    assert found == pytest.approx(small_campaign.FREQUENCIES, rel=1e-3)


def test_a_campaign_that_is_there_stays(files, capsys) -> None:
    (files / "campaign.toml").write_text("mine")
    ema_command(capsys, "init", files, "--yes").says(2, "there is a campaign already", "--force", "--dry-run")
    assert (files / "campaign.toml").read_text() == "mine"
    printed = ema_command(capsys, "init", files, "--dry-run")
    assert printed.out.startswith("# Proposed by `ema init`") and (files / "campaign.toml").read_text() == "mine"
    assert ema_command(capsys, "init", files, "--force", "--yes").status == 0
    assert acquisition.campaign_file.load(files).runs


def test_without_a_terminal_nothing_is_asked_and_the_rest_is_marked(tmp_path, capsys) -> None:
    from scipy.io import savemat

    signals = np.random.default_rng(0).normal(size=(4000, 3))
    savemat(tmp_path / "shaker.mat", {"data": signals})
    made = ema_command(capsys, "init", tmp_path, "--json")
    told = json.loads(made.out)
    assert told["questions"][0] == {
        "key": "sampling_rate",
        "text": "Nothing states the sampling rate of shaker.mat. How many Hz?",
        "default": None,
        "choices": [],
    }
    assert len(told["questions"]) <= 3
    refused = ema_command(capsys, "check", tmp_path)
    assert refused.status == 2 and "TODO" in refused.err


def test_questions_come_one_at_a_time_and_wrong_answers_come_again(tmp_path, capsys) -> None:
    np.save(tmp_path / "take1.npy", np.random.default_rng(0).normal(size=(3, 4000)))
    replies, seen = iter(["-5", "512", "none", "N, moons", ""]), []

    def reply(question) -> str:
        seen.append(question.key)
        return next(replies)

    proposal = asked(propose(tmp_path), reply)
    assert seen[:2] == ["sampling_rate", "sampling_rate"] and proposal.questions == ()
    assert len(dict.fromkeys(seen)) <= 3
    assert "not a sampling rate" in capsys.readouterr().err


def test_a_table_of_positions_is_drawn_and_questioned(files, capsys) -> None:
    (files / "points.csv").write_text("node,x,y,z\n1,0,0,0\n2,300,0,0\n3,600,0,0\n4,900,0,0\n")
    made = ema_command(capsys, "init", files, "--answer", "coordinates=m")
    assert "extent-implausible" in made.out or "were they written in mm?" in made.out
    assert (files / "_build" / "geometry.png").stat().st_size > 5_000
    made = ema_command(capsys, "init", files, "--answer", "coordinates=mm", "--force")
    assert made.status == 0 and "written in" not in made.out
    campaign = acquisition.open_campaign(files)
    assert campaign.geometry is not None and np.ptp(campaign.geometry.xyz) == pytest.approx(0.9)
