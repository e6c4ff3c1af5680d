"""Random systems, automatic fit: do the stated intervals hold the truth, in every corner, and how wide are they?

Every system is drawn anew: 2 to 60 modes, 3 to 500 outputs, 1 to 4 references, 0.1, 1 or 5 % noise, 1 to 10 averages. A
mode that is identifiable and not accepted counts as not covered.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.stats import beta

from tests.bench.cases import Case, random_system
from tests.bench.draws import Knowledge, drawn
from tests.bench.scoring import cramer_rao
from tests.bench.stated import REACH, Stated, automatic, errors, finite

TITLE = "Random systems: coverage, recall and width of the intervals"
COUNT, QUICK = 240, 45
"""Systems of a full run and of a quick one."""
NOISES = (0.001, 0.01, 0.05)
AVERAGES = (1, 2, 3, 5, 10)
"""Averages behind the FRFs. One average tells no variance; of more, the variance is drawn from its distribution."""
CONFIDENCES = (0.0, 0.9, 0.98, 0.999, 1.0001)
"""Edges of the bins of the stated probability that an accepted mode is one, is nearest to itself and shows its shape."""
FEWEST = 400
"""Identifiable modes from which a bin is judged."""
FIELDS = (
    "frequency",
    "damping",
    "residues",
    "frequency over bound",
    "damping over bound",
    "zeta",
    "overlap",
    "place",
    "edge",
    "hertz",
)
BINS: dict[str, tuple[float, ...]] = {
    "noise": (0.0, 0.003, 0.03, 1.0),
    "zeta": (0.0, 0.002, 0.01, 0.03, 1.0),
    "overlap": (0.0, 0.1, 0.3, 1.0, np.inf),
    "place": (0.0, 1 / 3, 2 / 3, 1.0001),
    "edge": (0.0, 1.0, 3.0, 10.0, np.inf),
    "references": (0.5, 1.5, 2.5, 3.5, 4.5),
    "averages": (0.5, 1.5, 2.5, 4.0, 7.0, 11.0),
    "modes": (0.5, 5.5, 15.5, 30.5, 61.0),
    "outputs": (0.5, 10.5, 50.5, 150.5, 501.0),
}
"""Edges of the bins. overlap: half-power bandwidth over the distance to the next mode. place: in the band, 0 to 1. edge:
distance to the nearer end of the band in half-power bandwidths."""


@dataclass(frozen=True)
class Extent:
    """How large the systems are: most modes, most outputs, most complex values in a block of FRFs."""

    modes: int = 60
    outputs: int = 500
    values: int = 400_000


SMALL = Extent(modes=16, outputs=60, values=25_000)


def system(seed: int, number: int, extent: Extent) -> tuple[Case, int]:
    """The system of this number and its averages: noise levels in turn, then averages in turn, the rest at random."""
    rng = np.random.default_rng([seed, number])
    modes = round(np.exp(rng.uniform(np.log(1.5), np.log(extent.modes + 0.5))))
    references = int(rng.integers(1, 5))
    lines = int(rng.choice([401, 801, 1601, 3201]))
    most = max(3, min(extent.outputs, extent.values // (lines * references)))
    outputs = round(np.exp(rng.uniform(np.log(2.5), np.log(most + 0.5))))
    noise, averages = NOISES[number % 3], AVERAGES[number // 3 % 5]
    case = random_system(int(rng.integers(1, 2**31)), noise, max(2, modes), max(3, outputs), references, lines)
    known = Knowledge("", averages, known=averages > 1)
    return replace(case, frfs=drawn(case, known, rng)), averages


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One system, fitted: a row of ``FIELDS`` for every identifiable mode, and what was false."""
    case, averages = system(seed, number, SMALL if quick else Extent())
    identifiable = cramer_rao(case).identifiable
    bound = cramer_rao(case, residual_terms=True)
    _, outputs, references = case.frfs.values.shape
    about = {
        "number": number,
        "noise": case.noise,
        "averages": averages,
        "outputs": outputs,
        "references": references,
        "lines": len(case.frfs.frequencies),
        "modes": len(case.truth.poles),
    }
    frequency, zeta = case.truth.natural_frequencies, case.truth.damping_ratios
    width, (low, high) = 2 * zeta * frequency, case.band
    nan = np.full(len(frequency), np.nan)
    try:
        stated = automatic(case.frfs)
    except Exception as error:  # one system that fails must not hide the others; its modes are not covered
        about |= {"error": f"{type(error).__name__}: {error}", "false": [], "seconds": 0.0}
        values = [nan, nan, nan, nan, nan]
    else:
        found = errors(case, stated)
        wide = [nan.copy(), nan.copy()]
        hit, own = found.match >= 0, found.match[found.match >= 0]
        wide[0][hit] = stated.frequency_std[own] / bound.frequency_std[hit]
        wide[1][hit] = stated.damping_std[own] / bound.damping_std[hit]
        values = [found.frequency, found.damping, found.inside, *wide]
        about |= {
            "false": finite(stated.frequencies[list(found.false)], 2),
            "seconds": round(stated.seconds, 3),
            "accepted": len(stated.model.poles),
            "confidence": finite(_confidence(stated), 6),
            "sound": [mode not in found.false for mode in range(len(stated.model.poles))],
            "unidentifiable accepted": int(np.sum(hit & ~identifiable)),
            "unidentifiable covered": int(np.sum(np.abs(found.frequency[hit & ~identifiable]) <= REACH)),
        }
    columns = [
        *values,
        zeta,
        width / case.spacing,
        (frequency - low) / (high - low),
        np.minimum(frequency - low, high - frequency) / width,
        frequency,
    ]
    rows = np.array(columns).T[identifiable]
    return about | {"rows": [finite(row, 5) for row in rows]}


def _confidence(stated: Stated) -> np.ndarray:
    """Probability that each accepted mode is one, as stated."""
    told = stated.model.confidence
    return np.ones(len(stated.model.poles)) if told is None else np.asarray(told)


def line(row: dict) -> str:
    """One system as a line."""
    start = (
        f"system {row['number']:4} {row['outputs']:3} x {row['references']} x {row['lines']:4}, {row['modes']:2} modes, "
        f"noise {100 * row['noise']:g} %, {row['averages']} averages:"
    )
    if "error" in row:
        return f"{start} {row['error']}"
    values = _table([row])
    text = f"{start} {int(np.isfinite(values['frequency']).sum())} of {len(row['rows'])} identifiable"
    text += "".join(f", {name[0]} {100 * share:.0f} %" for name, share in coverage(values).items())
    return text + (f"; false {row['false']}" if row["false"] else "") + f"; {row['seconds']:.1f} s"


def _table(rows: list[dict]) -> dict[str, np.ndarray]:
    """Columns over the identifiable modes of all systems, those of the systems repeated."""
    values = np.array([mode for row in rows for mode in row["rows"]], float).reshape(-1, len(FIELDS))
    columns = dict(zip(FIELDS, values.T, strict=True))
    counts = [len(row["rows"]) for row in rows]
    for name in ("noise", "references", "averages", "modes", "outputs", "number"):
        columns[name] = np.repeat([float(row[name]) for row in rows], counts)
    return columns


def coverage(columns: dict[str, np.ndarray], chosen: np.ndarray | slice = slice(None)) -> dict[str, float]:
    """Share of the modes whose 95 % intervals hold the truth; a missed mode is not covered."""
    with np.errstate(invalid="ignore"):
        return {
            "frequency": float(np.mean(np.abs(columns["frequency"][chosen]) <= REACH)),
            "damping": float(np.mean(np.abs(columns["damping"][chosen]) <= REACH)),
            "residues": float(np.mean(np.nan_to_num(columns["residues"][chosen]))),
        }


def summary(rows: list[dict]) -> dict:
    """Coverage pooled and in bins, recall, false modes, and the stated standard deviations over the bound."""
    columns = _table(rows)
    count = len(columns["frequency"])
    found = np.isfinite(columns["frequency"])
    bins = []
    for name, edges in BINS.items():
        for low, high in pairwise(edges):
            chosen = (columns[name] >= low) & (columns[name] < high)
            if chosen.any():
                bins.append(
                    {
                        "what": name,
                        "from": low,
                        "to": min(high, 1e9),
                        "modes": int(chosen.sum()),
                        "found": int(found[chosen].sum()),
                        **coverage(columns, chosen),
                    }
                )
    both = np.maximum(columns["frequency over bound"], columns["damping over bound"])[found]
    wide = np.where(np.isfinite(both), both, 1e9)
    clean = sum(not row["false"] for row in rows)
    beyond = np.flatnonzero(found)[~(wide <= 2)]
    return {
        "systems": len(rows),
        "failed": [row["error"] for row in rows if "error" in row],
        "modes": count,
        "found": int(found.sum()),
        "recall": float(found.mean()) if count else float("nan"),
        "coverage": coverage(columns),
        "bins": bins,
        "false": sum(len(row["false"]) for row in rows),
        "systems without false": clean,
        "systems without false, least": least_share(clean, len(rows)),
        "confidence": _calibration(rows),
        "over bound": {name: _spread(columns[f"{name} over bound"][found]) for name in ("frequency", "damping")},
        "beyond twice the bound": [
            {
                "system": int(columns["number"][index]),
                "hertz": float(columns["hertz"][index]),
                "zeta": float(columns["zeta"][index]),
                "frequency": _number(columns["frequency over bound"][index]),
                "damping": _number(columns["damping over bound"][index]),
            }
            for index in beyond
        ],
        "seconds": float(sum(row["seconds"] for row in rows)),
    }


def _calibration(rows: list[dict]) -> list[dict]:
    """Of the accepted modes by their stated confidence: how many are false, and how many it says are."""
    told = np.array([value for row in rows for value in row.get("confidence", [])], float)
    sound = np.array([value for row in rows for value in row.get("sound", [])], bool)
    result = []
    for low, high in pairwise(CONFIDENCES):
        chosen = (told >= low) & (told < high)
        result.append(
            {
                "from": low,
                "to": min(high, 1.0),
                "modes": int(chosen.sum()),
                "false": int(np.sum(~sound[chosen])),
                "stated false": float(np.sum(1 - told[chosen])),
            }
        )
    return result


def _number(value: float) -> float:
    return float(value) if np.isfinite(value) else 1e9


def _spread(ratio: np.ndarray) -> dict[str, float]:
    """A mode for which no standard deviation is stated counts as infinitely wide (1e9)."""
    ratio = np.where(np.isfinite(ratio), ratio, 1e9)
    if not len(ratio):
        return dict.fromkeys(("median", "within two", "largest", "smallest"), 0.0)
    return {
        "median": float(np.median(ratio)),
        "within two": float(np.mean(ratio <= 2)),
        "largest": float(ratio.max()),
        "smallest": float(ratio.min()),
    }


def least_share(good: int, count: int, level: float = 0.95) -> float:
    """One-sided lower bound of a share (Clopper and Pearson 1934): the largest that ``good`` of ``count`` exclude."""
    return float(beta.ppf(1 - level, good, count - good + 1)) if good else 0.0


def report(found: dict) -> str:
    """The summary in words, bins outside 91 to 98 % first."""

    def shares(one: dict) -> str:
        return " / ".join(f"{100 * one[name]:.1f}" for name in ("frequency", "damping", "residues"))

    lines = [
        f"{found['systems']} systems, {found['modes']} identifiable modes, {found['found']} accepted "
        f"({100 * found['recall']:.2f} %), {found['false']} false, {found['systems without false']} systems without "
        f"(at least {100 * found['systems without false, least']:.1f} %), {len(found['failed'])} failed, "
        f"{found['seconds']:.0f} s in the fits",
        f"coverage of f / zeta / residues: {shares(found['coverage'])} %",
    ]
    for name, own in found["over bound"].items():
        lines.append(
            f"stated std of {name} over the bound: median {own['median']:.3f}, {100 * own['within two']:.2f} % within "
            f"2, {own['smallest']:.2f} to {own['largest']:.3g}"
        )
    for one in found["confidence"]:
        lines.append(
            f"confidence {one['from']:g} to {one['to']:g}: {one['modes']} modes, {one['false']} false, "
            f"{one['stated false']:.1f} stated"
        )
    for one in found["bins"]:
        mark = "    " if one["modes"] < FEWEST else "  ok" if _inside(one) else "  !!"
        lines.append(
            f"{mark} {one['what']:10} {one['from']:7.4g} to {one['to']:7.4g}: {shares(one):22} % of {one['modes']} modes"
        )
    return "\n".join(lines)


def _inside(one: dict) -> bool:
    return all(0.91 <= one[name] <= 0.98 for name in ("frequency", "damping", "residues"))
