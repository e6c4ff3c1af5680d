"""Reports of single results without a study: a placement, a comparison with its verdict, what was simulated."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ema import show
from ema.data import (
    Decay,
    Finding,
    HarmonicResponse,
    Loop,
    MapComparison,
    MapResult,
    ModalMap,
    ModeComparison,
    ModelUpdate,
    Placement,
    Response,
    SignalComparison,
    StudyResult,
)
from ema.errors import InputError
from ema.messages import mark, text, word
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.document import Chapter, Document, compose
from ema.report.findings import counted, finding_table, grouped, language_note, meanings
from ema.report.friction import loops, ring_down_sentences, ring_downs
from ema.report.joint import joint_document
from ema.report.maps import map_blocks, map_sentence
from ema.report.numbers import fixed, plain, rounded
from ema.report.placement import answers, place_blocks, placement_sections
from ema.report.prediction import predictions
from ema.show.joint_result import JointResult

Group = tuple[list[str], list[Block]]
"""Sentences for the front page, and blocks."""


def document_of(content: Any, book: Book) -> Document:
    """Compose the report of a study, a placement, or results of comparisons and simulations.

    Parameters
    ----------
    content : StudyResult, Placement, JointResult, other result, or mapping of str to result
        Results by name; of a mapping with a single study or placement the report is the study's or the placement's.
    book : Book
        Numbers the pictures and tables of the report.

    Returns
    -------
    Document
        Title, chapters and front page, ready to be written in any format.

    Raises
    ------
    InputError
        Nothing of it can be reported.
    """
    if isinstance(content, StudyResult):
        return compose(content, book)
    if isinstance(content, Placement):
        return _of_placement(content, book)
    if isinstance(content, JointResult):
        return joint_document(content, book)
    results = dict(content) if isinstance(content, Mapping) else {"": content}
    if len(results) == 1 and isinstance(only := next(iter(results.values())), StudyResult | Placement | JointResult):
        return document_of(only, book)
    return _of_results(results, book)


def _of_placement(placement: Placement, book: Book) -> Document:
    prediction = placement.ranking.prediction
    facts = [
        (text("Objective"), word(placement.ranking.objective)),
        (text("Excitation"), ", ".join(f"{level:g}" for level in prediction.force_levels) + " N"),
        (
            text("Candidates"),
            text(
                "{number}, {chosen} with all modes together",
                number=len(placement.ranking.scores),
                chosen=len(placement.ranking.shortlist),
            ),
        ),
    ]
    blocks = place_blocks(placement, book)
    reported = _findings(list(placement.all_findings), book)
    chapter = Chapter(text("The place in detail"), "placement-detail", sections=placement_sections(placement, book))
    return _document(
        placement.title,
        facts,
        answers(placement),
        [Section(text("Where the beam goes"), "placement", blocks)],
        reported,
        [chapter],
    )


def _of_results(results: Mapping[str, Any], book: Book) -> Document:
    models = (one for one in results.values() if type(one).__name__ == "BeamModel" and one.name)
    model = next((str(one.name) for one in models), "")
    predicted = predictions(results, book)
    summary, sections, findings = predicted.summary, predicted.sections, predicted.findings
    for kind, title, made in _KINDS:
        of_kind = {name: result for name, result in predicted.others.items() if isinstance(result, kind)}
        if not of_kind:
            continue
        sentences, blocks = made(of_kind, book)
        summary += sentences
        sections.append(Section(word(title), title.lower().replace(" ", "-"), blocks))
        findings += [one for result in of_kind.values() for one in getattr(result, "findings", ())]
    if not sections:
        names = ", ".join(type(result).__name__ for result in results.values()) or "nothing"
        raise InputError(
            "there is nothing to report",
            got=names,
            expected="a study, a placement, a comparison, maps, or what `ema predict` or `ema simulate` wrote",
        )
    title = predicted.title or sections[0].title
    title = f"{model}: {title}" if model else title
    facts = [(text("Model"), model)] if model else []
    reported = _findings(list(dict.fromkeys(findings)), book)
    summary += meanings(reported[0]) if predicted.sections else []
    origin = predicted.origin(book)
    chapters = [Chapter(text("Provenance"), "provenance", sections=origin)] if origin else []
    return _document(title, facts, summary, sections, reported, chapters)


def _findings(findings: list[Finding], book: Book) -> tuple[Any, Any]:
    groups = grouped(findings)
    return groups, finding_table(groups, book)


def _document(
    title: str,
    facts: list[tuple[str, str]],
    summary: list[str],
    sections: list[Section],
    findings: tuple[Any, Any],
    chapters: list[Chapter],
) -> Document:
    groups, table = findings
    return Document(
        title=title,
        facts=facts,
        comment="",
        photos=[],
        summary=[*summary, counted(groups)],
        answers=sections,
        finding_groups=groups,
        findings=table,
        expectations=None,
        chapters=chapters,
        language_note=language_note(),
    )


def _mode_comparisons(found: Mapping[str, ModeComparison], book: Book) -> Group:
    summary: list[str] = []
    blocks: list[Block] = []
    for name, one in found.items():
        summary.append(str(one.verdict))
        frame = one.table()
        blocks.append(
            book.table(
                name or "modes",
                text("Modes of the measurement paired with those of the model."),
                tuple(word(str(column)) for column in frame.columns),
                list(_cells(frame.itertuples(index=False))),
            )
        )
        alone = [", ".join(str(mode + 1) for mode in modes) or text("none") for modes in one.unpaired]
        blocks.append(
            Text(
                text("Without a partner: measured {measured}; of the model {model}.", measured=alone[0], model=alone[1])
            )
        )
    return summary, blocks


def _map_comparisons(found: Mapping[str, MapComparison], book: Book) -> Group:
    summary: list[str] = []
    blocks: list[Block] = []
    for one in found.values():
        summary.append(str(one.verdict))
        measured = one.measured
        blocks.append(
            book.picture(
                partial(show.map_comparison, one),
                text(
                    "Damping and frequency over the normal force, measured and simulated. {verdict}",
                    verdict=one.verdict,
                ),
                text("Markers with 95 % bars are measured, lines are the model."),
            )
        )
        rows: list[tuple[Cell, ...]] = [
            (plain(float(level), 3), plain(float(ridge[0]), 4), plain(float(ridge[1]), 4))
            for level, ridge in zip(measured.force_levels, one.ridge, strict=True)
        ]
        columns = ("F_E [N]", text("Best F_N measured [N]"), text("Best F_N of the model [N]"))
        blocks.append(book.table("ridge", text("Normal force of most damping at each excitation."), columns, rows))
        blocks.append(_points(one, book))
    return summary, blocks


def _releases(found: Mapping[str, SignalComparison], book: Book) -> Group:
    rows: list[tuple[Cell, ...]] = [
        (
            name or "release",
            fixed(one.peak_frequencies[0], 2),
            fixed(one.peak_frequencies[1], 2),
            fixed(100 * one.error, 1),
            fixed(100 * one.envelope_error, 1),
            rounded(100 * one.missing_damping, 100 * one.missing_std),
        )
        for name, one in found.items()
    ]
    columns = (
        text("Release"),
        text("Peak measured [Hz]"),
        text("Peak of the model [Hz]"),
        text("Difference [%]"),
        text("Of the envelopes [%]"),
    )
    caption = text(
        "A measured and a simulated release: velocities in the band of the mode, and the damping the model lacks."
    )
    table = book.table("releases", caption, (*columns, text("Missing damping [%]")), rows)
    return [str(one.verdict) for one in found.values()], [table]


def _points(one: MapComparison, book: Book) -> Block:
    rows: list[tuple[Cell, ...]] = [
        (
            plain(float(level), 3),
            plain(float(force), 4),
            fixed(float(one.measured.frequency[i, j]), 2),
            fixed(float(one.simulated.frequency[i, j]), 2),
            fixed(100 * float(one.measured.damping[i, j]), 3),
            fixed(100 * float(one.simulated.damping[i, j]), 3),
            fixed(float(one.damping_ratio[i, j]), 2),
        )
        for i, level in enumerate(one.measured.force_levels)
        for j, force in enumerate(one.measured.normal_forces)
    ]
    columns = (
        "F_E [N]",
        "F_N [N]",
        "f [Hz]",
        text("f model [Hz]"),
        "ζ [%]",
        text("ζ model [%]"),
        text("ζ model over measured"),
    )
    return book.table("points", text("Every condition, measured and simulated."), columns, rows)


def _updates(found: Mapping[str, ModelUpdate], book: Book) -> Group:
    blocks: list[Block] = []
    summary = []
    for one in found.values():
        frame = one.table()
        rows = list(_cells(frame.itertuples(index=False)))
        values = ", ".join(f"{name} {value:.4g}" for name, value in zip(one.names, one.values))
        summary.append(text("Identified: {values}.", values=values))
        blocks.append(
            book.table(
                "parameters",
                text("Parameters of the joint that fit the measured map, with 95 % intervals."),
                tuple(word(str(column)) for column in frame.columns),
                rows,
            )
        )
        if len(one.names) > 1:
            correlation = np.asarray(one.correlation)
            blocks.append(
                book.table(
                    "correlation",
                    text("Correlation between the estimates."),
                    (text("Parameter"), *one.names),
                    [(name, *(fixed(float(x), 3) for x in row)) for name, row in zip(one.names, correlation)],
                )
            )
    return summary, blocks


def _maps(found: Mapping[str, MapResult], book: Book) -> Group:
    return [map_sentence(one) for one in found.values()], [b for one in found.values() for b in map_blocks(one, book)]


def _charts(found: Mapping[str, ModalMap], book: Book) -> Group:
    """Maps without the gate between their levels, such as simulated ones."""
    nothing = np.zeros(0)
    return _maps(
        {
            name: MapResult(
                one.name or name or "map", one, np.zeros((0, 3)), nothing, nothing, np.full(one.damping.shape, np.nan)
            )
            for name, one in found.items()
        },
        book,
    )


def _decays(found: Mapping[str, Decay], book: Book) -> Group:
    named = _with_names(found)
    return ring_down_sentences(named), ring_downs(named, book)


def _loops(found: Mapping[str, Loop], book: Book) -> Group:
    return [], loops(_with_names(found), book)


def _with_names(found: Mapping[str, Any]) -> list[Any]:
    """The results under the names of the file, which tell them apart."""
    from dataclasses import replace

    return [replace(one, name=_short(name) or one.name) for name, one in found.items()]


def _short(name: str) -> str:
    return name.split(" ", 1)[1] if " " in name else name


def _motions(found: Mapping[str, Response], book: Book) -> Group:
    names = [_short(name) for name in found]
    blocks: list[Block] = [
        book.picture(
            partial(show.motion, list(found.values()), names),
            text("Motion over time of {names}, and the energy left.", names=", ".join(names)),
            text("Displacement over time, and the mechanical and contact energy over that at the start."),
        )
    ]
    for name, one in zip(names, found.values(), strict=True):
        if len(one.slips):
            caption = text(
                "Contacts at {name}: friction force over relative displacement, and the energy that each took.",
                name=name,
            )
            blocks.append(book.picture(partial(show.contact_loops, one), caption, caption))
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            plain(1e3 * float(np.max(np.abs(one.displacements[0]))), 4),
            plain(float(one.energy.friction[-1]), 4),
            plain(one.energy.error, 2),
            plain(one.error_estimate, 2),
        )
        for name, one in zip(names, found.values(), strict=True)
        if len(one.dofs)
    ]
    columns = (
        text("State"),
        text("Largest displacement [mm]"),
        text("Energy by friction [J]"),
        text("Energy balance"),
        text("Error estimate"),
    )
    return [], [*blocks, book.table("motions", text("What each motion did."), columns, rows)]


def _steady(found: Mapping[str, HarmonicResponse], book: Book) -> Group:
    names = [name.removeprefix("steady states ") for name in found]
    make = partial(show.steady_states, list(found.values()), names)
    caption = text(
        "Steady states over the excitation frequency: first harmonic over force, and the share of higher ones."
    )
    rows: list[tuple[Cell, ...]] = []
    for name, one in zip(names, found.values(), strict=True):
        size = np.abs(one.values[:, 0, list(one.orders).index(1)])
        top = int(np.nanargmax(size)) if np.isfinite(size).any() else 0
        rows.append(
            (
                name,
                plain(one.force, 3),
                fixed(float(one.frequencies[top]), 2),
                plain(1e6 * float(size[top]), 4),
                text("{solved} of {number}", solved=int(one.converged.sum()), number=len(one.converged)),
            )
        )
    columns = (text("State"), "F_E [N]", text("f of the peak [Hz]"), text("Peak [µm]"), text("Solved"))
    table = book.table("steady_states", text("The highest response of each state."), columns, rows)
    return [], [book.picture(make, text("Steady states: {names}.", names=", ".join(names)), caption), table]


def _cells(rows: Any) -> Iterator[Sequence[Cell]]:
    for row in rows:
        yield [plain(float(cell), 5) if isinstance(cell, float | np.floating) else _word(cell) for cell in row]


def _word(cell: Any) -> str | int:
    if isinstance(cell, bool | np.bool_):
        return text("yes") if cell else text("no")
    return int(cell) if isinstance(cell, int | np.integer) else str(cell)


_COLUMNS = (
    mark("measured"),
    mark("model"),
    mark("f measured [Hz]"),
    mark("f model [Hz]"),
    mark("zeta measured [%]"),
    mark("zeta model [%]"),
    mark("std MAC"),
    mark("parameter"),
    mark("value"),
    mark("low"),
    mark("high"),
    mark("identifiable"),
)
"""Heads of tables that come as data."""

_KINDS: tuple[tuple[type, str, Callable[[Mapping[str, Any], Book], Group]], ...] = (
    (ModeComparison, mark("Modes compared"), _mode_comparisons),
    (MapComparison, mark("Model against measurement"), _map_comparisons),
    (SignalComparison, mark("Releases compared"), _releases),
    (ModelUpdate, mark("Identified parameters"), _updates),
    (MapResult, mark("Maps"), _maps),
    (ModalMap, mark("Simulated maps"), _charts),
    (Response, mark("Free vibration"), _motions),
    (Decay, mark("Ring-down"), _decays),
    (HarmonicResponse, mark("Steady states"), _steady),
    (Loop, mark("Hysteresis"), _loops),
)
