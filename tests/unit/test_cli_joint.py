"""`ema joint` writes pictures, a report and its tables as its neighbours do, whole or not at all."""

import json
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ema.cli.app import app
from ema.compare import joint_law

TEXT = """
title = "Table in hall 3"
[bare]
frequency = "312.4 Hz"
damping = "0.5 %"
[[hammer]]
sentence = "2 kN: 318 Hz, 0.6 %"
normal_force = "2 kN"
frequency = "318 Hz"
damping = "0.6 %"
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    folder = tmp_path / "hall_3"
    folder.mkdir()
    (folder / "joint.toml").write_text(TEXT, encoding="utf-8")
    return folder


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two short runs: what is written is looked at, not how right it is."""
    monkeypatch.setattr(joint_law, "posteriors", partial(joint_law.posteriors, runs=2, draws=40))


@pytest.fixture
def no_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever draws has not looked at the options first."""

    def never(*given: object) -> None:
        raise AssertionError("draws before the options were checked")

    monkeypatch.setattr(joint_law, "posteriors", never)


def call(*words: object):
    return CliRunner().invoke(app, ["joint", *map(str, words)])


@pytest.mark.usefixtures("few_draws")
def test_everything_is_written_and_listed(table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = call(table, "--json", "--language", "de")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    folder = Path("joints") / "hall_3"
    names = {"joint.html"}
    names |= {
        f"{stem}.{end}"
        for stem in ("joint_statements", "joint_parameters", "hammer_readings")
        for end in ("svg", "png")
    }
    assert {Path(path).name for path in printed["written"]} == names
    assert {path.name for path in folder.iterdir()} == names | {"joint_tables"}
    assert all(Path(path).stat().st_size > 500 for path in printed["written"])
    assert "Aussagen, und was alle anderen vorhersagen" in (folder / "joint.html").read_text(encoding="utf-8")
    # the file is named by itself or by its folder, and what an earlier call wrote is replaced
    again = call(table / "joint.toml", "--seed", 1)
    assert again.exit_code == 0 and "Statements, and what all others" in (folder / "joint.html").read_text(
        encoding="utf-8"
    )
    assert "joint.html" in again.output and "What was said" in again.output


@pytest.mark.usefixtures("no_draws")
def test_a_file_in_place_of_the_folder_is_refused_before_any_draw(table: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    done = call(table, "--output", tmp_path / "out")
    assert done.exit_code == 3 and "the folder for the results cannot be used" in done.stderr
    assert "choose another one with --output" in done.stderr and (tmp_path / "out").read_text() == "mine"


@pytest.mark.usefixtures("no_draws")
@pytest.mark.parametrize(
    ("words", "said"), [(("--format", "odt"), "odt"), (("--language", "xx"), "xx"), (("--limit", "grave"), "grave")]
)
def test_wrong_options_are_refused_before_any_draw(table: Path, tmp_path: Path, words, said) -> None:
    done = call(table, "--output", tmp_path / "out", *words)
    assert done.exit_code == 2 and said in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("few_draws")
def test_a_folder_with_the_name_of_the_report_is_said(table: Path, tmp_path: Path) -> None:
    (tmp_path / "out" / "joint.html").mkdir(parents=True)
    done = call(table, "--output", tmp_path / "out")
    assert done.exit_code == 3 and "a folder has its name" in done.stderr


@pytest.mark.usefixtures("no_draws")
def test_no_statements_no_folder(tmp_path: Path) -> None:
    done = call(tmp_path, "--output", tmp_path / "out")
    assert done.exit_code == 2 and "there are no statements here" in done.stderr and not (tmp_path / "out").exists()
