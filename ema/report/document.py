"""The whole report as words, tables and pictures: what every format says, whatever it looks like."""

from dataclasses import dataclass, field

from ema.data import StudyResult
from ema.report.blocks import Block, Book, Section, Table
from ema.report.comparison import comparisons
from ema.report.expected import counted_expectations, expectation_table
from ema.report.maps import map_lines, map_sections, statement_lines, statements
from ema.report.modes import mode_table, run_sentence
from ema.report.photos import photos
from ema.report.records import provenance, repairs
from ema.report.runs import run_sections
from ema.report.worries import Group, all_findings, counted, finding_table, grouped


@dataclass(frozen=True)
class Chapter:
    """A part of the report behind its front page."""

    title: str
    anchor: str
    blocks: list[Block] = field(default_factory=list)
    sections: list[Section] = field(default_factory=list)


@dataclass(frozen=True)
class Document:
    """The front page, with the answer first, and the chapters behind it."""

    title: str
    facts: list[tuple[str, str]]
    comment: str
    photos: list[Block]
    summary: list[str]
    answers: list[Section]
    worries: list[Group]
    findings: Table | None
    expectations: Table | None
    chapters: list[Chapter]


def compose(result: StudyResult, book: Book) -> Document:
    """Everything that a report of ``result`` says, in the order in which it is read."""
    campaign = result.campaign
    runs = list(result.runs)
    modes = [mode_table(run, book) for run in runs]
    told, compared = comparisons(runs, book)
    worries = grouped(all_findings(result))
    answers = [Section("Modes", "modes", modes)]
    answers += [Section("Runs compared", "comparison", compared)] if compared else []
    facts = {
        "Structure": campaign.structure, "Campaign": campaign.name, "Operator": campaign.operator,
        "Date": campaign.date,
    }  # fmt: skip
    answers += statements(result, book) + map_sections(result, book)
    # tables and figures are numbered in the order in which they are made, so the order of these lines is the reader's
    findings, expectations = finding_table(worries, book), expectation_table(result, book)
    repaired = repairs(result, book)
    chapters = [Chapter(repaired.title, repaired.anchor, repaired.blocks)]
    for number, run in enumerate(runs, 1):
        sections = run_sections(run, campaign.geometry, number, book)
        chapters.append(Chapter(f"Run {run.run.id}", f"run-{number}", sections=sections))
    origin = provenance(result, book)
    chapters.append(Chapter(origin.title, origin.anchor, origin.blocks))
    return Document(
        title=result.title or campaign.name,
        facts=[(label, value or "not stated") for label, value in facts.items()],
        comment=campaign.comment,
        photos=photos(campaign),
        summary=[
            *([run_sentence(run) for run in runs] or ["No run was analysed."]), *told, *map_lines(result),
            *statement_lines(result), counted(worries),
            *counted_expectations(result),
        ],
        answers=answers, worries=worries, findings=findings, expectations=expectations, chapters=chapters,
    )  # fmt: skip
