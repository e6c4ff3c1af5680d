"""The measurement side of a run: condition, impacts, FRFs and their coherence."""

from functools import partial
from math import isfinite

import numpy as np

from ema import show
from ema.data import RunResult
from ema.messages import mark, plural, text, word
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.modes import joint_force
from ema.report.numbers import MISSING, fixed, plain, short, with_uncertainty
from ema.show.style import unit_text

_WORDS = (
    mark("hammer"),
    mark("sweep"),
    mark("stepped sine"),
    mark("random"),
    mark("snap-back"),
    mark("unknown"),
    mark("up"),
    mark("down"),
    mark("unstated"),
    mark("receptance"),
    mark("mobility"),
    mark("accelerance"),
)
"""Kinds of excitation, sequences of loading and quantities, as data say them."""
_MOST_REJECTED = 40
"""Rejected impacts up to which the page shows their table; the CSV file lists all."""


def condition(run: RunResult, book: Book) -> list[Block]:
    """Excitation, temperature, extent of the measurement, and the normal force of every joint."""
    state, frfs, name = run.run.condition, run.frfs, run.run.id
    drive = state.excitation
    low, high = short(frfs.frequencies[0]), short(frfs.frequencies[-1])
    rows: list[tuple[Cell, ...]] = [
        (text("Excitation"), word(drive.kind)),
        (
            text("FRFs"),
            plural("{count} response", "{count} responses", len(frfs.outputs))
            + " x "
            + plural("{count} force", "{count} forces", len(frfs.inputs)),
        ),
        (text("Estimator"), frfs.estimator or text("not stated")),
        (text("Quantity"), f"{word(frfs.quantity)}, {unit_text(frfs.unit)}"),
        (
            text("Lines"),
            text(
                "{number} from {low} to {high} Hz, step {step} Hz",
                number=len(frfs.frequencies),
                low=low,
                high=high,
                step=short(frfs.frequency_step),
            ),
        ),
    ]
    if drive.band is not None:
        rows.insert(
            1, (text("Excited band"), text("{low} to {high} Hz", low=short(drive.band[0]), high=short(drive.band[1])))
        )
    if isfinite(drive.level):
        rows.insert(1, (text("Force level [N]"), with_uncertainty(drive.level, drive.std, 3)))
    elif run.hits is not None and run.hits.accepted:
        peaks = [hit.peak for hit in run.hits.accepted]
        middle, weakest, strongest = (str(plain(float(x), 3)) for x in (np.median(peaks), min(peaks), max(peaks)))
        rows.insert(
            1,
            (
                text("Peak of the impacts [{unit}]", unit=force_unit(run)),
                text("median {middle}, {weakest} to {strongest}", middle=middle, weakest=weakest, strongest=strongest),
            ),
        )
    if state.temperature is not None:
        rows.append((text("Temperature [°C]"), fixed(state.temperature - 273.15, 1)))
    if run.run.comment:
        rows.append((text("Comment"), run.run.comment))
    table = book.table(
        f"condition_{name}", text("Condition of run {run}.", run=name), (text("What"), text("Value")), rows
    )
    if not state.joints:
        return [table, Text(text("There was no friction beam: no joint, no normal force."))]
    return [table, *_normal_force(run, book)]


def _normal_force(run: RunResult, book: Book) -> list[Block]:
    joints, name = run.run.condition.joints, run.run.id
    columns = (
        text("Joint"),
        "F_N [N]",
        text("std [N]"),
        text("drift [N]"),
        text("Torque [N m]"),
        text("Loading"),
        text("Run-in"),
        text("Calibration"),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            j.joint,
            joint_force(j.mean, j.std),
            plain(j.std, 2),
            plain(j.drift, 2),
            plain(j.torque, 3),
            word(j.sequence),
            MISSING if j.run_in is None else j.run_in,
            j.calibration or text("not stated"),
        )
        for j in joints
    ]
    caption = text("Normal force of run {run} (± one standard deviation over the run).", run=name)
    forces = ", ".join(f"{joint.joint} {joint_force(joint.mean, joint.std)} N" for joint in joints[:8])
    return [
        book.table(f"normal_force_{name}", caption, columns, rows),
        book.picture(
            partial(show.normal_force, run.run.condition),
            text("Normal force of run {run}: {forces}.", run=name, forces=forces),
            text("Normal force of each joint of run {run}.", run=name),
        ),
    ]


def impacts(run: RunResult, book: Book) -> list[Block]:
    """The impacts of a hammer test, which were rejected and why, and the band they excite."""
    gallery, name = run.hits, run.run.id
    if gallery is None:
        missing = text("The impacts cannot be shown: this run came as finished FRFs, without its time records.")
        return [Text(missing, missing=True)] if run.run.kind == "hammer" else []
    rejected = [hit for hit in gallery.hits if not hit.accepted]
    accepted = len(gallery.hits) - len(rejected)
    unit = force_unit(run)
    counts = {"run": name, "accepted": accepted, "number": len(gallery.hits)}
    reasons = sorted({hit.reason for hit in rejected})
    caption = text("Impacts of run {run}: {accepted} of {number} accepted.", **counts)
    alt = caption
    if reasons:
        alt = text(
            "Impacts of run {run}: {accepted} of {number} accepted; rejected for: {reasons}.",
            **counts,
            reasons="; ".join(reasons[:5]),
        )
    blocks: list[Block] = [book.picture(partial(show.hits, gallery, unit), alt, caption)]
    if accepted:
        ten, twenty = (short(float(f"{frequency:.4g}")) for frequency in gallery.usable_band)
        ends = {"ten": ten, "twenty": twenty}
        blocks.append(
            book.picture(
                partial(show.force_spectrum, gallery),
                text(
                    "Run {run}: the force autospectrum has fallen by 10 dB at {ten} Hz and by 20 dB at {twenty} Hz.",
                    run=name,
                    **ends,
                ),
                text(
                    "Usable band: the force autospectrum has fallen by 10 dB at {ten} Hz and by 20 dB at {twenty} Hz.",
                    **ends,
                ),
            )
        )
    if rejected:
        rows = [(hit.recording, hit.index, str(hit.dof or MISSING), plain(hit.peak, 4), hit.reason) for hit in rejected]
        columns = (
            text("Record"),
            text("Hit (first: 0)"),
            text("Point"),
            text("Peak [{unit}]", unit=unit),
            text("Reason"),
        )
        shown = len(columns) if len(rows) <= _MOST_REJECTED else 0
        blocks.append(
            book.table(
                f"rejected_impacts_{name}", text("Rejected impacts of run {run}.", run=name), columns, rows, shown
            )
        )
    return blocks


def overview(run: RunResult, book: Book) -> list[Block]:
    """All FRFs and their coherence."""
    frfs, name = run.frfs, run.run.id
    number = len(frfs.outputs) * len(frfs.inputs)
    ends = {"low": short(frfs.frequencies[0]), "high": short(frfs.frequencies[-1])}
    blocks: list[Block] = [
        book.picture(
            partial(show.frf_overview, frfs, run.modes),
            text(
                "Magnitude of the {number} FRFs of run {run} from {low} to {high} Hz.", number=number, run=name, **ends
            ),
            text("All {number} FRFs with their quadratic mean; dashed lines mark the modes.", number=number),
        )
    ]
    if frfs.coherence is None:
        missing = text("No coherence came with these FRFs, so their noise cannot be judged from it.")
        return [*blocks, Text(missing, missing=True)]
    median = plain(float(np.median(np.nan_to_num(frfs.coherence))), 3)
    blocks.append(
        book.picture(
            partial(show.coherence, frfs, run.modes),
            text("Coherence of run {run}: median over all lines and FRFs {median}.", run=name, median=median),
            text("Coherence (median over all lines and FRFs {median}).", median=median),
        )
    )
    return blocks


def force_unit(run: RunResult) -> str:
    """The unit of the impacts, or that nobody stated it."""
    return "N" if run.frfs.scaled else text("unit unstated")
