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


OFF = 3.0
"""Standard deviations beyond which a law differs from the truth in some number or sentence."""
SURE = 0.95
"""Weight from which on a hypothesis is decided on."""


def counts(tables: list[dict[str, Any]]) -> list[str]:
    """Lines that say how often intervals and weights are right."""
    prior, like = _drawn(tables)
    parts = [part(prior) for part in (_held, _weights, _laws, _experiments)] if prior else []
    parts += [_laws(like), _experiments(like)] if like else []
    return [" ".join(cells) for rows in parts for cells in rows]


def _drawn(tables: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Tables whose joints are of the prior, and those whose joints the file leaves possible."""
    return [[one for one in tables if one["like"] is like] for like in (False, True)]


def section(stored: dict[str, Any]) -> str:
    """The counts as tables of the page."""
    from tests.bench.write_docs import older  # that module writes this page

    tables, like = _drawn(stored["tables"])
    lines = [
        f"{len(tables)} tables, {sum(one['one'] for one in tables)} of them with one joint, of every law as many, of the prior "
        f"of the paper's file ({', '.join(sorted({str(one['runs']) for one in tables}))} runs of the sampler each; 95 % "
        "intervals of the counts, parameters of one table as one draw).",
        *_table("95 % intervals, over all laws", "hold the truth", _held(tables)),
        *_table("weight given to one joint", "tables that have one joint", _weights(tables)),
        *_table("weight given to a law", "laws that are those of their table", _laws(tables)),
        *_table(
            "experiment, on one outcome of every table",
            "the right one has 0.95 after it (predicted)",
            _experiments(tables),
        ),
        *_of_possible(like),
        "",
        f"Measured {stored['date']} on {stored['machine']['processor']} ({stored['machine']['cores']} cores), "
        f"{np.mean([one['seconds'] for one in tables]):.0f} s of processor time for a table.",
    ]
    return "\n".join(lines) + older(("joint_law",))


def _of_possible(like: list[dict[str, Any]]) -> list[str]:
    if not like:
        return []
    left, right = "weight given to a law", "laws that are those of their table"
    return [
        "",
        f"{len(like)} tables of joints that the paper's file leaves possible, under each law in turn:",
        *_table(left, right, _laws(like)),
        *_table("experiment", "the right one has 0.95 after it (predicted)", _experiments(like)),
    ]


def _table(left: str, right: str, rows: list[list[str]]) -> list[str]:
    return ["", f"| {left} | {right} |", "|---|---|", *(f"| {' | '.join(cells)} |" for cells in rows)]


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
    return _binned(weight, np.array([one["one"] for one in tables]))


def _laws(tables: list[dict[str, Any]]) -> list[list[str]]:
    """Weights of all laws of all tables by bins, then those of laws that differ from the truth."""
    cells = [(row, one) for one in tables for row in one["laws"].items()]
    weight = np.array([row[1][0] for row, _ in cells])
    rows = _binned(weight, np.array([row[0] == one["law"] for row, one in cells]))
    differ = [row[1][0] < 1 - SURE for row, one in cells if row[0] != one["law"] and one["off"][row[0]] > OFF]
    rows.append(
        [f"below {1 - SURE:.2f}, of laws more than three standard deviations off", _part(sum(differ), len(differ))]
    )
    kept = [one["laws"][one["law"]][0] >= 1 - SURE for one in tables]
    rows.append([f"{1 - SURE:.2f} or more, of the laws of the tables", _part(sum(kept), len(kept))])
    return rows


def _experiments(tables: list[dict[str, Any]]) -> list[list[str]]:
    rows = []
    for name in tables[0]["experiments"]:
        made = [one["experiments"][name] for one in tables if name in one["experiments"]]
        predicted, after = np.array(made).T
        share = np.nanmean(predicted) if np.isfinite(predicted).any() else float("nan")
        rows.append([name, f"{_part(int((after > SURE).sum()), len(made))} ({100 * share:.0f} %)"])
    return rows


def _part(right: int, count: int) -> str:
    """A count with its 95 % interval (Clopper and Pearson 1934, Biometrika 26:404)."""
    if not count:
        return "none"
    ends = beta.ppf([0.025, 0.975], [right or 1e-9, right + 1], [count - right + 1, count - right or 1e-9])
    return f"{right} of {count} [{100 * ends[0]:.0f}, {100 * ends[1]:.0f} %]"


def _binned(weight: np.ndarray, is_right: np.ndarray) -> list[list[str]]:
    """How many hypotheses of about the same weight are right."""
    rows = []
    for low, high in pairwise(EDGES):
        there = (weight >= low) & ((weight < high) | (high == 1.0))
        if there.any():
            count = _part(int(is_right[there].sum()), int(there.sum()))
            rows.append([f"{low:g} to {high:g}, {weight[there].mean():.2f} in the mean", count])
    return rows


def write(page: Path, result: Path) -> None:
    """Put the counts between the marks of the page."""
    before, rest = page.read_text(encoding="utf-8").split(_BEGIN)
    made = section(json.loads(result.read_text(encoding="utf-8")))
    page.write_text(f"{before}{_BEGIN}\n{made}\n{_END}{rest.split(_END)[1]}", encoding="utf-8")
