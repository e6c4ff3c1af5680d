"""The first table of the accuracy page: what was asked, what was reached, and why a figure falls short."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.bench.fit import OURS
from tests.bench.write_docs import number, table

WANTED = {"case": 100, "small": 1000, "systems": 240, "residues": 30, "roots": 320, "setups": 300, "time": 100}
"""Draws or systems of a full run."""
SHORT = Path(__file__).parent / "results" / "accuracy_short.json"
"""Why a figure falls short, by the key of its row: written by hand after looking, and shown where it still does. What was
seen on one drawn system carries its ``seed``, and is shown of that system alone.
"""


@dataclass(frozen=True)
class Row:
    """One line: what is asked of which quantity, what was reached, and whether that is enough.

    ``likely``: what is missing is less than what chance does to this many draws (two standard deviations).
    """

    key: str
    quantity: str
    goal: str
    reached: str
    met: bool
    likely: bool = False

    @property
    def word(self) -> str:
        """Reached, short, or undecided by chance."""
        return "reached" if self.met else "short, within chance" if self.likely else "**short**"


def goals(known: dict) -> str:
    """The table over all sections that have been measured, and below it the reasons of what falls short."""
    makers: dict[str, Callable[[dict], list[Row]]] = {
        "case": case,
        "small": small,
        "random": selection,
        "residues": residues,
        "cost": cost,
        "listed": listed,
        "halves": halves,
    }
    from tests.bench import judged_goals  # it uses the rows of this module

    rows = judged_goals.rows(known)
    rows += [row for section, make in makers.items() if section in known for row in make(known[section]["found"])]
    if not rows:
        return ""
    head = ["quantity", "goal", "reached", ""]
    lines = [[row.quantity, row.goal, row.reached, row.word] for row in rows]
    reasons = json.loads(SHORT.read_text(encoding="utf-8")) if SHORT.exists() else {}
    short = [row for row in rows if not row.met]
    seeds = {drawn["seed"] for section in ("case", "small") for drawn in known.get(section, {}).get("found", [])}
    why = [
        f"- **{row.quantity}** ({row.reached}): {reason['text']}"
        for row in short
        if (reason := reasons.get(row.key)) and reason.get("seed") in {None, *seeds}
    ]
    parts = ["## Goals", *unfinished(known), table(head, lines)]
    return "\n\n".join([*parts, "Where a figure falls short, and why:", "\n".join(why)] if why else parts)


def unfinished(known: dict) -> list[str]:
    """A sentence on what has fewer draws than a full run."""
    counts = {
        "case": lambda found: found[0]["draws"],
        "small": lambda found: found[0]["draws"],
        "systems": lambda found: found["systems"],
        "residues": lambda found: found["systems"],
        "roots": lambda found: sum(kind["plates"] for kind in found["kinds"].values()),
        "setups": lambda found: sum(cell["structures"] for cell in found["cells"]),
        "time": lambda found: sum(size["runs"] for size in found["sizes"].values()),
    }
    titles = {
        "case": "draws of the 160-FRF case",
        "small": "draws of the 16-FRF case",
        "systems": "random systems",
        "residues": "systems for the residues",
        "roots": "plates with repeated roots",
        "setups": "structures in several set-ups",
        "time": "runs for the processor times",
    }
    done = {name: count(known[name]["found"]) if name in known else 0 for name, count in counts.items()}
    said = [f"{done[name]} of {wanted} {titles[name]}" for name, wanted in WANTED.items() if done[name] < wanted]
    others = {
        "halves": "halves of real measurements",
        "disturbed": "disturbances",
        "invariance": "rescaled sets",
    }
    said += [f"no {title}" for name, title in others.items() if name not in known]
    levels = [row["title"] for row in known.get("peers", {"found": []})["found"]]
    said += [f"peers at {' and '.join(levels) or 'no noise level'}"] if len(levels) < 3 else []
    return (
        [f"These figures are of a part of a full run: {', '.join(said)}. `--resume` goes on with it."] if said else []
    )


def case(found: list[dict]) -> list[Row]:
    """The 160-FRF case."""
    return [one for row in found for one in over_bound(row, "160 FRFs, 20 modes", "case")]


def small(found: list[dict]) -> list[Row]:
    """The 16-FRF case; its draws are enough to judge the coverage."""
    return [
        one
        for row in found
        for one in (*over_bound(row, "16 FRFs, 5 modes", "small"), *coverage(row, "16 FRFs, 5 modes", "small"))
    ]


def over_bound(row: dict, title: str, section: str) -> list[Row]:
    """Error over the bound, single modes, and bias of one noise level."""
    f, z = row["frequency over bound"], row["damping over bound"]
    start = f"{title}, {100 * row['noise']:g} % noise, noise level {row['knowledge']}, {row['draws']} draws: "
    key = f"{section} {row['noise']:g} {row['knowledge']}"
    above, bias = len(f["above"]) + len(z["above"]), max(abs(f["bias"]), abs(z["bias"]))
    single = max(f["largest"], z["largest"])
    count = max(row["draws"] * row["modes"] - row["missed"], 1)
    spread = 2 / np.sqrt([2 * count, count])
    chance = f"(± {spread[0]:.3f} by chance)", f"(± {spread[1]:.3f} s by chance)"
    pooled = max(f["pooled"], z["pooled"])
    other = row.get("over bound with residual terms")
    wide = ("", "")
    if other is not None:
        of_both = f"{other['frequency']:.3f} and {other['damping']:.3f}"
        wide = (
            f"; {of_both} of the bound with residual terms",
            f"; {other['largest']:.2f} of the bound with residual terms",
        )
    lost = f"{row['missed']} of {row['draws'] * row['modes']} missed, {row['false']} false"
    return [
        Row(
            f"{key} pooled",
            f"{start}rms error of f and ζ over the bound, pooled",
            "≤ 1.05",
            f"{f['pooled']:.3f} and {z['pooled']:.3f} {chance[0]}{wide[0]}; {lost}",
            pooled <= 1.05,
            pooled - spread[0] <= 1.05,
        ),
        Row(
            f"{key} single",
            f"{start}single modes above the simultaneous 99 % band",
            "none",
            f"{above} of {2 * row['modes']}, the largest {single:.2f} (band to {f['band'][1]:.2f}){wide[1]}",
            not above,
        ),
        Row(
            f"{key} bias",
            f"{start}pooled bias of f and ζ",
            "≤ 0.1 s",
            f"{f['bias']:+.3f} and {z['bias']:+.3f} s {chance[1]}",
            bias <= 0.1,
            bias - spread[1] <= 0.1,
        ),
    ]


def coverage(row: dict, title: str, section: str) -> list[Row]:
    """Coverage of the 95 % intervals of one noise level."""
    parts = [row[f"{name} coverage"] for name in ("frequency", "damping", "residues")]
    start = f"{title}, {100 * row['noise']:g} % noise, noise level {row['knowledge']}, {row['draws']} draws: "
    chance = 2 * np.sqrt(0.05 * 0.95 / max(row["draws"] * row["modes"] - row["missed"], 1))
    off = np.abs(np.array(parts) - 0.95) - [0.01, 0.01, 0.02]
    told = " / ".join(f"{100 * part:.1f} %" for part in parts) + f" (± {100 * chance:.1f} % by chance)"
    return [
        Row(
            f"{section} {row['noise']:g} {row['knowledge']} coverage",
            f"{start}coverage of the 95 % intervals",
            "94-96 % for f and ζ, 93-97 % for residues",
            told,
            bool((off <= 0).all()),
            bool((off <= chance).all()),
        )
    ]


def selection(found: dict) -> list[Row]:
    """Recall and false modes on random systems."""
    rows = []
    runs = [run for run in found["runs"][OURS] if "error" not in run]
    for noise in sorted({run["noise"] for run in runs}):
        own = [run for run in runs if run["noise"] == noise]
        wanted = sum(run["identifiable"] for run in own)
        recall, false = sum(run["found"] for run in own) / wanted, sum(len(run["false"]) for run in own) / len(own)
        least = 0.995 if noise <= 0.01 else 0.98
        title = f"{len(own)} random systems, {100 * noise:g} % noise"
        rows.append(
            Row(
                f"random {noise:g}",
                f"{title}: recall of {wanted} identifiable modes / false modes per system",
                f"≥ {100 * least:g} % / ≤ 0.1",
                f"{100 * recall:.2f} % / {false:.2f}",
                recall >= least and false <= 0.1,
            )
        )
    return rows


def residues(row: dict) -> list[Row]:
    """Residues with a mode 5 % beyond the band edge."""
    middle, largest = float(np.median(row["median"])), float(np.max(row["largest"]))
    ratio = float(np.sqrt(np.mean(np.square(row["over bound"]))))
    allowed = f"{100 * np.median(row['bound median']):.2f} / {100 * np.max(row['bound largest']):.1f} %"
    title = f"{row['systems']} systems, mode 5 % beyond the band edge, {100 * row['noise']:g} % noise: residue error"
    return [
        Row(
            "residues",
            f"{title}, median / largest of all",
            "≤ 0.5 / 3 %",
            f"{100 * middle:.2f} / {100 * largest:.1f} % (the bound allows {allowed})",
            middle <= 0.005 and largest <= 0.03,
        ),
        Row("residues over bound", f"{title} over the bound", "≤ 1.1", number(ratio), ratio <= 1.1),
    ]


def cost(found: dict) -> list[Row]:
    """Refinement and intervals against poles and selection."""
    poles, chosen, modes = (np.median([run[part] for run in found["runs"]]) for part in ("poles", "selection", "modes"))
    ratio = float((modes - chosen) / (poles + chosen))
    goal = "≤ 1 x poles and selection"
    return [
        Row("cost", "160 FRFs: cost of the last refinement, residues and intervals", goal, number(ratio), ratio <= 1)
    ]


def listed(found: list[dict]) -> list[Row]:
    """Real data against their listed references."""
    rows = []
    for own in found:
        met, count = sum(one["met"] for one in own["numbers"]), len(own["numbers"])
        title = f"{own['title']}: listed frequencies and damping ratios within their tolerances"
        rows.append(Row(f"listed {own['key']}", title, "all", f"{met} of {count}", met == count))
    return rows


def halves(found: list[dict]) -> list[Row]:
    """Halves of real data against each other."""
    return [
        Row(
            f"halves {row['key']}",
            f"{row['title']}: differences of f / ζ within 1.96 s",
            "≥ 90 %",
            f"{100 * row['frequency within']:.0f} / {100 * row['damping within']:.0f} % of {row['pairs']} modes",
            min(row["frequency within"], row["damping within"]) >= 0.9,
        )
        for row in found
    ]
