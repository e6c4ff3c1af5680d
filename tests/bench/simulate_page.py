"""The simulator on the page about speed, from the rows of ``python -m tests.bench.simulate``."""

from typing import Any

import numpy as np

from tests.bench.simulate import ALLOWED, jobs
from tests.bench.write_docs import number, table

Rows = dict[str, dict[str, Any]]


def simulator(rows: Rows) -> str:
    """Section about the simulator: snap-backs, single steps, steady states, maps, first calls, and what is missing."""
    parts = [
        "## Simulator: double beam, 2 x 20 elements, 20 node pairs, Eq. (4)",
        *snap_backs(of(rows, "snap-back, ")),
        *steady_states(of(rows, "point, ")),
        *maps(of(rows, "map, ")),
        *steps(rows),
        *peaks(rows),
        *first_calls(of(rows, "first call, ")),
        *missing(rows),
        stamp(rows),
    ]
    return "\n\n".join(parts)


def of(rows: Rows, begin: str) -> Rows:
    """The rows whose name begins so, by the rest of it."""
    return {name.removeprefix(begin): row for name, row in rows.items() if name.startswith(begin)}


def snap_backs(rows: Rows) -> list[str]:
    """Both modes against OpenSeesPy."""
    lines = []
    for row in rows.values():
        force, ended = f"{row['force']:g}", [run for run in row["opensees"] if "error" not in run]
        peer = at_allowed(ended)
        for name, own in (("friction-ema, fast", row["fast"]), ("friction-ema, reference", row["reference"])):
            ratio = number(peer / own["cpu"]) if peer else "-"
            lines.append([force, name, number(own["cpu"]), f"{own['deviation']:.1e}", f"{own['energy']:.1e}", ratio])
        if one := row.get("one run"):
            ratio = number(peer / one["cpu"]) if peer and one["deviation"] <= ALLOWED else "-"
            step = f"friction-ema, one run, {1e6 * one['step']:.3g} us"
            lines.append([force, step, number(one["cpu"]), f"{one['deviation']:.1e}", "-", ratio])
        lines += [
            [
                force,
                f"OpenSeesPy {run['version']}, {1e6 * run['step']:g} us",
                number(run["cpu"]),
                f"{run['deviation']:.1e}",
                "-",
                "",
            ]
            for run in ended
        ]
    head = [
        "F_N [N]",
        "system",
        "processor time per simulated second [s]",
        "error / initial deflection",
        "energy balance / initial energy",
        "times faster than OpenSeesPy",
    ]
    text = (
        "OpenSeesPy is run with ever finer steps until its error falls below a thousandth; the ratio takes its time at "
        "exactly a thousandth, between its last two steps in logarithms (its last row where its error stays above). The "
        "truth is the reference mode at half its spacing. *Fast* and *reference* are whole calls: preparing the model, raising "
        "the load, and, for the first, runs with other steps, from which it takes the error that it states, here at a "
        "tolerance of a thousandth. *One run* is what OpenSeesPy does: one motion from the release on, with the longest "
        "step tried whose error is below a thousandth, and no statement of that error. "
    )
    active = "; ".join(f"{row['force']:g} N: {100 * row['active']:.0f} %" for row in rows.values())
    text += (
        f"Runs of {min((row['duration'] for row in rows.values()), default=0):g} s, so that contacts slip: the pair that "
        f"slides longest does so for this share of the time. {active}."
    )
    return ["Snap-back from 20 N:", table(head, lines), text] if lines else []


def steady_states(rows: Rows) -> list[str]:
    """One frequency after the other, at five harmonics and at as many as the error asks for, against pyHarm."""
    lines = []
    for row in sorted(rows.values(), key=lambda row: row["ratio"]):
        cells = [
            f"{row['ratio']:g}",
            f"{row['from']:g}-{row['to']:g}",
            str(row["slipping"]),
            number(1e3 * row["cpu five harmonics"]),
            number(1e3 * row["cpu as many as needed"]),
            str(row["most harmonics"]),
            f"{row['stated']:.1e}",
            f"{row['power']:.1e}",
        ]
        for name in ("all", "odd"):
            peer = row.get(f"pyHarm {name}")
            cells += ["-", "-"] if peer is None else [number(1e3 * peer["cpu"]), number(peer["ratio"])]
        lines.append(cells)
    head = [
        "F_N / F_E",
        "Hz",
        "slipping pairs, at most",
        "1st, 3rd, 5th harmonic [ms]",
        "as many as needed [ms]",
        "highest",
        "stated error",
        "power balance / input",
        "pyHarm, all to the 5th [ms]",
        "slower by",
        "pyHarm, odd ones [ms]",
        "slower by",
    ]
    versions = {row["version"] for row in rows.values() if "version" in row}
    apart = [
        row[f"pyHarm {name}"]["difference"]
        for row in rows.values()
        for name in ("all", "odd")
        if f"pyHarm {name}" in row
    ]
    text = f"Processor time per frequency of a sweep. pyHarm-os {', '.join(sorted(versions)) or '(did not run)'}."
    text += f" Its amplitudes at five harmonics are ours within {max(apart):.1e}." if apart else ""
    gone = [f"at {row['ratio']:g}: {row['error']}" for row in rows.values() if "error" in row]
    text += f" It did not end {'; '.join(gone)}." if gone else ""
    return [text, table(head, lines)] if lines else []


def maps(rows: Rows) -> list[str]:
    """Damping over excitation and normal force."""
    lines = [
        [name, f"{row['levels']} x {row['forces']}", number(row["cpu"]), number(100 * max(row["errors of peaks"]))]
        for name, row in rows.items()
    ]
    head = ["contact stiffness", "F_E x F_N", "processor time [s]", "largest error of the peaks [%]"]
    text = (
        "Maps of damping: the largest response in a band of 10-36 Hz at every pair of forces, sought where it is instead "
        "of at 100 frequencies, within 1 %. Peaks are compared with single resonances at a tolerance of 0.1 %."
    )
    return [text, table(head, lines)] if lines else []


def at_allowed(ended: list[dict[str, Any]]) -> float | None:
    """Processor time of the peer at the error that is allowed, from its last two steps; of the last where it is above."""
    if not ended:
        return None
    last = ended[-1]
    if len(ended) < 2 or last["deviation"] > ALLOWED:
        return float(last["cpu"])
    errors, times = (np.log([run[key] for run in ended[-2:]]) for key in ("deviation", "cpu"))
    share = (np.log(ALLOWED) - errors[0]) / (errors[1] - errors[0])
    return float(np.exp(times[0] + share * (times[1] - times[0])))


def steps(rows: Rows) -> list[str]:
    """Single steps of every law."""
    if "steps" not in rows:
        return []
    lines = [[name, number(row["us"]), number(row["ratio"])] for name, row in rows["steps"]["laws"].items()]
    text = (
        "A step of 10 us with 20 sliding pairs (snap-back from 1 kN, the first 10 ms), all laws in one run; the ratio is "
        "the median over turns:"
    )
    return [text, table(["law", "processor time [us]", "over Masing"], lines)]


def missing(rows: Rows) -> list[str]:
    """What the bench measures and this page does not show."""
    gone = [name for name in jobs() if name not in rows]
    if not gone:
        return []
    return [f"Not measured for the present code, and therefore not shown: {'; '.join(gone)}."]


def peaks(rows: Rows) -> list[str]:
    """Heights of resonances against the reference mode."""
    if "peaks" not in rows:
        return []
    lines = [
        [
            f"{row['ratio']:g}",
            number(row["frequency"], 4),
            number(100 * row["damping"]),
            number(100 * row["error"], 2),
            number(100 * row["stated"], 2),
            str(row["harmonics"]),
        ]
        for row in rows["peaks"]["peaks"]
    ]
    head = ["F_N / F_E", "peak [Hz]", "damping [%]", "error of the peak [%]", "stated [%]", "highest harmonic"]
    return ["Resonances (2 x 10 elements) against the reference mode in time:", table(head, lines)]


def first_calls(rows: Rows) -> list[str]:
    """Compilation."""
    lines = [[name, number(row["cpu"])] for name, row in rows.items()]
    text = "First calls, in a new process that has to compile everything; later ones read the compiled code from disk:"
    return [text, table(["first call", "processor time [s]"], lines)] if lines else []


def stamp(rows: Rows) -> str:
    """Where and when, and what was shortened."""
    dates = sorted({row["date"] for row in rows.values()})
    quick = [name for name, row in rows.items() if row["quick"]]
    short = f" Short runs (`--quick`): {'; '.join(quick)}." if quick else ""
    processor = next(iter(rows.values()))["machine"]["processor"]
    shared = "The machine was shared with other work: ratios within a run hold, single times are too long."
    return f"Measured {' to '.join(dates)} on {processor}. From `python -m tests.bench.simulate`.{short} {shared}"
