"""What the page draws, as content that JSON can hold."""

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.app.state import Workbench
from ema.errors import InputError
from ema.fit import cmif
from ema.messages import text, word
from ema.messages.recognition import in_words
from ema.show.frf import drive_points, peaks
from ema.show.moving import moving_shapes
from ema.show.style import frf_label

_MOST_LINES = 3000
"""Most lines of a curve over frequency; all its peaks, and the lows of a coherence, are among them."""
EXPORTS = {"uff55": "modes.uff", "uff58": "frfs.uff", "csv": "modes.csv"}
"""What can be exported, and the names of the files."""


def numbers(values: Any, digits: int = 8) -> list[Any]:
    """Numbers to so many significant digits; ``None`` where there is none."""
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in np.ravel(values).tolist()]


def overview(bench: Workbench) -> dict[str, Any]:
    """Runs, modes and what can be done."""
    work, joints = bench.work, bench.work.result.run.condition.joints
    modes, run = work.result.modes, work.result.run
    deviations = (
        np.full((len(modes.poles), 2), np.nan)
        if modes.covariance is None
        else np.sqrt(np.maximum(modes.covariance[:, [0, 1], [0, 1]], 0))
    )
    collinearity = (
        np.full(len(modes.poles), np.nan)
        if work.result.quality is None
        else work.result.quality.modal_phase_collinearity
    )
    error = work.result.reconstruction_error
    median = float(np.nanmedian(error)) if error is not None and np.isfinite(error).any() else float("nan")
    return {
        "revision": bench.revision,
        "title": bench.result.title or bench.result.campaign.name,
        "run": run.id,
        "runs": [each.run.id for each in bench.result.runs],
        "saved": bench.saved,
        "undo": bench.undoable,
        "path": str(bench.path),
        "who": bench.who or bench.result.campaign.operator,
        "force": "; ".join(
            f"{joint.joint} {joint.mean:.4g} N" if joint.known else f"{joint.joint} {text('unknown')}"
            for joint in joints
        )
        or text("no friction beam"),
        "error": numbers([100 * median], 4)[0],
        "modes": [
            {"f": row[0], "zeta": row[1], "std_f": row[2], "std_zeta": row[3], "mpc": row[4]}
            for row in zip(
                numbers(modes.natural_frequencies),
                numbers(100 * modes.damping_ratios, 5),
                numbers(deviations[:, 0], 2),
                numbers(100 * deviations[:, 1], 2),
                numbers(collinearity, 4),
                strict=True,
            )
        ],
        "findings": [
            {"severity": word(each.severity), "text": str(in_words(each))}
            for each in (*modes.findings, *run.findings)
            if each.severity != "info"
        ],
        "maps": [chart.name or text("map {number}", number=number) for number, chart in enumerate(bench.maps, 1)],
        "placements": [
            one.title or text("placement {number}", number=number) for number, one in enumerate(bench.placements, 1)
        ],
    }


def poles(bench: Workbench) -> dict[str, Any]:
    """The stabilisation diagram and the CMIF behind it."""
    run, table = bench.work.result, bench.work.result.poles
    if table is None:
        return {"missing": text("There is no stabilisation diagram: the modes were not found through model orders.")}
    inside = run.frfs.band(*table.band)
    lines = peaks(inside.frequencies, np.asarray(cmif(inside)), _MOST_LINES)
    return {
        "frequency": numbers(table.natural_frequencies),
        "order": table.order.tolist(),
        "damping": numbers(100 * table.damping_ratios, 4),
        "letter": table.letter.tolist(),
        "picked": list(bench.work.picked),
        "band": list(table.band),
        "lines": numbers(lines[0]),
        "cmif": [numbers(column, 4) for column in lines[1].T],
    }


def frf(bench: Workbench, output: int, input_: int) -> dict[str, Any]:
    """One FRF, measured and synthesised, with its coherence, as what JSON can hold.

    Parameters
    ----------
    bench : workbench with the run that is shown.
    output, input_ : index of the response and of the force in the FRFs of the run, from 0.

    Returns
    -------
    Labels and curves; ``error`` is the norm of the difference over that of the measured FRF in %. ``synthesised``,
    ``error`` and ``coherence`` are absent where the run has none.

    Raises
    ------
    InputError : there is no such FRF.
    """
    run = bench.work.result
    frfs = run.frfs
    if not (0 <= output < len(frfs.outputs) and 0 <= input_ < len(frfs.inputs)):
        raise InputError(
            "no such FRF",
            got=f"response {output}, force {input_}",
            expected=f"response 0 to {len(frfs.outputs) - 1}, force 0 to {len(frfs.inputs) - 1}",
        )
    answer: dict[str, Any] = {
        "outputs": [str(dof) for dof in frfs.outputs],
        "inputs": [str(dof) for dof in frfs.inputs],
        "label": frfs.label(output, input_),
        "unit": frf_label(frfs.quantity, frfs.unit),
        "measured": curve(frfs.frequencies, frfs.values[:, output, input_]),
    }
    if run.reconstruction is not None:
        synthesised = run.reconstruction
        answer["synthesised"] = curve(synthesised.frequencies, synthesised.values[:, output, input_])
    if run.reconstruction_error is not None:
        answer["error"] = numbers([100 * run.reconstruction_error[output, input_]], 3)[0]
    if frfs.coherence is not None:
        coherence = frfs.coherence[:, output, input_]
        rows = strongest(1 - coherence)
        answer["coherence"] = numbers(coherence[rows], 4)
        answer["coherence_lines"] = numbers(frfs.frequencies[rows])
    return answer


def matrix(bench: Workbench) -> dict[str, Any]:
    """The AutoMAC."""
    table = bench.work.result.auto_mac
    return {"mac": [] if table is None else [numbers(row, 4) for row in table]}


def motion(bench: Workbench) -> dict[str, Any]:
    """The moving shapes in space, or why there are none.

    Parameters
    ----------
    bench : workbench with the modes that are picked.

    Returns
    -------
    Points, faces and shapes for the browser; ``missing`` alone, a sentence, without geometry or without modes.
    """
    geometry, modes = bench.result.campaign.geometry, bench.work.result.modes
    if geometry is None:
        return {"missing": text("The campaign has no geometry, so shapes cannot be drawn in space.")}
    if not len(modes.poles):
        return {"missing": text("No mode is picked, so there is no shape to draw.")}
    return moving_shapes(modes, geometry)


def hits(bench: Workbench) -> dict[str, Any]:
    """The impacts, with what is known about each.

    Parameters
    ----------
    bench : workbench with the run that is shown.

    Returns
    -------
    ``usable`` band in Hz, and of each impact the peak force in N, the contact time in ms, whether it is accepted and
    why not; ``missing`` alone, a sentence, where the run has no impacts or came as finished FRFs.
    """
    gallery = bench.work.result.hits
    if gallery is None:
        return {"missing": text("This run has no impacts, or came as finished FRFs without its time records.")}
    return {
        "usable": numbers(gallery.usable_band, 5),
        "hits": [
            {
                "record": hit.recording,
                "index": hit.index,
                "dof": str(hit.dof or ""),
                "accepted": hit.accepted,
                "peak": numbers([hit.peak], 4)[0],
                "contact": numbers([1e3 * hit.contact_time], 3)[0],
                "reason": hit.reason,
            }
            for hit in gallery.hits
        ],
    }


def pulse(bench: Workbench, hit: int) -> dict[str, Any]:
    """The force of one impact over time in ms.

    Raises
    ------
    InputError : there is no such impact.
    """
    gallery = bench.work.result.hits
    if gallery is None or not 0 <= hit < len(gallery.hits):
        raise InputError(
            "no such impact", got=hit, expected=f"one of {len(gallery.hits) if gallery else 0}, counted from 0"
        )
    impact = gallery.hits[hit]
    return {
        "time": numbers(1e3 * np.arange(len(impact.pulse)) / impact.sampling_rate, 5),
        "force": numbers(impact.pulse, 5),
        "label": f"{impact.recording}, impact {impact.index + 1}",
    }


def chart(bench: Workbench, place: int) -> dict[str, Any]:
    """A modal map; holes are ``None``.

    Raises
    ------
    InputError : there is no such map.
    """
    if not 0 <= place < len(bench.maps):
        raise InputError("no such map", got=place, expected=f"one of {len(bench.maps)}, counted from 0")
    modal_map = bench.maps[place]
    return {
        "levels": numbers(modal_map.force_levels),
        "forces": numbers(modal_map.normal_forces),
        "damping": [numbers(100 * row, 5) for row in modal_map.damping],
        "frequency": [numbers(row) for row in modal_map.frequency],
        "name": modal_map.name,
        "method": modal_map.method,
    }


def point(bench: Workbench, place: int, level: int, force: int) -> dict[str, Any]:
    """The FRF behind a point of a map, about its mode, with what the map says there.

    Raises
    ------
    InputError : there is no such point, no run near it, or no signals to compute from.
    """
    name, frfs = bench.seen_at(place, level, force)
    modal_map = bench.maps[place]
    frequency = float(modal_map.frequency[level, force])
    if np.isfinite(frequency) and frfs.frequencies[0] < 1.1 * frequency and frfs.frequencies[-1] > 0.9 * frequency:
        frfs = frfs.band(0.9 * frequency, 1.1 * frequency)
    output, input_ = next(iter(drive_points(frfs)), (0, 0))
    return {
        "run": name,
        "label": frfs.label(output, input_),
        "unit": frf_label(frfs.quantity, frfs.unit),
        "measured": curve(frfs.frequencies, frfs.values[:, output, input_]),
        "f": numbers([frequency], 6)[0],
        "zeta": numbers([100 * float(modal_map.damping[level, force])], 4)[0],
        "level": numbers([modal_map.force_levels[level]], 4)[0],
        "force": numbers([modal_map.normal_forces[force]], 4)[0],
    }


def export(bench: Workbench, kind: str) -> tuple[str, bytes]:
    """A file for other programs: its name and content.

    Raises
    ------
    InputError : no such kind, or what was measured cannot be written in it.
    """
    import acquisition

    if kind not in EXPORTS:
        raise InputError("no such export", got=kind, expected=", ".join(EXPORTS))
    work, geometry = bench.work.result, bench.result.campaign.geometry
    name = f"{work.run.id}_{EXPORTS[kind]}"
    if kind == "csv":
        return name, work.modes.table().to_csv().encode()
    contents: Sequence[Any] = (replace(work.modes, name=work.run.id),) if kind == "uff55" else (work.frfs,)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "export.uff"
        acquisition.write(path, *contents, *([] if geometry is None else [geometry]))
        return name, path.read_bytes()


def strongest(values: np.ndarray, most: int = _MOST_LINES) -> np.ndarray:
    """Rows of a curve, at most so many: of each group of neighbours that of the value of largest size."""
    sizes = np.nan_to_num(np.abs(values), nan=-1.0)
    step = max(1, -(-len(sizes) // most))
    starts = range(0, len(sizes), step)
    return np.array([start + int(np.argmax(sizes[start : start + step])) for start in starts], dtype=int)


def curve(frequencies: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    """Magnitude and phase [deg] of an FRF with all its peaks; magnitudes of zero are ``None``."""
    rows = strongest(values)
    values = values[rows]
    return {
        "f": numbers(frequencies[rows]),
        "magnitude": numbers(np.where(values == 0, np.nan, np.abs(values)), 5),
        "phase": numbers(np.degrees(np.angle(values)), 4),
    }
