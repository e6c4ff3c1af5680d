"""The page on many campaigns: its commands and its Python run as they stand, its findings are those there are."""

import re
import shlex
from pathlib import Path

import pytest

from tests.bench import archive_campaigns as generated
from tests.journeys.small_campaign import ema_command

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "archive.md").read_text(encoding="utf-8")


def test_the_tutorial_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EMA_CACHE", str(tmp_path / "cache"))
    for number in range(8):
        generated.write(tmp_path / "campaigns" / f"c{number}", number, 7, 118)
    commands = re.findall(r"```sh\n(.*?)```", TEXT, re.DOTALL)
    assert len(commands) == 6
    told = {}
    for line in commands:
        first, *words = shlex.split(line)
        assert first == "ema"
        told[line] = ema_command(capsys, *words)
        assert told[line].status == 0, told[line].err
    assert "8 new" in next(iter(told.values())).out and "8 unchanged" in told[commands[4]].out
    truth = [generated.truth(campaign, run, 118) for campaign in range(8) for run in range(7)]
    wanted = [one for one in truth if one.normal_force in (100.0, 200.0, 300.0) and one.date >= "2017"]
    assert f"{len(wanted)} modes in 8 campaigns with 56 runs" in told[commands[1]].out
    assert (tmp_path / "damping.png").stat().st_size > 10_000 and (tmp_path / "bare.csv").is_file()
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL):
        exec(compile(block, "docs/archive.md", "exec"), names)
    assert len(names["table"]) == 3 * 8


def test_the_findings_of_the_page_are_those_of_the_code() -> None:
    code = "".join((ROOT / "ema" / "archive" / f"{name}.py").read_text() for name in ("finding", "cache", "adding"))
    listed = set(re.findall(r"^\| `([a-z-]+)` \|", TEXT, re.MULTILINE))
    assert listed == set(re.findall(r'"((?:campaign|part|not|analysed|no|two)-[a-z-]+)"', code))


def test_options_of_the_page_exist(capsys) -> None:
    from typer.main import get_command

    from ema.cli.archiving import app

    known = {option for command in get_command(app).commands.values() for one in command.params for option in one.opts}
    assert set(re.findall(r"--[a-z][a-z-]+", TEXT)) - {"--resume"} <= known
