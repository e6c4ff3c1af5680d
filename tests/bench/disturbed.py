"""How a fit takes errors that are not noise: coverage, false modes, and whether the right cause is named.

Every disturbance of :mod:`tests.bench.disturbances`, :mod:`tests.bench.disturbances_nonlinear` and
:mod:`tests.bench.disturbances_shaker` at five strengths. A draw
is *wrong* where an error of an accepted value is beyond what its interval explains: root mean square over the accepted
values above two stated standard deviations, or one value above four (by chance in 1 of 3000 draws of five modes).
"""

from dataclasses import replace

import numpy as np

from ema.data import ModalModel, poles_from
from tests.bench import disturbances, disturbances_nonlinear, disturbances_shaker
from tests.bench.disturbances import Disturbed, Row
from tests.bench.scoring import cramer_rao, mac
from tests.bench.stated import REACH, Errors, Stated, automatic, errors, finite
from tests.bench.systems import least_share

TITLE = "Errors that are not noise"
ROWS: tuple[Row, ...] = (*disturbances.ROWS, *disturbances_nonlinear.ROWS, *disturbances_shaker.ROWS)
STRENGTHS = 5
COUNT, QUICK = 300 * STRENGTHS * len(ROWS), STRENGTHS * len(ROWS)
"""Fits of a full run, 300 draws of each disturbance at each strength, and of a quick one."""
WRONG_MEAN, WRONG_SINGLE = 2.0, 4.0
NAMES = tuple(dict.fromkeys(code for row in ROWS for code in row.causes))
"""Codes of findings that name a cause."""


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One draw: disturbances in turn, then strengths in turn."""
    row, strength = ROWS[number % len(ROWS)], number // len(ROWS) % STRENGTHS
    rng = np.random.default_rng([seed, number])
    drawn = row.make(rng, row.strengths[strength])
    about = {"row": row.key, "strength": strength}
    try:
        stated = automatic(drawn.case.frfs)
    except Exception as error:  # a fit that fails is a result
        return about | {"error": f"{type(error).__name__}: {error}"}
    found = errors(replace(drawn.case, truth=nearest_truth(drawn, stated)), stated)
    identifiable = _identifiable(drawn)
    hit = found.match >= 0
    return about | {
        "modes": int(identifiable.sum()),
        "found": int(np.sum(hit & identifiable)),
        "false": len(found.false),
        "false hertz": finite(stated.frequencies[list(found.false)], 2),
        "frequency": finite(found.frequency[hit]),
        "damping": finite(found.damping[hit]),
        "residues": finite(found.inside[hit]) if drawn.residues else [],
        "wrong": wrong(found, drawn.residues),
        "codes": [code for code in stated.findings if code in NAMES],
        "candidates": stated.candidates,
        "seconds": round(stated.seconds, 3),
    }


def nearest_truth(drawn: Disturbed, stated: Stated) -> ModalModel:
    """The truth, or where it depends on the amplitude that truth of its range which is nearest to what is stated."""
    truth = drawn.case.truth
    if drawn.frequency is None or drawn.damping is None or not len(stated.model.poles):
        return truth
    frequency, damping = truth.natural_frequencies.copy(), truth.damping_ratios.copy()
    alike = mac(truth.shapes, stated.model.shapes) >= 0.8
    for mode in range(len(frequency)):
        clipped = np.clip(stated.frequencies, *drawn.frequency[mode])
        distance = np.where(alike[mode], np.abs(stated.frequencies - clipped), np.inf)
        best = int(np.argmin(distance))
        if distance[best] <= 0.01 * frequency[mode]:
            frequency[mode] = clipped[best]
            damping[mode] = np.clip(stated.damping[best], *drawn.damping[mode])
    return replace(truth, poles=poles_from(frequency, damping))


def _identifiable(drawn: Disturbed) -> np.ndarray:
    """Modes that noise alone leaves to be found; all where the truth is not one linear system, or in signals."""
    if drawn.frequency is not None or drawn.case.noise_std.shape != drawn.case.frfs.values.shape:
        return np.ones(len(drawn.case.truth.poles), bool)
    return cramer_rao(drawn.case).identifiable


def wrong(found: Errors, residues: bool) -> bool:
    """Whether accepted values err beyond what their intervals explain."""
    hit = found.match >= 0
    parts = [found.frequency[hit], found.damping[hit], *([found.distance[hit]] if residues else [])]
    values = np.abs(np.concatenate(parts))
    if not len(values):
        return False
    return bool(np.sqrt(np.mean(values**2)) > WRONG_MEAN or values.max() > WRONG_SINGLE)


def line(row: dict) -> str:
    """One draw as a line."""
    start = f"{row['row']:22} strength {row['strength']}:"
    if "error" in row:
        return f"{start} {row['error']}"
    text = f"{start} {row['found']} of {row['modes']}, false {row['false']}{', wrong' if row['wrong'] else ''}"
    return text + (f", named {'+'.join(row['codes'])}" if row["codes"] else "")


def summary(rows: list[dict]) -> dict:
    """For each disturbance and strength: coverage of accepted values, false modes, wrong draws and what names them."""
    cells = []
    for row in ROWS:
        for strength, value in enumerate(row.strengths):
            own = [one for one in rows if one["row"] == row.key and one["strength"] == strength]
            if own:
                cells.append({"row": row.key, "strength": strength, "value": value} | _cell(own, row.causes))
    names = {}
    for code in NAMES:
        others = [
            one for one in rows if "error" not in one and (code not in _causes(one["row"]) or one["strength"] == 0)
        ]
        named = sum(code in one["codes"] for one in others)
        names[code] = {"draws": len(others), "named": named}
    return {"cells": cells, "names": names, "draws": len(rows)}


def _causes(key: str) -> tuple[str, ...]:
    return next(row.causes for row in ROWS if row.key == key)


def _cell(own: list[dict], causes: tuple[str, ...]) -> dict:
    ended = [one for one in own if "error" not in one]
    wrong_ones = [one for one in ended if one["wrong"]]
    clean = sum(one["false"] == 0 for one in ended)
    return {
        "draws": len(own),
        "failed": len(own) - len(ended),
        "accepted": sum(one["found"] for one in ended),
        "modes": sum(one["modes"] for one in ended),
        "frequency": _share([abs(v) <= REACH for one in ended for v in one["frequency"]]),
        "damping": _share([abs(v) <= REACH for one in ended for v in one["damping"]]),
        "residues": _share([v for one in ended for v in one["residues"]]),
        "false": sum(one["false"] for one in ended),
        "runs without false": clean,
        "runs without false, least": least_share(clean, len(ended)) if ended else 0.0,
        "wrong": len(wrong_ones),
        "wrong and named": sum(bool(set(one["codes"]) & set(causes)) for one in wrong_ones),
        "named": sum(bool(set(one["codes"]) & set(causes)) for one in ended),
    }


def _share(values: list) -> float | None:
    return float(np.mean(values)) if values else None


def report(found: dict) -> str:
    """The summary in words."""

    def percent(value: float | None) -> str:
        return "  -  " if value is None else f"{100 * value:5.1f}"

    names = ("frequency", "damping", "residues")
    lines = ["disturbance, strength: accepted of modes; coverage f / zeta / residues; false; wrong draws (named)"]
    for one in found["cells"]:
        shares = [one[name] for name in names]
        low = any(value is not None and value < 0.9 for value in shares)
        lines.append(
            f"{'!!' if low or one['false'] or one['failed'] else '  '} {one['row']:21} {one['value']:8g}: "
            f"{one['accepted']:4} of {one['modes']:4}; {' / '.join(map(percent, shares))} %; false {one['false']:3}; "
            f"wrong {one['wrong']} of {one['draws']} ({one['wrong and named']} named); failed {one['failed']}"
        )
    for row in ROWS:
        own = [one for one in found["cells"] if one["row"] == row.key and one["strength"]]
        if own:
            means = [_share([one[name] for one in own if one[name] is not None]) for name in names]
            lines.append(
                f"{row.key:23} mean over strengths 1 to 4: {' / '.join(map(percent, means))} %; false "
                f"{sum(one['false'] for one in own)}; wrong {sum(one['wrong'] for one in own)} of "
                f"{sum(one['draws'] for one in own)} ({sum(one['wrong and named'] for one in own)} named)"
            )
    for code, one in found["names"].items():
        lines.append(f"   {code}: reported without its cause in {one['named']} of {one['draws']} draws")
    return "\n".join(lines)
