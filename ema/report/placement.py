"""Where the beam goes, as a report: the answer, the map, the ranking, what a controlled force would add."""

from pathlib import Path

import numpy as np

from ema import show
from ema.data.placement import Place, Placement
from ema.report.blocks import Block, Book, Cell, Section, Text
from ema.report.document import Chapter, Document
from ema.report.numbers import plain, short
from ema.report.worries import counted, finding_table, grouped


def sections(placement: Placement, book: Book) -> list[Section]:
    """The placement as sections of a report."""
    blocks: list[Block] = [Text(placement.warning)] if placement.warning else []
    ranking = placement.ranking
    blocks += [
        Text(answer(placement)),
        book.picture(
            show.placement_map(placement), "Map of all places of the beam on the measured surface, with the best ones.",
            f"{len(ranking.scores)} places by the one-mode predictor ({ranking.objective}); numbers: ranks with all "
            "modes together; hatched: kept free.",
        ),
        _table(placement, book),
        book.picture(
            show.recommended_force(placement), "Recommended normal force over excitation force, and damping.",
            "Recommended normal force of every joint at the best place, and the damping it brings.",
        ),
    ]  # fmt: skip
    parts = [Section("Where the beam goes", "placement", blocks)]
    if placement.control is not None:
        study = placement.control
        frame = study.table().reset_index()
        rows: list[list[Cell]] = [
            [str(row[0]), *(plain(float(value), 4) for value in row[1:])] for row in frame.itertuples(index=False)
        ]
        parts.append(Section("A controlled normal force", "control", [
            Text(study.verdict),
            book.picture(
                show.control_gain(study), "Energy over time after a release under constant and controlled force.",
                f"Left: release from {study.load:.3g} N at the excited point. Right: steady vibration over the "
                "excitation force, one normal force for all levels or one for each.",
            ),
            book.table(
                "control", "Ring-downs: J is the integral of the energy over that at the start; t to stay below 5 % "
                "and 2 % of the amplitude.", tuple(str(name) for name in frame.columns), rows,
            ),
        ]))  # fmt: skip
    return parts


def answer(placement: Placement) -> str:
    """The best place in words."""
    ranking, best = placement.ranking, placement.ranking.best
    joints = ranking.prediction.candidates.joints(best.candidate)
    spots = " and ".join(f"({x:.3f}, {y:.3f}) m" for x, y in joints)
    told = [f"Bolt {best.beam} at {spots} and press every joint with {best.normal_force:.3g} N."]
    for m, mode in enumerate(ranking.prediction.modes):
        row = int(np.nanargmin(best.damping[m]))
        bounds = (
            f" [{100 * best.damping_low[m, row]:.2f}, {100 * best.damping_high[m, row]:.2f}] %"
            if np.isfinite(best.damping_low[m, row]) else " %"
        )  # fmt: skip
        told.append(
            f"Mode {mode + 1}: {100 * ranking.prediction.bare_damping[m]:.2f} -> at least "
            f"{100 * best.damping[m, row]:.2f}{bounds} damping at {ranking.prediction.force_levels.min():g} to "
            f"{ranking.prediction.force_levels.max():g} N, {ranking.prediction.bare_frequencies[m]:.1f} -> "
            f"{best.frequency[m, row]:.1f} Hz (mass {best.mass_shift[m]:+.1f} Hz, sticking joints "
            f"{best.stiffness_shift[m]:+.1f} Hz)."
        )
    return " ".join(told)


def _table(placement: Placement, book: Book) -> Block:
    rows = [_row(number, place) for number, place in enumerate(placement.ranking.places, 1)]
    modes = placement.ranking.prediction.modes
    columns = ["Rank", "x [m]", "y [m]", "Angle [deg]", "Beam", "Objective", "F_N [N]"]
    for mode in modes:
        columns += [f"ζ{mode + 1} [%]", f"95 % of ζ{mode + 1}", f"f{mode + 1} [Hz]"]
    decibels = placement.ranking.objective.startswith(("peak", "chatter"))
    caption = (
        f"The best places: {placement.ranking.objective}{' [dB]' if decibels else ''}. Middle of the beam, normal "
        "force of every joint for all levels, least damping over the levels."
    )
    return book.table("places", caption, [*columns, "Flags"], rows)


def _row(number: int, place: Place) -> list[Cell]:
    cells: list[Cell] = [
        number, plain(place.centre[0], 3), plain(place.centre[1], 3), plain(float(np.degrees(place.angle)), 3),
        place.beam, plain(place.score, 3), plain(place.normal_force, 3),
    ]  # fmt: skip
    for m in range(len(place.damping)):
        row = int(np.nanargmin(place.damping[m]))
        low, high = 100 * place.damping_low[m, row], 100 * place.damping_high[m, row]
        cells += [
            plain(100 * float(place.damping[m, row]), 3),
            f"{short(round(low, 2))} ... {short(round(high, 2))}" if np.isfinite(low) else "–",
            plain(float(place.frequency[m, row]), 4),
        ]  # fmt: skip
    return [*cells, ", ".join(sorted({finding.code for finding in place.findings})) or "none"]


def compose(placement: Placement, book: Book) -> Document:
    """A report of the placement alone."""
    parts = sections(placement, book)
    findings = list(dict.fromkeys([*placement.findings, *placement.ranking.best.findings]))
    worries = grouped(findings)
    prediction = placement.ranking.prediction
    facts = [
        ("Objective", placement.ranking.objective),
        ("Excitation", ", ".join(f"{level:g}" for level in prediction.force_levels) + " N"),
        ("Candidates", f"{len(placement.ranking.scores)}, {len(placement.ranking.shortlist)} with all modes together"),
    ]
    summary = [*([placement.warning] if placement.warning else []), answer(placement)]
    summary += [placement.control.verdict] if placement.control is not None else []
    return Document(
        title=placement.title, facts=facts, comment="", photos=[], summary=[*summary, counted(worries)], answers=parts,
        worries=worries, findings=finding_table(worries, book), expectations=None, chapters=list[Chapter](),
    )  # fmt: skip


def write(placement: Placement, path: str | Path) -> Path:
    """Write a placement as one HTML page, its tables as CSV beside it.

    Raises
    ------
    FailureError : the page cannot be written.
    """
    from ema.report.files import as_csv, write_bytes
    from ema.report.html import page

    path, book = Path(path), Book()
    document = compose(placement, book)
    tables = path.with_name(f"{path.stem}_tables")
    for table in book.tables:
        write_bytes(tables / f"{table.name}.csv", as_csv(table).encode())
    write_bytes(path, page(document, tables.name).encode())
    return path
