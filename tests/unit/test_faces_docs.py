"""The pages on reports, browser and recording: links lead somewhere, commands exist, the rig file is understood."""

import re
import runpy
from pathlib import Path

import pytest
from typer.main import get_command

import acquisition
from acquisition import rig_file
from ema.cli.app import app
from ema.messages import kinds

PAGES = (
    "report.md",
    "browser.md",
    "record.md",
    "coming-from.md",
    "extending.md",
    "getting-started.md",
    "formats.md",
    "files.md",
    "tutorials.md",
    "../README.md",
)


@pytest.fixture(params=PAGES)
def page(request: pytest.FixtureRequest, root: Path) -> Path:
    return root / "docs" / request.param


@pytest.mark.parametrize("name", ["errors.md", "findings.md", "formats.md", "tutorials.md"])
def test_pages_that_are_written_by_the_program_are_not_stale(root: Path, name: str):
    script = runpy.run_path(str(root / "docs" / "write_pages.py"))
    text = (root / "docs" / name).read_text(encoding="utf-8")
    assert text == script["written"](name), "run python docs/write_pages.py"
    expected = {
        "errors.md": ["start `dask scheduler`", "| different quantities share no axis |", "## Modes"],
        "findings.md": [f"`{code}`" for code in kinds()],
        "formats.md": [one.title for one in acquisition.formats()],
        "tutorials.md": [f"Tutorial {n}" for n in range(1, 6)],
    }
    assert all(one in text for one in expected[name])


def test_links_lead_to_files(page: Path):
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    assert links, "every page leads to another one"
    for link in links:
        assert link.startswith("http") or (page.parent / link).exists(), link


def test_commands_and_their_options_exist(page: Path):
    commands = get_command(app).commands
    lines = re.findall(r"`(?:\.venv/bin/)?ema ([^`]+)`", page.read_text(encoding="utf-8"))
    assert lines or page.name in ("extending.md", "files.md"), "these two are about files and code"
    for line in lines:
        name, *words = line.split()
        if name == "|" or name.startswith("-"):
            continue
        assert name in commands, line
        known = {option for parameter in commands[name].params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known, line


def test_the_rig_of_the_page_is_understood(root: Path, tmp_path: Path):
    text, _ = re.findall(r"```toml\n(.*?)```", (root / "docs" / "record.md").read_text(encoding="utf-8"), re.S)
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    rig = rig_file.load(tmp_path)
    assert rig_file.trigger(rig).level == 20.0 and rig_file.trigger(rig).length == 2000
    assert [round(wire.factor, 3) for wire in rig_file.wires(rig)] == [444.444, 98.066, 2000.0]


def test_modules_that_the_pages_name_exist(root: Path):
    text = (root / "docs" / "extending.md").read_text(encoding="utf-8")
    paths = re.findall(r"`((?:acquisition|ema|tests)/[\w/.]+)`", text)
    assert paths
    for path in paths:
        assert (root / path).exists(), path
