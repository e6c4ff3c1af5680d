"""Impacts that the estimate leaves out come back by a word on the command line or in the recipe."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.journeys.small_campaign import HAMMER, campaign, ema_command, records


def with_second_contact():
    """The third impact at point 2 is followed by a second contact of 40 %, with the response to it."""
    changed = list(records())
    signals = changed[1].signals.copy()
    rate = int(changed[1].sampling_rate)
    at, late = int(2.25 * rate), int(0.05 * rate)
    signals[:, at + late :] += 0.4 * (signals[:, at : -late or None])
    changed[1] = replace(changed[1], signals=signals)
    return changed


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("kept") / "four", with_second_contact())


def used(capsys, *arguments):
    ended = ema_command(capsys, "check", *arguments, "--json")
    assert ended.err == ""
    (run,) = json.loads(ended.out)["runs"]
    return run["hits"]["used"], {one["code"]: one for one in run["findings"]}


def test_keep_on_the_command_line_and_in_the_recipe(four, unfitted, tmp_path, capsys):
    left, findings = used(capsys, four)
    assert left in (11, 12)
    assert "second contact of 4" in findings["double-hit"]["message"]
    name = findings["double-hit"]["where"]
    assert "point 2:+Z, impact 2" in name
    assert used(capsys, four, "--keep", "double-hit")[0] == 12
    assert used(capsys, four, "--keep", "2:+Z#2")[0] == 12
    recipe = tmp_path / "recipe.toml"
    recipe.write_text(f'campaign = "{four.as_posix()}"\n[estimate]\nreject = ["2:+Z#0", "2:+Z#2"]\n')
    assert used(capsys, recipe)[0] == 10
    recipe.write_text(f'campaign = "{four.as_posix()}"\n[estimate]\nkeep = ["all"]\n')
    assert used(capsys, recipe)[0] == 12


def test_a_run_without_a_clean_impact_still_ends_with_modes(without_report, tmp_path, capsys):
    """Clipping the force of every impact leaves poles as they are: frequencies stay, and the finding is an error."""
    full_scale = 0.5 * min(record.signals[0].max() for record in records())
    clipped = []
    for record in records():
        signals = record.signals.copy()
        signals[0] = np.clip(signals[0], -full_scale, full_scale)
        clipped.append(replace(record, signals=signals))
    channels = HAMMER.replace('role = "reference"', f'role = "reference"\nrange = "{full_scale:.9g} N"')
    folder = campaign(tmp_path / "clipped", clipped, channels)
    ended = ema_command(capsys, "run", folder, "--output", tmp_path, "--json")
    (run,) = json.loads(ended.out)["runs"]
    assert ended.status == 1, "an error among the findings"
    assert [round(mode["natural_frequency"]) for mode in run["modes"]] == [60, 105, 170]
    (finding,) = [one for one in run["findings"] if one["code"] == "best-effort"]
    assert finding["severity"] == "error" and "overload" in finding["message"]
