"""What scripts read: one JSON document on the output and nothing else; progress only where somebody watches."""

import contextlib
import json
import os
import re
import sys
from pathlib import Path

import pytest

from tests.golden_json import assert_keys
from tests.journeys.small_campaign import COMMAND, campaign, ema_command

CAMPAIGNS = ("freefree_beam", "hammer_blows", "plate_sweep", "sdof", "steel_subframe")


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("json") / "four")


def only_json(ended):
    assert ended.err == ""
    return json.loads(ended.out, parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))


def test_run_and_report(four, undrawn, tmp_path, capsys):
    ended = ema_command(capsys, "run", four, "--output", tmp_path, "--json")
    told = only_json(ended)
    assert_keys("run", told)
    assert ended.status == 0 and [run["run"] for run in told["runs"]] == ["bare"]
    assert [round(mode["natural_frequency"]) for mode in told["runs"][0]["modes"]] == [60, 105, 170]
    first = Path(told["report"]).read_text(encoding="utf-8")
    ended = ema_command(capsys, "report", told["result"], "--output", tmp_path / "again.html", "--json")
    assert only_json(ended) == {"report": str(tmp_path / "again.html")}
    again = (tmp_path / "again.html").read_text(encoding="utf-8")
    words = [re.findall(r"<(?:h\d|td|th)[^>]*>([^<]+)", page) for page in (first, again)]
    assert len(words[0]) > 50 and words[0] == words[1], "the same report from the stored result"


@pytest.mark.parametrize("command", [["check"], ["fit", "--near", "105"]])
def test_check_and_fit(four, capsys, command):
    told = only_json(ema_command(capsys, command[0], four, *command[1:], "--json"))
    assert_keys(command[0], told)
    if command[0] == "check":
        assert told["runs"][0]["hits"] == {"all": 12, "used": 12}
    else:
        assert told["bare"][0]["natural_frequency"] == pytest.approx(105, abs=0.05)


@pytest.mark.parametrize("command", ["formats", "doctor"])
def test_formats_and_doctor(capsys, command):
    told = only_json(ema_command(capsys, command, "--json"))
    assert told
    assert_keys(command, told)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_every_campaign_of_real_measurements_can_be_checked(name, root, datasets, unfitted, capsys, monkeypatch):
    monkeypatch.setenv("EMA_DATASETS", str(datasets))
    ended = ema_command(capsys, "check", root / "datasets" / name, "--json")
    told = only_json(ended)
    assert ended.status == 0
    for run in told["runs"]:
        assert run["outputs"] and run["inputs"] and run["frequency_step"] > 0


def test_signals_of_unknown_excitation_ask_for_it(root, datasets, capsys, monkeypatch):
    monkeypatch.setenv("EMA_DATASETS", str(datasets))
    ended = ema_command(capsys, "check", root / "datasets" / "sdof_raw")
    assert ended.status == 0
    text = " ".join(ended.out.split())
    assert "run case1: nobody stated how the structure was driven" in text
    assert "State kind" in text


@pytest.mark.skipif(sys.platform == "win32", reason="terminals of POSIX")
def test_progress_is_shown_on_a_terminal(four):
    import pty
    import subprocess

    master, terminal = pty.openpty()
    with subprocess.Popen(
        [*COMMAND, "check", str(four), "--json"],
        stdout=subprocess.PIPE,
        stderr=terminal,
        env=os.environ | {"TERM": "xterm", "OMP_NUM_THREADS": "1", "COLUMNS": "120"},
    ) as process:
        os.close(terminal)
        shown = b""
        with contextlib.suppress(OSError):  # how a terminal says that nobody writes any more
            while piece := os.read(master, 65536):
                shown += piece
        assert process.stdout is not None and json.loads(process.stdout.read())
    os.close(master)
    assert process.returncode == 0
    assert b"finding impacts" in shown
