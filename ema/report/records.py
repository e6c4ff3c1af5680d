"""What was repaired, and where the results came from."""

from collections.abc import Sequence
from dataclasses import replace

from ema.data import Provenance, StudyResult
from ema.messages import text
from ema.report.blocks import Block, Book, Section, Text


def repairs(result: StudyResult, book: Book) -> Section:
    """Corrections of metadata: what, where, by whom and why."""
    return Section(text("Repairs"), "repairs", _repairs(result, book))


def provenance(result: StudyResult, book: Book) -> Section:
    """Files, versions, settings and steps behind the results."""
    return Section(text("Provenance"), "provenance", _provenance(result, book))


def _repairs(result: StudyResult, book: Book) -> list[Block]:
    repairs = dict.fromkeys([*result.repairs, *(repair for run in result.runs for repair in run.run.repairs)])
    if not repairs:
        return [Text(text("No metadata was repaired."))]
    rows = [(repair.what, repair.where, repair.who, repair.why) for repair in repairs]
    caption = text("Repairs of metadata; the raw data were not touched.")
    return [book.table("repairs", caption, (text("What"), text("Where"), text("Who"), text("Why")), rows)]


def _provenance(result: StudyResult, book: Book) -> list[Block]:
    own = result.provenance
    inputs = dict.fromkeys([*result.campaign.inputs, *own.inputs])
    for run in result.runs:
        inputs |= dict.fromkeys([*run.frfs.provenance.inputs, *run.modes.provenance.inputs])
    options = _settings(text("FRFs"), {run.run.id: run.frfs.provenance.options for run in result.runs})
    # Modes carry the settings of their FRFs with them.
    options += _settings(
        text("fit"),
        {
            run.run.id: tuple(each for each in run.modes.provenance.options if each not in run.frfs.provenance.options)
            for run in result.runs
        },
    )
    return provenance_blocks(replace(own, inputs=tuple(inputs)), book, text("study"), options)


def provenance_blocks(
    own: Provenance, book: Book, what: str = "", options: Sequence[tuple[str, str, str]] = ()
) -> list[Block]:
    """Files, versions, settings and steps of one provenance.

    Parameters
    ----------
    own : Provenance
        The provenance.
    book : Book
        Numbers the tables.
    what : str, optional
        What its settings are of; by default the command.
    options : sequence of (str, str, str), optional
        Further settings: of what, name and value.

    Returns
    -------
    list of Block
        Tables and sentences, or one sentence that nothing was recorded.
    """
    blocks: list[Block] = []
    if own.inputs:
        blocks.append(book.table("inputs", text("Files read."), (text("File"), "SHA-256"), own.inputs))
    if own.versions:
        blocks.append(book.table("versions", text("Software."), (text("Package"), text("Version")), own.versions))
    rows = [(what or text("command"), *option) for option in own.options] + list(options)
    if rows:
        blocks.append(
            book.table(
                "options",
                text("Settings, defaults included."),
                (text("Where"), text("Setting"), text("Value")),
                rows,
            )
        )
    blocks += [Text(text("Steps: {steps}.", steps=" → ".join(own.steps)))] if own.steps else []
    blocks += [Text(text("Computed {moment}.", moment=_moment(own)))] if own.created else []
    return blocks or [Text(text("No provenance was recorded."), missing=True)]


def _settings(what: str, of_runs: dict[str, tuple[tuple[str, str], ...]]) -> list[tuple[str, str, str]]:
    """Rows of the table of settings: those of all runs once, the others by run."""
    common = [option for option in next(iter(of_runs.values()), ()) if all(option in each for each in of_runs.values())]
    everywhere = text("all runs, {what}", what=what) if len(of_runs) > 1 else f"{next(iter(of_runs), '')}, {what}"
    rows = [(everywhere, *option) for option in dict.fromkeys(common)]
    for run, options in of_runs.items():
        rows += [(f"{run}, {what}", *option) for option in options if option not in common]
    return rows


def _moment(own: Provenance) -> str:
    return own.created.strftime("%Y-%m-%d %H:%M %Z").strip() if own.created else ""
