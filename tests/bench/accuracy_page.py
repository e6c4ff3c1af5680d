"""Sections of the accuracy page from the results of ``python -m tests.bench.accuracy``."""

import json
from pathlib import Path

import numpy as np

from tests.bench import judged_page
from tests.bench.accuracy_goals import goals
from tests.bench.environments import NAMES
from tests.bench.fit import OURS
from tests.bench.write_docs import TOLD, misses, name, number, selection, stamp, table

RESULT = Path(__file__).parent / "results" / "accuracy.json"

NOT_CONTAINED = (
    "## What the intervals contain, and what not",
    "The intervals of a fit hold the noise of its FRFs as the scatter over lines shows it, and where a misfit limits the "
    "fit, that of the lines at the peaks. Those of frequencies and damping ratios also hold, where it is more than chance "
    "explains (the basis of the uncertainty then names it):",
    "- noise that the FRFs share, as those of one impact share the noise of its force: what the residuals of all FRFs on a "
    "line do to a pole together (sandwich variance over groups of lines);\n"
    "- what changes from one FRF to the next, as under a roving hammer (jackknife over the outputs);\n"
    "- what changes from impact to impact, or from block to block of a random test: the estimators keep the deviation of each "
    "from the average (of more than eight, of eight groups), and the fit says what each does to a pole (jackknife over the "
    "impacts). A resonance that wanders makes the average look damped more; that is in the interval of the damping ratio.",
    "All intervals, those of shapes and residues too, are as wide as if every residual term had been fitted. Terms that "
    "noise explains are left out of the values, which have smaller errors without them; but that they are nothing is a "
    "guess by the same data, and wide modes and modes at the ends of the band resemble them.",
    "From a few points or impacts this is known badly. All modes determine the level together, what was seen of each is weighed "
    "with it, and Student's t widens what exceeds the noise. Sweeps keep no deviations. The intervals "
    "of shapes and residues hold the noise over lines alone, as if each FRF had noise of its own.",
    "Errors that neighbouring lines share are in the intervals: the correlation of the residual over lines is, and what "
    "windows, averages over lines, appended zeros and the end of the record do is recognised or taken from the FRF set "
    "([faults](faults.md)).",
    "They do not hold what all FRFs of one test share while each stays clean:",
    "- what changes between two tests: a moved sensor and its mass, temperature, suspension. A resonance that moves by a "
    "hundredth of a half-power width is more than the noise of a good test;\n"
    "- a structure that is not linear: friction depends on the amplitude;\n"
    "- channels that are late by a few microseconds: their phases are those of complex modes ([faults](faults.md) says "
    "from when on a delay is named);\n"
    "- assembly: screws tightened anew, the normal force going up and down.",
    "Repeats show them. `ema run` separates noise from the scatter between assemblies and calls a difference significant "
    "from repeats alone ([Repeats](campaign.md#repeats)); without them its words are *noise only; assembly scatter unknown*.",
)

HEAD = """# Accuracy

Synthetic FRFs with known truth, real measurements split into halves, and peers on the same data. Everything on this
page is written by `python -m tests.bench.accuracy` (and, for the larger cases at the end, `python -m tests.bench.fit`)
from what it measured; seeds are drawn at run time.

- **Noise of 1 %** means a complex standard deviation of 1 % of |H| at each line plus 1 % of that FRF's root mean square
  over the band. The systems are viscous with non-proportional damping; the modes outside the band are included exactly.
- **Bound**: Cramér-Rao, of the model which made the data: unknown poles, participations and complex shapes of all modes
  inside and outside the band, and a known noise level. A fit that has to find out more (the noise level, and
  whether there are residual terms, which the data have not) lies above 1: a little for narrow modes, by 1.3 and more
  for wide ones near an end of the band. Where it matters, the bound of a model with an upper and a lower residual of
  every FRF stands beside it.
- A mode is **identifiable** when its standard deviations by that bound are below 10 % of the damping ratio and a fifth
  of the distance to its neighbour.
- **Found**: frequency within 1 % and nearer to it than to its neighbour, MAC of at least 0.8, one to one. **False**:
  returned and matched to nothing.
- **Residue error**: norm of the error over the norm, of the whole residue matrix of a mode.
"""


def sections() -> list[str]:
    """What has been measured, in the order of the page."""
    known = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    writers = {
        "case": case,
        "small": small,
        "random": random_systems,
        "residues": residues,
        "cost": cost,
        "listed": listed,
        "halves": halves,
        "peers": peers,
    }
    written = {section: write(known[section]) for section, write in writers.items() if section in known}
    compared = written.pop("peers", "")
    judged = judged_page.sections(known)
    return [goals(known), *judged, *written.values(), "\n\n".join(NOT_CONTAINED), *filter(None, [compared])]


def measured(section: dict) -> str:
    """Date, machine and time taken."""
    text = stamp(section | {"seeds": []}).removesuffix(" Seeds: .")
    return f"{text} {section['seconds']:.0f} s of processor time." if section["seconds"] else text


def case(section: dict) -> str:
    """Errors over the bound on the 160-FRF case."""
    text = (
        "20 modes in 100-900 Hz: a pair 0.4 % apart, one mode with 5 % damping, strong modes 5 % outside the band on both "
        "sides. Each row is one system and that many noise draws, fitted with default settings."
    )
    return "\n\n".join(["## Error over the bound: 80 outputs x 2 references x 1601 lines", text, *over_bound(section)])


def small(section: dict) -> str:
    """Errors over the bound on the small case."""
    text = (
        "5 modes in 100-500 Hz, all of them identifiable: a pair 1.5 % apart, one mode with 5 % damping, modes 5 % outside "
        "the band on both sides."
    )
    return "\n\n".join(["## Error over the bound: 8 outputs x 2 references x 401 lines", text, *over_bound(section)])


def over_bound(section: dict) -> list[str]:
    """Two tables: errors over the bound, and coverage of the intervals."""
    errors, intervals, worst = [], [], []
    for row in section["found"]:
        start = [f"{100 * row['noise']:g} %", row["knowledge"], f"{row['draws']}"]
        f, z = row["frequency over bound"], row["damping over bound"]
        errors.append(
            [
                *start,
                number(f["pooled"], 4),
                number(z["pooled"], 4),
                f"{f['smallest']:.2f}-{f['largest']:.2f}",
                f"{z['smallest']:.2f}-{z['largest']:.2f}",
                f"{f['band'][0]:.2f}-{f['band'][1]:.2f}",
                f"{len(f['above']) + len(z['above'])} of {2 * row['modes']}",
                f"{f['bias']:+.3f}",
                f"{z['bias']:+.3f}",
                f"{row['missed']} of {row['draws'] * row['modes']}",
                f"{row['false']}",
            ]
        )
        intervals.append(
            [
                *start,
                percent(row["frequency coverage"]),
                percent(row["damping coverage"]),
                percent(row["residues coverage"]),
                percent(row["residue median"]),
                percent(row["residue largest"]),
                number(row["residue over bound"]),
                number(row["residue over bound, worst mode"]),
                str(row["seed"]),
            ]
        )
        for what, own in (("frequency", f), ("damping", z)):
            for mode in own["above"]:
                hertz, zeta = row["truth"][mode]
                worst.append(
                    f"- {start[0]}, {start[1]}: {what} of {hertz:g} Hz ({100 * zeta:.2f} %): {own['single'][mode]:.2f}, "
                    f"of which bias {own['single bias'][mode]:+.2f}"
                )
    return [
        "Root mean square errors over the bound's standard deviation, pooled over modes and draws, and of single modes "
        "with the band in which all of an efficient estimator's lie together with 99 % probability; the bias is the mean "
        "error in standard deviations.",
        table(
            [
                "noise",
                "noise level",
                "draws",
                "f pooled",
                "ζ pooled",
                "f single",
                "ζ single",
                "99 % band",
                "above",
                "f bias",
                "ζ bias",
                "missed",
                "false",
            ],
            errors,
        ),
        "\n".join(["Single modes above the band:\n", *worst]) if worst else "No single mode is above the band.",
        "Coverage of the 95 % intervals (pooled over modes and draws; residues: real and imaginary parts), and the error of "
        "the residues:",
        table(
            [
                "noise",
                "noise level",
                "draws",
                "f [%]",
                "ζ [%]",
                "residues [%]",
                "residue error median [%]",
                "largest [%]",
                "residues over the bound",
                "worst mode",
                "seed",
            ],
            intervals,
        ),
        measured(section),
    ]


def random_systems(section: dict) -> str:
    """Recall and false modes on random systems."""
    return selection(section["found"] | {"date": section["date"], "machine": section["machine"]})


def residues(section: dict) -> str:
    """Residues with a mode 5 % outside the band."""
    row = section["found"]
    lines = [
        [
            f"{100 * row['noise']:g} %",
            f"{row['systems']}",
            percent(np.median(row["median"])),
            percent(np.max(row["median"])),
            percent(np.median(row["largest"])),
            percent(np.max(row["largest"])),
            number(float(np.sqrt(np.mean(np.square(row["over bound"]))))),
            percent(np.median(row["bound median"])),
            percent(np.median(row["bound largest"])),
            percent(np.max(row["bound largest"])),
            f"{sum(row['missed'])}",
        ]
    ]
    head = [
        "noise",
        "systems",
        "median [%]",
        "largest median [%]",
        "largest, median over systems [%]",
        "largest of all [%]",
        "rms over the bound",
        "bound: median [%]",
        "bound: largest, median over systems [%]",
        "bound: largest of all [%]",
        "modes missed",
    ]
    text = (
        "One draw on each of several systems of the 160-FRF case; the first mode outside lies 5 % beyond the band edge."
    )
    return "\n\n".join(
        [
            "## Residues with strong modes just outside the band",
            text,
            table(head, lines),
            measured(section) + f" Seed: {row['seed']}.",
        ]
    )


def cost(section: dict) -> str:
    """Cost of the refinement."""
    runs = section["found"]["runs"]
    poles, chosen, modes = (np.median([run[part] for run in runs]) for part in ("poles", "selection", "modes"))
    lines = [[number(poles), number(chosen), number(modes - chosen), number((modes - chosen) / (poles + chosen))]]
    head = ["poles [s]", "selection [s]", "after it [s]", "after it / poles and selection"]
    text = (
        "160-FRF case, 1 % noise, processor time, best of three, median over the seeds. The selection refines the poles it "
        "chooses from; what comes after it is the last refinement, residues, intervals and scaling."
    )
    return "\n\n".join(["## Cost of refinement and intervals", text, table(head, lines), measured(section)])


def listed(section: dict) -> str:
    """Real data against what is listed with them."""
    lines = [
        [
            own["title"],
            one["what"],
            f"{one['expected']:g}",
            f"{one['tolerance']:.2g}",
            number(one["found"], 6),
            "met" if one["met"] else "missed",
        ]
        for own in section["found"]
        for one in own["numbers"]
    ]
    text = (
        "The recipes in `reports/`, with the band given and nothing else, against the values and tolerances that go with the "
        "data."
    )
    head = ["measurement", "what", "listed", "tolerance", "found", ""]
    return "\n\n".join(["## Real measurements against their references", text, table(head, lines), measured(section)])


def halves(section: dict) -> str:
    """Real data."""
    lines = [
        [
            row["title"],
            f"{row['splits']}",
            f"{min(map(min, row['modes']))} to {max(map(max, row['modes']))}",
            f"{row['pairs']}",
            percent(row["frequency within"]),
            percent(row["damping within"]),
            number(row["frequency median"]),
            number(row["damping median"]),
            f"{row['seed']}",
        ]
        for row in section["found"]
    ]
    head = [
        "measurement",
        "splits",
        "modes in the halves",
        "pairs",
        "f within [%]",
        "ζ within [%]",
        "f: median difference / s",
        "ζ: median difference / s",
        "seed",
    ]
    text = (
        "Two halves of one real measurement, each fitted by itself, fully automatic. *Within*: the difference is less than "
        "1.96 s with s = sqrt(s1² + s2²) of the two stated standard deviations; for intervals that hold all scatter it "
        "would be 95 %, and the median difference 0.67 s. The halves of the first rest on four or five points, those of the "
        "second on two or three impacts, those of the third on four blocks: such scatter is known badly, and Student's t "
        "makes intervals of it that are on the wide side more often than not."
    )
    return "\n\n".join(["## Real measurements, halves against each other", text, table(head, lines), measured(section)])


def peers(section: dict) -> str:
    """Peers on the same draws."""
    parts = [
        "## Peers on the same data: 80 outputs x 2 references x 1601 lines, 20 modes, orders to 60",
        "Systems without an automatic selection are given the true frequencies and give the stable pole nearest to each. The "
        "shapes of the peers are computed from their poles by one and the same least-squares fit, with the true poles "
        "outside the band. Medians over the seeds; a number in each column that counts modes is one seed.",
    ]
    for row in section["found"]:
        lines = []
        for system, own in row["runs"].items():
            ended = [run for run in own if "error" not in run]
            if not ended:
                continue

            def middle(key: str, runs: list[dict] = ended) -> float:
                return float(np.median([run[key] for run in runs]))

            lines.append(
                [
                    name(system, own),
                    TOLD[system],
                    " + ".join(f"{run['found']}" for run in ended),
                    " + ".join(f"{len(run['false'])}" for run in ended),
                    percent(middle("damping_error")),
                    percent(middle("damping_bias")),
                    number(middle("frequency_ratio")),
                    number(middle("damping_ratio")),
                    percent(middle("residue_error")),
                    percent(middle("residue_error_largest")),
                    number(middle("time_poles") + middle("time_selection")),
                ]
            )
        head = [
            "system",
            "given",
            "found of 20",
            "false",
            "ζ error, median [%]",
            "ζ error, mean [%]",
            "f over the bound",
            "ζ over the bound",
            "residue error, median [%]",
            "largest [%]",
            "processor time [s]",
        ]
        failed = [
            f"- {NAMES.get(system, system)}: {run['error']}"
            for system, own in row["runs"].items()
            for run in own
            if "error" in run
        ]
        parts += [f"### {row['title']}", table(head, lines), "\n".join(failed), misses({OURS: row["runs"][OURS]})]
        parts.append(f"Seeds: {', '.join(map(str, row['seeds']))}.")
    return "\n\n".join(filter(None, [*parts, measured(section)]))


def percent(value: float) -> str:
    """Of a fraction."""
    return number(100 * float(value))
