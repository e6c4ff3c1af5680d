"""Writes ``docs/speed.md``, ``docs/accuracy.md``, ``docs/files.md`` and tables of ``docs/simulate.md`` from the results.

``python -m tests.bench.write_docs``: every figure on those pages comes from a run.
"""

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from tests.bench.environments import NAMES
from tests.bench.fit import OURS, RESULT
from tests.bench.uff import RESULT as UFF

DOCS = Path(__file__).resolve().parents[2] / "docs"
TOLD = {
    OURS: "nothing",
    "sdypy_ema": "the true frequencies",
    "pyfbs": "the true frequencies",
    "pyyeti": "nothing",
    "pyoma2": "the true frequencies",
    "pydvma": "the true frequencies",
}

SPEED = """# Speed

All systems run on the same cases in one run, each in a process of its own with one thread, warmed up on another case.
Short runs are taken three times and the fastest counts. *Poles* is the time for the poles of all model orders;
*selection* is what follows until the chosen modes are there, which for friction-ema includes their shapes and residues.
Both are processor times, which other work on the machine disturbs least; the wall clock stands beside them. *Memory* is
the high-water mark above what the process held before, over the size of the FRFs. Medians over the seeds.

This page is written by `python -m tests.bench.write_docs` from the figures of `python -m tests.bench.fit`.
"""


AGE = {
    "speed.md": ("fit", "simulate", "hammer", "uff", "study", "placement", "archive"),
    "accuracy.md": ("accuracy", "fit"),
    "large.md": ("large", "machines", "recordings"),
}
"""Results that each page shows."""


def older(benches: tuple[str, ...]) -> str:
    """A paragraph that names the figures which are older than the code they describe; empty where none is."""
    from tests.bench import provenance

    old = [name for name, stored in provenance.published().items() if provenance.outdated(stored)]
    mine = [name for name in old if name.partition(",")[0] in benches]
    if not mine:
        return ""
    return (
        "\n\n**Older than the code:** these figures were measured with an earlier version and do not describe the present "
        f"one: {'; '.join(mine)}. They are replaced when their bench runs again."
    )


def median(runs: Iterable[dict], value: Callable[[dict], float]) -> float:
    """Median over the runs that ended; NaN where none did."""
    known = [value(run) for run in runs if "error" not in run]
    return float(np.median(known)) if known else float("nan")


def total(run: dict) -> float:
    """Poles and selection in seconds."""
    return run["time_poles"] + run["time_selection"]


def table(head: list[str], lines: list[list[str]]) -> str:
    """A Markdown table."""
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def number(value: float, digits: int = 3) -> str:
    """Three significant digits; a dash for NaN."""
    if not np.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if value == 0 or 1e-3 <= abs(value) < 1e4 else f"{value:.{digits - 1}e}"


def seconds(value: float) -> str:
    """Three significant digits, milliseconds at the finest."""
    return "<0.001" if 0 <= value < 1e-3 else number(value)


def name(system: str, runs: list[dict]) -> str:
    """Name and version."""
    versions = [run["version"] for run in runs if "version" in run]
    return f"{NAMES.get(system, system)} {versions[0]}" if versions else NAMES.get(system, system)


def stamp(row: dict) -> str:
    """Date, machine and seeds."""
    machine = row["machine"]
    seeds = ", ".join(map(str, row["seeds"]))
    return (
        f"Measured {row['date']} on {machine['processor']} ({machine['cores']} cores, {machine['system']}), Python "
        f"{machine['python']}, numpy {machine['numpy']}, scipy {machine['scipy']}, numba {machine['numba']}. "
        f"Seeds: {seeds}."
    )


def failures(runs: dict[str, list[dict]]) -> str:
    """What did not end, as a list."""
    lines = [
        f"- {name(system, own)}, seed {run['seed']}: {run['error']}"
        for system, own in runs.items()
        for run in own
        if "error" in run
    ]
    return "\n".join(lines)


def speed(row: dict) -> str:
    """Section of one case on the page about speed."""
    runs = row["runs"]
    ours = median(runs[OURS], total)
    lines = []
    for system, own in runs.items():
        poles = median(own, lambda run: run["time_poles"])
        lines.append(
            [
                name(system, own),
                seconds(poles),
                seconds(median(own, lambda run: run["time_selection"])),
                seconds(median(own, total)),
                seconds(median(own, lambda run: run["time_wall"])),
                number(median(own, lambda run: run["extra_memory"] / run["data_bytes"]), 2),
                "" if system == OURS else number(poles / ours),
            ]
        )
    head = [
        "system",
        "poles [s]",
        "selection [s]",
        "both [s]",
        "wall clock [s]",
        "memory / data",
        "poles over friction-ema's poles and selection",
    ]
    return "\n\n".join(filter(None, [f"## {row['title']}", table(head, lines), failures(runs), stamp(row)]))


def accuracy(row: dict) -> str:
    """Section of one case on the page about accuracy."""
    lines = []
    for system, own in row["runs"].items():
        ended = [run for run in own if "error" not in run]
        lines.append(
            [
                name(system, own),
                TOLD[system],
                " + ".join(f"{run['found']}" for run in ended) or "-",
                " + ".join(f"{run['identifiable']}" for run in ended) or "-",
                " + ".join(f"{len(run['false'])}" for run in ended) or "-",
                number(100 * median(own, lambda run: run["damping_error"])),
                number(100 * median(own, lambda run: run["damping_bias"])),
                number(median(own, lambda run: run["frequency_ratio"])),
                number(median(own, lambda run: run["damping_ratio"])),
            ]
        )
    head = [
        "system",
        "given",
        "found",
        "identifiable",
        "false",
        "damping error, median [% of the value]",
        "damping error, mean [% of the value]",
        "frequency over the bound",
        "damping over the bound",
    ]
    parts = [f"## {row['title']}", table(head, lines)]
    best = row["runs"][OURS]
    parts.append(
        "friction-ema's residues: median error "
        f"{number(100 * median(best, lambda run: run['residue_error']))} %, largest "
        f"{number(100 * median(best, lambda run: run['residue_error_largest']))} % (medians over the seeds). The bound "
        f"allows {number(100 * median(best, lambda run: run['bound_damping']))} % of the damping ratio and "
        f"{number(100 * median(best, lambda run: run['bound_frequency']))} % of the frequency (medians over the modes)."
    )
    return "\n\n".join(filter(None, [*parts, misses(row["runs"]), stamp(row)]))


def misses(runs: dict[str, list[dict]]) -> str:
    """Every miss and every false mode of every system, as a list."""
    lines = []
    for system, own in runs.items():
        for run in own:
            if "error" in run:
                lines.append(f"- {name(system, own)}, seed {run['seed']}: {run['error']}")
                continue
            words = []
            if run["missed"]:
                words.append("missed " + ", ".join(f"{f:g} Hz ({100 * z:.2f} %)" for f, z in run["missed"]))
            if run["false"]:
                words.append("false " + ", ".join(f"{f:g} Hz" for f in run["false"]))
            if words:
                lines.append(f"- {name(system, own)}, seed {run['seed']}: " + "; ".join(words))
    return (
        "\n".join(["Misses (frequency, damping ratio) and false modes:\n", *lines]) if lines else "No miss, none false."
    )


def selection(row: dict) -> str:
    """Section on random systems: the automatic selection with default settings."""
    own = row["runs"][OURS]
    lines = []
    for noise in sorted({run["noise"] for run in own}):
        runs = [run for run in own if run["noise"] == noise]
        ended = [run for run in runs if "error" not in run]
        wanted, found = sum(run["identifiable"] for run in ended), sum(run["found"] for run in ended)
        lines.append(
            [
                f"{100 * noise:g} %",
                str(len(runs)),
                str(wanted),
                str(found),
                number(100 * found / wanted, 4) if wanted else "-",
                number(sum(len(run["false"]) for run in ended) / max(len(ended), 1)),
                str(len(runs) - len(ended)),
            ]
        )
    head = ["noise", "systems", "identifiable modes", "found", "recall [%]", "false modes per system", "failed"]
    text = (
        "friction-ema with default settings on random systems: 5-60 modes, damping ratios of 0.05-10 %, every tenth gap "
        "0.3-1 % of the frequency, one mode in ten local, 8-500 outputs, 1-4 references."
    )
    return "\n\n".join([f"## {row['title'].capitalize()}", text, table(head, lines), misses(row["runs"]), stamp(row)])


def universal_files(result: dict) -> str:
    """Section about universal files on the page about speed."""
    formats = [("58b, binary", result["58b"]), ("58, text", result["58"])]
    peer = f"pyuff {result['machine']['pyuff']}"
    lines = [
        [
            title,
            number(own["read sets [MB/s]"]),
            number(own["pyuff read [MB/s]"]),
            number(own["write [MB/s]"]),
            number(own["pyuff write [MB/s]"]),
        ]
        for title, own in formats
    ]
    listed = [
        [
            title.removeprefix("1 GB of "),
            f"{own['sets']:.0f}",
            f"{own['lines per set']:.0f}",
            number(own["list [ms]"]),
            number(own["time to read sets / time to list"]),
            number(own["time to read to an FRF set / time to list"]),
        ]
        for title, own in result.items()
        if title.startswith("1 GB")
    ]
    rates = ["read", f"{peer} reads", "write", f"{peer} writes"]
    parts = [
        f"## Universal files: 160 sets x 6401 complex lines, against {peer} in the same run",
        "Megabytes per second of processor time, from `python -m tests.bench.uff`:",
        table(["format", *rates], lines),
    ]
    if listed:
        columns = ["format", "sets", "lines per set", "list [ms]", "reading the sets takes", "reading to FRFs takes"]
        parts += [
            "Listing the sets of a 1 GB file without reading their values:",
            table(columns, listed),
            "The last two columns are multiples of the time to list.",
        ]
    return "\n\n".join(parts)


_RECORDS = {"one": "five of one impact", "many": "one of five impacts", "lone": "one of one impact"}


def percent(value: float) -> str:
    """A ratio in percent."""
    return f"{100 * value:.2g}"


def hammer_tests(result: dict) -> str:
    """Section about hammer tests on the page about speed."""
    peer = f"sdypy-FRF {result['sdypy-FRF']['version']}"
    single = result["second contacts"]
    lines = [
        ["clean impact, flagged", f"{single['clean']['wrong']} of {single['clean']['cases']}"],
        ["second contact 2-30 ms after the first, missed", f"{single['near']['wrong']} of {single['near']['cases']}"],
        ["second contact later in the block, missed", f"{single['later']['wrong']} of {single['later']['cases']}"],
    ]
    tests = []
    for records, kinds in result["records"].items():
        clean = kinds["clean"]
        alarms = f"{clean['false alarms']} of {clean['cases']}"
        tests.append([_RECORDS[records], "none", "", "", "", alarms, percent(clean["median error"])])
        tests += [
            [
                _RECORDS[records],
                delays,
                *(f"{a} of {b}" for a, b in of["found"].values()),
                "",
                percent(of["median error"]),
            ]
            for delays, of in kinds.items()
            if delays != "clean"
        ]
    return "\n\n".join(
        [
            "## Hammer tests: 80 points x 5 impacts x 2 responses x 16384 samples to FRFs",
            table(
                ["system", "processor time [s]"],
                [
                    ["friction-ema, with all verdicts", number(result["ours"]["cpu"])],
                    [peer, number(result["sdypy-FRF"]["cpu"])],
                ],
            ),
            "Second contacts in signals with anti-alias ringing, sensor undershoot and noise, pulses of 0.3-5 ms:",
            table(["case", "wrong"], lines),
            "Whole tests with second contacts of 10, 20 and 50 % of one impact, on structures of two to five modes; the "
            "last column is the median error of the FRFs, relative to the true ones:",
            table(["records", "delay", "10 % found", "20 % found", "50 % found", "false alarms", "error [%]"], tests),
            f"{peer} flags {100 * result['sdypy-FRF']['clean impacts flagged']:.0f} % of the clean impacts. Seed {result['seed']}. "
            "From `python -m tests.bench.hammer`.",
        ]
    )


def archives(result: dict) -> str:
    """Section about archives, with the command that measured it."""
    from tests.bench import archive

    command, read = "python -m tests.bench.archive", result["built runs"] * result["campaigns"] // result["runs"]
    return archive.section(result).replace(f"`{command}`", f"`{command} --read {read}`")


def main() -> None:
    """Write the pages."""
    from tests.bench import (  # they use the tables of this module
        accuracy_page,
        archive,
        brake_reuss_replay,
        files,
        joint_law,
        joint_law_page,
        joint_maps,
        placement,
        simulate_page,
        stated_errors_page,
        study,
    )

    rows = json.loads(RESULT.read_text())["rows"]
    cases = [row for key, row in rows.items() if key != "random"]
    others = [
        section(json.loads(file.read_text()))
        for file, section in (
            (UFF, universal_files),
            (RESULT.with_name("hammer.json"), hammer_tests),
            (placement.RESULT, placement.section),
            (study.RESULT, study.section),
            (archive.RESULT, archives),
        )
        if file.exists()
    ]
    simulator = RESULT.with_name("simulate.json")
    if simulator.exists():
        others.append(simulate_page.simulator(json.loads(simulator.read_text())["rows"]))
    pages = {
        "speed.md": [SPEED, *map(speed, cases), *others],
        "accuracy.md": [accuracy_page.HEAD, *accuracy_page.sections(), *map(accuracy, cases)],
    }
    DOCS.mkdir(exist_ok=True)
    for page, sections in pages.items():
        sections = [sections[0].strip() + older(AGE[page]), *sections[1:]]
        (DOCS / page).write_text("\n\n".join(section.strip() for section in sections) + "\n", encoding="utf-8")
    (DOCS / "files.md").write_text(files.page(), encoding="utf-8")
    stated_errors_page.write()
    joint_law_page.write(DOCS / "joint.md", joint_law.RESULT)
    for name, mark, part in (
        ("compare.md", "joint maps", joint_maps.section),
        ("prediction.md", "map predictions", joint_maps.predictions),
    ):
        page = DOCS / name
        page.write_text(joint_maps.write(page.read_text(encoding="utf-8"), mark, part), encoding="utf-8")
    page = DOCS / "prediction.md"
    page.write_text(brake_reuss_replay.write(page.read_text(encoding="utf-8")), encoding="utf-8")
    page = DOCS / "large.md"
    before, begin, rest = page.read_text(encoding="utf-8").partition("<!-- age -->\n")
    after = rest.partition("<!-- end -->")[2]
    page.write_text(f"{before}{begin}{older(AGE['large.md']).lstrip()}\n<!-- end -->{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
