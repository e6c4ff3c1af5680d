"""The whole report as words, tables and pictures: what every format says, whatever it looks like."""

from dataclasses import dataclass, field

from ema.data import StudyResult
from ema.messages import text
from ema.report.amplitude import amplitude_modes, amplitude_sentences
from ema.report.blocks import Block, Book, Section, Table
from ema.report.change import change_sections
from ema.report.comparison import comparisons
from ema.report.expected import counted_expectations, expectation_table
from ema.report.findings import Group, all_findings, counted, finding_table, grouped, language_note
from ema.report.forecast import verdict
from ema.report.friction import loops, ring_down_sentences, ring_downs
from ema.report.maps import map_lines, map_sections, statement_lines, statements
from ema.report.modes import equivalent_table, mode_table, run_sentence, set_up_table
from ema.report.photos import logo, photos
from ema.report.placement import answers, place_blocks, placement_sections
from ema.report.records import provenance, repairs
from ema.report.runs import run_sections


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
    finding_groups: list[Group]
    findings: Table | None
    expectations: Table | None
    chapters: list[Chapter]
    logo: Block | None = None
    language_note: str = ""


def compose(result: StudyResult, book: Book) -> Document:
    """Everything that a report of ``result`` says, in the order in which it is read."""
    campaign, placement = result.campaign, result.placement
    runs = list(result.runs)
    # tables and figures are numbered in the order in which they are made, so the order of these lines is the reader's
    front: list[Section] = []
    if placement is not None:
        front.append(Section(text("Where the beam goes"), "placement", place_blocks(placement, book)))
    tables = (mode_table, equivalent_table, set_up_table)
    modes = [block for run in runs for table in tables if (block := table(run, book)) is not None]
    comparison_lines, compared = comparisons(runs, book)
    groups = grouped(all_findings(result))
    others = result.maps or result.amplitude_modes or result.decays or result.loops
    front += [Section(text("Modes"), "modes", modes)] if modes or not others else []
    front += [Section(text("Runs compared"), "comparison", compared)] if compared else []
    front += statements(result, book) + map_sections(result, book)
    if result.amplitude_modes:
        front.append(Section(text("Over the amplitude"), "amplitude", amplitude_modes(result.amplitude_modes, book)))
    if result.decays:
        front.append(Section(text("Ring-down"), "ring-down", ring_downs(result.decays, book, campaign.runs)))
    if result.loops:
        front.append(Section(text("Hysteresis"), "hysteresis", loops(result.loops, book)))
    facts = {
        text("Structure"): campaign.structure,
        text("Campaign"): campaign.name,
        text("Operator"): campaign.operator,
        text("Date"): campaign.date,
    }
    findings, expectations = finding_table(groups, book), expectation_table(result, book)
    return Document(
        title=result.title or campaign.name,
        facts=[(label, value or text("not stated")) for label, value in facts.items()],
        comment=campaign.comment,
        photos=photos(campaign),
        summary=[
            *([] if placement is None else answers(placement)),
            *([] if result.forecast_check is None else [verdict(result.forecast_check)]),
            *([run_sentence(run) for run in runs] or ([] if others else [text("No run was analysed.")])),
            *comparison_lines,
            *map_lines(result),
            *statement_lines(result),
            *amplitude_sentences(result.amplitude_modes),
            *ring_down_sentences(result.decays),
            counted(groups),
            *counted_expectations(result),
        ],
        answers=front,
        finding_groups=groups,
        findings=findings,
        expectations=expectations,
        chapters=_chapters(result, book),
        logo=logo(campaign),
        language_note=language_note(),
    )


def _chapters(result: StudyResult, book: Book) -> list[Chapter]:
    """What stands behind the front page."""
    repaired = repairs(result, book)
    chapters = [Chapter(repaired.title, repaired.anchor, repaired.blocks)]
    if result.placement is not None:
        parts = placement_sections(result.placement, book, result.forecast_check)
        chapters.append(Chapter(text("The place in detail"), "placement-detail", sections=parts))
    if changed := change_sections(list(result.runs), book):
        chapters.append(Chapter(text("Before and after"), "change", sections=changed))
    for number, run in enumerate(result.runs, 1):
        sections = run_sections(run, result.campaign.geometry, number, book)
        chapters.append(Chapter(text("Run {run}", run=run.run.id), f"run-{number}", sections=sections))
    origin = provenance(result, book)
    return [*chapters, Chapter(origin.title, origin.anchor, origin.blocks)]
