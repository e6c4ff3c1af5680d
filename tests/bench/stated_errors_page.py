"""Coverage of stated errors and steady states from nothing on the page about the simulator.

From ``python -m tests.bench.stated_errors`` and ``python -m tests.bench.cold_starts``.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench import cold_starts, stated_errors
from tests.bench.friction_draws import LAWS
from tests.bench.stated_errors import KINDS, PATIENCE, TOLERANCES, counted
from tests.bench.write_docs import older, table

PAGE = Path(__file__).parents[2] / "docs" / "simulate.md"


def write() -> None:
    """Put the tables between their marks."""
    text = PAGE.read_text(encoding="utf-8")
    parts = {
        "stated errors": coverage(json.loads(stated_errors.RESULT.read_text())) + older(("stated_errors",)),
    }
    if cold_starts.RESULT.exists():
        parts["cold starts"] = from_nothing(json.loads(cold_starts.RESULT.read_text())) + older(("cold_starts",))
    for name, part in parts.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, rest = text.split(begin)
        text = f"{before}{begin}\n{part}\n{end}{rest.split(end)[1]}"
    PAGE.write_text(text, encoding="utf-8")


def wilson(hits: int, count: int, reach: float = 1.96) -> tuple[float, float]:
    """The 95 % interval of a share (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    share, z = hits / count, reach**2 / count
    middle, half = share + z / 2, reach * np.sqrt(share * (1 - share) / count + z / count / 4)
    return (middle - half) / (1 + z), (middle + half) / (1 + z)


def coverage(results: dict[str, Any]) -> str:
    """Tables of the coverage by law and tolerance."""
    parts = []
    for kind, title in (
        ("time", "Runs in time"),
        ("frequency", "Steady states, default settings"),
        ("verified", "Steady states, `verify=True`"),
    ):
        rows = results.get(kind, {}).get("rows", [])
        if not rows:
            continue
        lines = []
        tolerances = TOLERANCES if kind == "time" else (5e-3,)
        for law in (*LAWS, "all"):
            own = [row for row in rows if law in (row["law"], "all")]
            cells = [law]
            for tolerance in tolerances:
                fair, above = counted([row for row in own if row.get("tolerance") == tolerance])
                low, high = wilson(len(fair) - len(above), len(fair))
                cells.append(f"{len(fair) - len(above)} of {len(fair)} ({100 * low:.0f}-{100 * high:.0f} %)")
            fair, _ = counted(own)
            # Runs in which nothing slips are exact: their errors are those of the second solver (`counted`).
            ratio = [row["true"] / (row["stated"] + row["own"]) for row in fair]
            stated = [row["stated"] for row in fair]
            cells += [f"{np.median(ratio):.2f}", f"{np.max(ratio):.2g}"] if ratio else ["-", "-"]
            if kind != "time":
                cells += [f"{100 * np.median(stated):.2g} %" if stated else "-"]
                cpu = [row["cpu"] for row in own if "cpu" in row]
                cells += [f"{1e3 * np.median(cpu):.0f}" if cpu else "-"]
            lines.append(cells)
        head = ["law", *(f"tolerance {tolerance:g}" for tolerance in tolerances), "true/stated, median", "largest"]
        head += [] if kind == "time" else ["stated, median", "ms, median"]
        drawn = len({(row["law"], row["seed"]) for row in rows})
        fair, _ = counted(rows)
        late = sum("late" in row for row in rows)
        without = sum("solved" in row and not row["solved"] for row in rows)
        unsettled = len(rows) - late - without - len(fair)
        text = (
            f"{title}: {drawn} models, {len(fair)} results judged; {unsettled} whose truth was not known closely enough"
        )
        text += f", {late} given up after {PATIENCE} s" + (
            f", {without} without a solution." if kind != "time" else "."
        )
        parts += [text, table(head, lines)]
    stamps = sorted({results[kind]["stamp"]["commit"] for kind in results if kind in KINDS})
    return "\n\n".join([*parts, f"From `python -m tests.bench.stated_errors`, commit {', '.join(stamps)}."])


def from_nothing(result: dict[str, Any]) -> str:
    """How many random points have a steady state, by law, and what they cost."""
    points, lines = result["points"], []
    for law in (*sorted({point["law"] for point in points}), "all"):
        own = [point for point in points if law in (point["law"], "all")]
        cpu = [point["cpu"] for point in own]
        found = [point for point in own if point["found"]]
        # below a thousandth, the time solver from rest repeats its motion
        settled = [point["time solver, change over 20 periods"] < 1e-3 for point in own if not point["found"]]
        lines.append(
            [
                law,
                f"{len(own)}",
                f"{len(own) - len(found)}",
                f"{sum(settled)}",
                f"{1e3 * np.median(cpu):.0f}",
                f"{1e3 * np.quantile(cpu, 0.95):.0f}",
                f"{max(cpu):.1f}",
                f"{sum(point['error'] > 5e-3 for point in found)}",
                f"{100 * max(point['error'] for point in found):.2g} %",
                f"{max(point['power'] for point in found):.0e}",
            ]
        )
    head = ["law", "points", "not found", "of these, found in time", "ms, median", "ms, 95 %", "s, longest"]
    head += ["stated above 0.5 %", "stated, largest", "power balance / input, largest"]
    return "\n\n".join(
        [table(head, lines), f"From `python -m tests.bench.cold_starts`, commit {result['commit']}."],
    )
