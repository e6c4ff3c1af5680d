"""`ema fit --second-opinion`: another estimator on the same FRFs, and what to make of a disagreement."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema import store
from ema.data import FrfSet
from ema.synthesis import frfs as synthesis
from tests.journeys.small_campaign import DOFS, FREQUENCIES, ema_command, ema_process, truth


def measured(shift: float = 0.0, seed: int = 3) -> FrfSet:
    """FRFs of the small structure with 0.5 % noise; the resonances of half of the points are moved by ``shift``."""
    clean, moved = (
        synthesis(truth(by), np.arange(80, 801) * 0.25, outputs=DOFS, inputs=DOFS[:2]) for by in (0.0, shift)
    )
    values = np.concatenate([clean.values[:, :2], moved.values[:, 2:]], axis=1)
    unit = np.random.default_rng(seed).standard_normal((*values.shape, 2)).view(complex)[..., 0]
    return replace(clean, values=values + 0.005 * np.sqrt(np.mean(np.abs(values) ** 2, axis=0)) * unit)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of two runs: a sound one, and one during which the structure changed."""
    folder = tmp_path_factory.mktemp("opinions")
    runs = "".join(f'[[runs]]\nid = "{name}"\nfiles = "{name}.uff"\nbeam = false\n' for name in ("sound", "changed"))
    (folder / "campaign.toml").write_text('[campaign]\nname = "Two runs"\n' + runs)
    acquisition.write(folder / "sound.uff", measured(), binary=True)
    acquisition.write(folder / "changed.uff", measured(0.012), binary=True)
    return folder


def test_from_a_shell_on_a_file(campaign: Path):
    ended = ema_process("fit", campaign / "sound.uff", "--second-opinion", "--limit", "warning")
    assert ended.status == 0, ended.err or ended.out
    lines = ended.out.splitlines()
    title = next(line for line in lines if "second opinion (ERA)" in line)
    assert "differences in combined standard deviations s, limit 2." in title
    rows = [line.split("│")[1:-1] for line in lines[lines.index(title) :] if line.startswith("│")]
    assert [float(row[1]) for row in rows] == pytest.approx(FREQUENCIES, rel=1e-3)
    assert [float(row[2]) for row in rows] == pytest.approx(FREQUENCIES, rel=1e-3)
    assert [row[-1].strip() for row in rows] == ["yes"] * 3
    assert "second-opinion" not in ended.err


def test_on_one_run_of_a_campaign_as_json(campaign: Path, capsys: pytest.CaptureFixture[str]):
    told = json.loads(ema_command(capsys, "fit", campaign, "--run", "sound", "--second-opinion", "--json").out)
    assert list(told) == ["sound"]
    opinion = told["sound"]["second opinion"]
    assert [mode["agrees"] for mode in opinion["modes"]] == [True] * 3
    assert opinion["findings"] == []
    assert max(abs(mode["damping_difference"]) for mode in opinion["modes"]) < opinion["limit"]


def test_a_disagreement_is_a_finding_and_reaches_status_and_file(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    written = tmp_path / "modes.h5"
    ended = ema_command(
        capsys,
        "fit",
        campaign,
        "--run",
        "changed",
        "--near",
        60,
        "--near",
        105,
        "--near",
        170,
        "--second-opinion",
        "--limit",
        "warning",
        "--output",
        written,
    )
    assert ended.status == 1, "warnings above the limit"
    rows = [line.split("│")[1:-1] for line in ended.out.split("second opinion (ERA)")[1].splitlines() if "│" in line]
    assert "no" in [row[-1].strip() for row in rows]
    assert "warning: " in ended.out and "second estimator" in ended.out
    codes = {finding.code for finding in store.load(written)["changed"].findings}
    assert codes & {"second-opinion-differs", "second-opinion-splits", "second-opinion-missing"}
    quiet = ema_command(capsys, "fit", campaign, "--run", "changed", "--second-opinion")
    assert quiet.status == 0, "a disagreement is no failure unless a limit is asked for"


def test_an_axis_that_era_cannot_use_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    whole = measured()
    uneven = whole.lines(np.sort(np.random.default_rng(1).permutation(721)[:200]))
    acquisition.write(tmp_path / "uneven.uff", uneven, binary=True)
    ended = ema_command(capsys, "fit", tmp_path / "uneven.uff", "--second-opinion")
    ended.says(2, "evenly spaced")
