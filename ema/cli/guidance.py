"""``ema`` alone: what to do next in this folder."""

import tomllib
from pathlib import Path

from ema.cli.ending import FINE, ends_well

MOST_FILES = 2000
"""Files that are looked at; a home folder with more is not searched for measurements."""

_START = """Experimental modal analysis where joints and friction matter.

  ema demo            the main job on a virtual work table, to see what comes out
  ema init FOLDER     begin with your own files
  ema doctor          what works on this machine

All commands: ema --help"""


@ends_well
def alone() -> int:
    """Say what to do next in the working directory."""
    print(next_steps(Path.cwd()))
    return FINE


def next_steps(folder: Path) -> str:
    """Return what to do next in a folder, by what lies in it.

    Parameters
    ----------
    folder : Path
        The working directory.

    Returns
    -------
    str
        A few lines: what was found, and commands to paste, the next one first.
    """
    results = _results(folder)
    if (folder / "campaign.toml").is_file():
        return _of_campaign(folder, results)
    if recipes := _recipes(folder):
        lines = ["Recipes in this folder:"]
        lines += [f"  ema run {_quoted(path.relative_to(folder))}" for path in recipes[:8]]
        return _joined(lines, results)
    if (folder / "rig.toml").is_file():
        return _joined(["A measuring system is described here (rig.toml).", "  ema record .        measure"], results)
    if campaigns := sorted(path.parent for path in folder.glob("*/campaign.toml")):
        lines = [f"{len(campaigns)} campaigns below this folder; the first:"]
        lines += [f"  ema check {_quoted(campaigns[0].relative_to(folder))}"]
        return _joined(lines, results)
    count = _measurements(folder)
    if count:
        files = "file that could be a measurement" if count == 1 else "files that could be measurements"
        return _joined(
            [
                f"{count} {files}, and no campaign.toml.",
                "  ema init .          propose one, with at most three questions",
            ],
            results,
        )
    return _joined([_START], results) if results else _START


def _of_campaign(folder: Path, results: list[Path]) -> str:
    if "TODO" in _text(folder / "campaign.toml"):
        lines = ["A campaign with open questions: look for TODO in campaign.toml, then"]
    else:
        lines = ["A campaign is described here."]
    lines.append("  ema check .         what was measured, and what is wrong with it")
    lines.append("  ema run .           everything, from signals to the report")
    lines.append("  ema app .           in the browser")
    return _joined(lines, results)


def _joined(lines: list[str], found: list[Path]) -> str:
    if found:
        newest = max(found, key=lambda path: path.stat().st_mtime)
        lines = [*lines, f"Newest result: {newest}", f"  ema app {_quoted(newest)}"]
    return "\n".join([*lines, ""] if lines[-1] == _START else [*lines, "", "All commands: ema --help"]).rstrip()


def _results(folder: Path) -> list[Path]:
    """Results of studies in the places where `ema run` writes them."""
    return [path for place in ("_build", "reports/_build") for path in (folder / place).glob("*.h5")]


def _recipes(folder: Path) -> list[Path]:
    """TOML files that name a campaign, here and in ``reports``."""
    recipes = []
    for path in [*sorted(folder.glob("*.toml")), *sorted((folder / "reports").glob("*.toml"))]:
        if path.name in ("campaign.toml", "rig.toml", "model.toml", "pyproject.toml"):
            continue
        try:
            document = tomllib.loads(_text(path))
        except tomllib.TOMLDecodeError:
            continue
        if isinstance(document.get("campaign"), str):
            recipes.append(path)
    return recipes


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _measurements(folder: Path) -> int:
    """How many files have the suffix of a format that holds measurements."""
    import acquisition

    suffixes = {suffix for one in acquisition.formats() for suffix in one.suffixes} - {".txt", ".json", ".asc", ".dat"}
    count = 0
    for number, path in enumerate(folder.rglob("*")):
        if number >= MOST_FILES:
            break
        hidden = any(part.startswith((".", "_")) for part in path.relative_to(folder).parts)
        name = path.name.removesuffix(".gz")
        count += path.is_file() and not hidden and Path(name).suffix.lower() in suffixes
    return count


def _quoted(path: Path) -> str:
    text = str(path)
    return f'"{text}"' if " " in text else text
