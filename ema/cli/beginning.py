"""``ema init``: from a folder of measurements to its ``campaign.toml``, with few questions."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ema.cli.common import Json
from ema.cli.ending import FINE, ends_well
from ema.errors import FailureError, InputError

if TYPE_CHECKING:
    from ema.proposal import Proposal, Question

PICTURE = "_build/geometry.png"
"""Where the geometry is drawn, below the folder of the campaign file."""


@ends_well
def init(
    folder: Annotated[Path, typer.Argument(help="Folder with the files of the measurement.")] = Path(),
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for campaign.toml; by default beside the files.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: write what is certain.")] = False,
    answer: Annotated[
        list[str] | None,
        typer.Option("--answer", help="An answer, KEY=TEXT (may be repeated); --json lists the keys."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a campaign.toml that is there.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the file instead of writing it.")] = False,
    json: Json = False,
) -> int:
    """Propose the campaign.toml of a folder: runs, channels, units, geometry; asks what the files do not say."""
    from ema.cli import screen
    from ema.proposal import propose

    target = (output or folder) / "campaign.toml"
    if target.exists() and not (force or dry_run):
        raise InputError(
            "there is a campaign already", where=str(target), advice="--force replaces it, --dry-run prints a proposal"
        )
    with screen.Bars() as bars:
        proposal = propose(folder, bars)
    for text in answer or []:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError("not an answer", got=text, expected="KEY=TEXT")
        proposal = proposal.answered(key.strip(), value)
    # without a terminal nobody can answer, and nothing may hang
    if not (yes or json or dry_run) and sys.stdin.isatty():
        proposal = asked(proposal, _prompted)
    picture = None
    if not dry_run:
        _write(target, _text(proposal, folder, target))
        picture = _drawn(proposal, target.parent / PICTURE)
    if json:
        screen.as_json(_mapping(proposal, target, picture, written=not dry_run))
    elif dry_run:
        print(_text(proposal, folder, target), end="")
    else:
        _show(proposal, target, picture)
    return FINE


def asked(proposal: "Proposal", ask: "Callable[[Question], str]") -> "Proposal":
    """Ask what is open, one question at a time, until nothing is; a wrong answer is explained and asked again."""
    while proposal.questions:
        question = proposal.questions[0]
        try:
            proposal = proposal.answered(question.key, ask(question))
        except InputError as error:
            print(f"ema: {error}", file=sys.stderr)
    return proposal


def _prompted(question: "Question") -> str:
    if question.evidence:
        print(f"  ({question.evidence})")
    default = question.default or None
    return str(typer.prompt(question.text, default=default, show_default=default is not None))


def _text(proposal: "Proposal", folder: Path, target: Path) -> str:
    """The file; where it is written elsewhere, it names the folder of the data."""
    if target.parent.resolve() == folder.resolve():
        return proposal.text
    from ema.proposal.toml_text import value_text

    try:
        files = Path(os.path.relpath(folder.resolve(), target.parent.resolve())).as_posix()
    except ValueError:  # another drive
        files = folder.resolve().as_posix()
    head, name, rest = proposal.text.partition("[campaign]\n")
    return f"{head}{name}files = {value_text(files)}\n{rest}"


def _write(target: Path, text: str) -> None:
    from ema import store

    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FailureError(
            "the folder cannot be made",
            where=str(target.parent),
            got=error.strerror,
            advice="choose another one with --output",
        ) from error
    with store.replacing(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _drawn(proposal: "Proposal", path: Path) -> Path | None:
    """A picture of the geometry, where there is one."""
    if proposal.geometry is None:
        return None
    from ema import show, store
    from ema.study.study import make_folder

    make_folder(path.parent)
    figure = show.geometry(proposal.geometry, proposal.responses, proposal.references)
    with store.replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=150)
    return path


def _mapping(proposal: "Proposal", target: Path, picture: Path | None, *, written: bool) -> dict[str, Any]:
    from ema.study.plain import finding

    return {
        "campaign": str(target) if written else None,
        "text": proposal.text,
        "questions": [
            {"key": one.key, "text": one.text, "default": one.default or None, "choices": list(one.choices)}
            for one in proposal.questions
        ],
        "answers": dict(proposal.answers),
        "findings": [finding(one) for one in proposal.findings],
        "left out": [{"file": path, "reason": reason} for path, reason in proposal.left_out],
        "picture": None if picture is None else str(picture),
    }


def _show(proposal: "Proposal", target: Path, picture: Path | None) -> None:

    from ema.cli import screen

    out = screen.console()
    out.print(proposal.summary, soft_wrap=True)
    screen.show_findings(out, proposal.findings)
    if proposal.left_out:
        count = len(proposal.left_out)
        out.print(f"{count} file{'s' if count > 1 else ''} left out; the file says which, and why.")
    for question in proposal.questions:
        assumed = f"assumed {question.default}" if question.default else "needed before anything can be computed"
        out.print(f"not answered: {question.text} ({assumed}; --answer '{question.key}=...')", soft_wrap=True)
    if picture is not None:
        out.print(f"Geometry: {picture}", soft_wrap=True)
    screen.show_written(out, [target])
    out.print(f"Next: `ema check {target.parent}` says what was measured and what is wrong with it.", soft_wrap=True)
