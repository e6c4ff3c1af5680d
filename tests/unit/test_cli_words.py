"""What the command line says of itself: whole help texts, one name for one option, the next step in a folder."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from ema.cli import FORMER_OPTIONS, checking, guidance, screen
from ema.cli.app import app
from ema.errors import InputError
from ema.examples import campaign, recording
from ema.study import recipe

COMMANDS = typer.main.get_command(app)


def leaves(command: Any, path: tuple[str, ...] = ()) -> list[tuple[tuple[str, ...], Any]]:
    if hasattr(command, "commands"):
        return [leaf for name, inner in command.commands.items() for leaf in leaves(inner, (*path, name))]
    return [(path, command)]


LEAVES = leaves(COMMANDS)


@pytest.mark.parametrize(("path", "command"), LEAVES, ids=[" ".join(path) for path, _ in LEAVES])
def test_no_word_of_a_help_text_vanishes(path, command) -> None:
    """Markup took ``[[map]]`` and ``[maps/NAME]`` for styles and printed nothing in their place."""
    shown = "".join(CliRunner().invoke(app, [*path, "--help"]).output.split())
    for parameter in command.params:
        text = getattr(parameter, "help", None) or ""
        assert "".join(text.split()) in shown, f"{text!r} is not in the help of {path}"


def test_what_is_written_goes_to_output_everywhere() -> None:
    names = {option for _, command in LEAVES for one in command.params for option in one.opts}
    assert len(LEAVES) > 15 and "--output" in names and not names & FORMER_OPTIONS.keys()
    for path, command in LEAVES:
        short = [one.opts for one in command.params if "-o" in one.opts]
        assert all("--output" in opts for opts in short), path


def test_a_former_option_still_works_and_says_its_present_name(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text("[nothing]\n")
    done = subprocess.run(
        [sys.executable, "-m", "ema", "snapback", str(tmp_path), f"--out={tmp_path / 'out'}"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 2 and "No such option" not in done.stderr
    assert done.stderr.startswith("ema: --out is called --output now")


@pytest.mark.parametrize(
    ("files", "first"),
    [
        ({}, "ema demo"),
        ({"campaign.toml": "[campaign]\n"}, "ema check ."),
        ({"campaign.toml": "# TODO: the unit\n"}, "look for TODO"),
        ({"study.toml": 'campaign = "data"\n', "data/campaign.toml": ""}, "ema run study.toml"),
        ({"reports/a b.toml": 'campaign = "data"\n'}, 'ema run "reports'),
        ({"rig.toml": ""}, "ema record ."),
        ({"data/campaign.toml": ""}, "ema check data"),
        ({"point1.uff": "", "deep/point2.unv.gz": "", "notes.txt": ""}, "2 files that could be measurements"),
        ({"campaign.toml": "", "_build/campaign.h5": ""}, "Newest result"),
    ],
)
def test_alone_it_says_what_to_do_next_in_this_folder(tmp_path: Path, files: dict[str, str], first: str) -> None:
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    said = guidance.next_steps(tmp_path)
    assert first in said and said.endswith("All commands: ema --help")


def test_the_command_alone_ends_well(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "ema"], capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0 and "ema demo" in done.stdout and done.stderr == ""


def test_all_mistakes_of_a_recipe_are_told_at_once_with_their_lines() -> None:
    text = """campaign = "data"
titel = "A"

[fit]
band = [500, 200]

[estimate]
blok = 4096

[[map]]
near = -3
"""
    with pytest.raises(InputError) as raised:
        recipe.parse(text, "recipe.toml")
    lines = str(raised.value).splitlines()
    assert lines[0] == "recipe.toml: 4 mistakes"
    starts = ["  line 2: unknown key 'titel'", "  line 4: fit", "  line 8: unknown key 'blok'", "  line 11: map.0.near"]
    assert all(any(line.startswith(start) for line in lines) for start in starts)
    numbers = [int(line.split(":")[0].split()[1]) for line in lines[1:]]
    assert numbers == sorted(numbers) and len(numbers) == 4
    assert "did you mean title?" in lines[1]


def test_one_mistake_is_one_sentence() -> None:
    with pytest.raises(InputError, match=r"^recipe.toml, line 2: unknown key 'titel'; did you mean title\?$"):
        recipe.parse('campaign = "data"\ntitel = "A"\n', "recipe.toml")


@pytest.mark.parametrize("name", ["acc [m]", "acc [/1]", ":warning: 2"])
def test_names_are_printed_as_they_are(name, capsys):
    """Markup took ``[m]`` for a style, ``[/1]`` for the end of one, and ``:warning:`` for a sign."""
    channel = replace(recording().channels[0], name=name)
    checking.show(screen.console(), replace(campaign(), channels=(channel,)), [])
    screen.console().print(f"{name}, controlled: force")
    shown = capsys.readouterr().out
    assert name in shown and f"{name}, controlled: force" in shown
