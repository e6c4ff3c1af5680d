"""The measurement side of a run: condition, impacts, FRFs and their coherence."""

from math import isfinite

import numpy as np

from ema import show
from ema.data import RunResult
from ema.report.blocks import Block, Book, Cell, Text
from ema.report.modes import joint_force
from ema.report.numbers import MISSING, count, fixed, plain, short, with_uncertainty
from ema.show.style import unit_text

_MOST_REJECTED = 40


def condition(run: RunResult, book: Book) -> list[Block]:
    """Excitation, temperature, extent of the measurement, and the normal force of every joint."""
    state, frfs, name = run.run.condition, run.frfs, run.run.id
    drive = state.excitation
    low, high = short(frfs.frequencies[0]), short(frfs.frequencies[-1])
    rows: list[tuple[Cell, ...]] = [
        ("Excitation", drive.kind),
        ("FRFs", f"{count(len(frfs.outputs), 'response')} x {count(len(frfs.inputs), 'force')}"),
        ("Estimator", frfs.estimator or "not stated"),
        ("Quantity", f"{frfs.quantity}, {unit_text(frfs.unit)}"),
        ("Lines", f"{len(frfs.frequencies)} from {low} to {high} Hz, step {short(frfs.frequency_step)} Hz"),
    ]
    if drive.band is not None:
        rows.insert(1, ("Excited band", f"{short(drive.band[0])} to {short(drive.band[1])} Hz"))
    if isfinite(drive.level):
        rows.insert(1, ("Force level [N]", with_uncertainty(drive.level, drive.std, 3)))
    elif run.hits is not None and run.hits.accepted:
        peaks = [hit.peak for hit in run.hits.accepted]
        middle, weakest, strongest = (str(plain(float(x), 3)) for x in (np.median(peaks), min(peaks), max(peaks)))
        rows.insert(1, (f"Peak of the impacts [{force_unit(run)}]", f"median {middle}, {weakest} to {strongest}"))
    if state.temperature is not None:
        rows.append(("Temperature [°C]", fixed(state.temperature - 273.15, 1)))
    if run.run.comment:
        rows.append(("Comment", run.run.comment))
    table = book.table(f"condition_{name}", f"Condition of run {name}.", ("What", "Value"), rows)
    if not state.joints:
        return [table, Text("There was no friction beam: no joint, no normal force.")]
    return [table, *_normal_force(run, book)]


def _normal_force(run: RunResult, book: Book) -> list[Block]:
    joints, name = run.run.condition.joints, run.run.id
    columns = ("Joint", "F_N [N]", "std [N]", "drift [N]", "Torque [N m]", "Loading", "Run-in", "Calibration")
    rows: list[tuple[Cell, ...]] = [
        (
            j.joint,
            joint_force(j.mean, j.std),
            plain(j.std, 2),
            plain(j.drift, 2),
            plain(j.torque, 3),
            j.sequence,
            MISSING if j.run_in is None else j.run_in,
            j.calibration or "not stated",
        )
        for j in joints
    ]
    caption = f"Normal force of run {name} (± one standard deviation over the run)."
    forces = ", ".join(f"{joint.joint} {joint_force(joint.mean, joint.std)} N" for joint in joints[:8])
    figure = show.normal_force(run.run.condition)
    return [
        book.table(f"normal_force_{name}", caption, columns, rows),
        book.picture(figure, f"Normal force of run {name}: {forces}.", f"Normal force of each joint of run {name}."),
    ]


def impacts(run: RunResult, book: Book) -> list[Block]:
    """The impacts of a hammer test, which were rejected and why, and the band they excite."""
    gallery, name = run.hits, run.run.id
    if gallery is None:
        text = "The impacts cannot be shown: this run came as finished FRFs, without its time records."
        return [Text(text, missing=True)] if run.run.kind == "hammer" else []
    rejected = [hit for hit in gallery.hits if not hit.accepted]
    accepted = len(gallery.hits) - len(rejected)
    unit = force_unit(run)
    counts = f"Impacts of run {name}: {accepted} of {len(gallery.hits)} accepted"
    reasons = sorted({hit.reason for hit in rejected})
    alt = f"{counts}; rejected for: {'; '.join(reasons[:5])}." if reasons else f"{counts}."
    blocks: list[Block] = [book.picture(show.hits(gallery, unit), alt, f"{counts}.")]
    if accepted:
        ten, twenty = (short(float(f"{frequency:.4g}")) for frequency in gallery.usable_band)
        text = f"the force autospectrum has fallen by 10 dB at {ten} Hz and by 20 dB at {twenty} Hz"
        blocks.append(book.picture(show.force_spectrum(gallery), f"Run {name}: {text}.", f"Usable band: {text}."))
    if rejected:
        rows = [(hit.recording, hit.index, str(hit.dof or MISSING), plain(hit.peak, 4), hit.reason) for hit in rejected]
        columns = ("Record", "Hit (first: 0)", "Point", f"Peak [{unit}]", "Reason")
        shown = len(columns) if len(rows) <= _MOST_REJECTED else 0
        blocks.append(book.table(f"rejected_impacts_{name}", f"Rejected impacts of run {name}.", columns, rows, shown))
    return blocks


def overview(run: RunResult, book: Book) -> list[Block]:
    """All FRFs and their coherence."""
    frfs, name = run.frfs, run.run.id
    number = len(frfs.outputs) * len(frfs.inputs)
    where = f"{short(frfs.frequencies[0])} to {short(frfs.frequencies[-1])} Hz"
    blocks: list[Block] = [
        book.picture(
            show.frf_overview(frfs, run.modes),
            f"Magnitude of the {number} FRFs of run {name} from {where}.",
            f"All {number} FRFs with their quadratic mean; dashed lines mark the modes.",
        )
    ]
    if frfs.coherence is None:
        text = "No coherence came with these FRFs, so their noise cannot be judged from it."
        return [*blocks, Text(text, missing=True)]
    median = f"median over all lines and FRFs {plain(float(np.median(np.nan_to_num(frfs.coherence))), 3)}"
    figure = show.coherence(frfs, run.modes)
    blocks.append(book.picture(figure, f"Coherence of run {name}: {median}.", f"Coherence ({median})."))
    return blocks


def force_unit(run: RunResult) -> str:
    """The unit of the impacts, or that nobody stated it."""
    return "N" if run.frfs.scaled else "unit unstated"
