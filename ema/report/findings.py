"""Findings of a study, grouped by kind and sorted by severity."""

from dataclasses import dataclass, field

from ema.data import Finding, StudyResult
from ema.messages import SOURCE, kinds, language, mark, plural, text, word
from ema.messages.recognition import in_words
from ema.report.blocks import Book, Table
from ema.report.numbers import plain

SEVERITIES = {"error": mark("error"), "warning": mark("warning"), "info": mark("remark")}
"""Severities, the gravest first, as the reader meets them."""
_AS_DATA = mark("info")
"""How the table beside the report calls a remark."""
IN_ENGLISH = mark("Verdicts, reasons and the sentences of some findings are in English, as they were computed.")
_MOST_LISTED = 40
"""Findings that the front page lists; the others stand in a table."""


@dataclass
class Group:
    """Findings of one kind."""

    severity: str
    code: str
    advice: str
    findings: list[Finding] = field(default_factory=list)
    in_english: bool = False

    @property
    def name(self) -> str:
        """The severity in words."""
        return text(SEVERITIES[self.severity])

    @property
    def meaning(self) -> str:
        """What the catalogue says of the kind, where a message is not in the reader's language."""
        return word(kinds()[self.code].meaning) if self.in_english and self.code in kinds() else ""

    @property
    def listed(self) -> list[Finding]:
        """Those that the page shows."""
        return self.findings[:_MOST_LISTED]


def all_findings(result: StudyResult) -> list[Finding]:
    """Every finding of a study once, wherever it was noted."""
    sources = [result.campaign.findings, result.findings]
    for run in result.runs:
        sources += [run.findings, run.run.findings, run.frfs.findings, run.modes.findings]
    return list(dict.fromkeys(finding for source in sources for finding in source))


def grouped(findings: list[Finding]) -> list[Group]:
    """By severity and kind, the gravest first and the most frequent first among equals."""
    groups: dict[tuple[str, str], Group] = {}
    for finding in findings:
        said = in_words(finding)
        group = groups.setdefault((finding.severity, finding.code), Group(finding.severity, finding.code, said.advice))
        group.findings.append(said)
        group.in_english |= language() != SOURCE and said.message == finding.message
    order = list(SEVERITIES)
    return sorted(groups.values(), key=lambda group: (order.index(group.severity), -len(group.findings), group.code))


def counted(groups: list[Group]) -> str:
    """``Findings: 1 error, 3 warnings.``"""
    numbers = {name: sum(len(g.findings) for g in groups if g.severity == name) for name in SEVERITIES}
    texts = {
        "error": plural("{count} error", "{count} errors", numbers["error"]),
        "warning": plural("{count} warning", "{count} warnings", numbers["warning"]),
        "info": plural("{count} remark", "{count} remarks", numbers["info"]),
    }
    counts = ", ".join(texts[name] for name, number in numbers.items() if number)
    return text("Findings: {counts}.", counts=counts) if counts else text("Findings: none.")


def meanings(groups: list[Group]) -> list[str]:
    """What each kind of finding means, with its severity."""
    known = kinds()
    return [f"{group.name}: {word(known[group.code].meaning)}" for group in groups if group.code in known]


def language_note() -> str:
    """That what the computation put into words is in English, in a report of another language."""
    return text(IN_ENGLISH) if language() != SOURCE else ""


def finding_table(groups: list[Group], book: Book) -> Table | None:
    """All findings, for the table beside the report."""
    if not groups:
        return None
    rows = [
        (word(f.severity), f.code, f.where, f.message, plain(f.value, 4), plain(f.limit, 4), f.advice)
        for group in groups
        for f in group.findings
    ]
    columns = (
        text("Severity"),
        text("Kind"),
        text("Where"),
        text("Message"),
        text("Value"),
        text("Limit"),
        text("Advice"),
    )
    return book.table("findings", text("All findings, with their values and limits."), columns, rows, shown=0)
