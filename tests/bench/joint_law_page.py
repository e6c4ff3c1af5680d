"""The calibration of the joint of publications as text and as a part of docs/joint.md."""

import json
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Limits of the weights that are counted together; 0.05 and 0.95 are those of a decision."""
_BEGIN, _END = "<!-- calibration: begin -->", "<!-- calibration: end -->"


def counts(tables: list[dict[str, Any]]) -> list[str]:
    """Lines that say how often intervals and weights are right."""
    return [" ".join(cells) for cells in [*_held(tables), *_weights(tables)]]


def section(stored: dict[str, Any]) -> str:
    """The counts as tables of the page."""
    from tests.bench.write_docs import older  # that module writes this page

    tables = stored["tables"]
    lines = [
        f"{len(tables)} tables, {sum(one['one'] for one in tables)} of them with one joint, of the prior of the paper's file "
        f"({', '.join(sorted({str(one['runs']) for one in tables}))} runs of the sampler each; 95 % intervals of the counts, "
        "parameters of one table as one draw).",
        "",
        "| 95 % intervals | hold the truth |",
        "|---|---|",
        *(f"| {' | '.join(cells)} |" for cells in _held(tables)),
        "",
        "| weight given to one joint | tables that have one joint |",
        "|---|---|",
        *(f"| {' | '.join(cells)} |" for cells in _weights(tables)),
        "",
        f"Measured {stored['date']} on {stored['machine']['processor']} ({stored['machine']['cores']} cores).",
    ]
    return "\n".join(lines) + older(("joint_law",))


def _held(tables: list[dict[str, Any]]) -> list[list[str]]:
    rows = [["all", _share([float(np.mean(list(one["held"].values()))) for one in tables])]]
    sure = [float(np.mean([one["held"][name] for name in one["determined"]])) for one in tables if one["determined"]]
    rows.append([f"called determined, in {len(sure)} tables", _share(sure)])
    named: dict[str, list[float]] = defaultdict(list)
    for one in tables:
        for name, held in one["held"].items():
            named[name].append(float(held))
    lowest = sorted(named, key=lambda name: float(np.mean(named[name])))[:3]
    return rows + [[f"lowest: {name}", _share(named[name])] for name in lowest]


def _share(parts: list[float]) -> str:
    """Mean over the tables, with the 95 % interval of a bootstrap over them."""
    if not parts:
        return "none"
    rng = np.random.default_rng(0)
    means = rng.choice(parts, (2000, len(parts))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return f"{100 * np.mean(parts):.1f} % [{100 * low:.1f}, {100 * high:.1f}] of {len(parts)}"


def _weights(tables: list[dict[str, Any]]) -> list[list[str]]:
    weight = np.array([one["weight"] for one in tables])
    has_one = np.array([one["one"] for one in tables])
    rows = []
    for low, high in pairwise(EDGES):
        there = (weight >= low) & ((weight < high) | (high == 1.0))
        count, right = int(there.sum()), int(has_one[there].sum())
        if count:
            # Clopper and Pearson (1934), Biometrika 26:404
            ends = beta.ppf([0.025, 0.975], [right or 1e-9, right + 1], [count - right + 1, count - right or 1e-9])
            rows.append(
                [
                    f"{low:g} to {high:g}, {weight[there].mean():.2f} in the mean",
                    f"{right} of {count} [{100 * ends[0]:.0f}, {100 * ends[1]:.0f} %]",
                ]
            )
    return rows


def write(page: Path, result: Path) -> None:
    """Put the counts between the marks of the page."""
    before, rest = page.read_text(encoding="utf-8").split(_BEGIN)
    made = section(json.loads(result.read_text(encoding="utf-8")))
    page.write_text(f"{before}{_BEGIN}\n{made}\n{_END}{rest.split(_END)[1]}", encoding="utf-8")
