"""Many noise draws on one system: errors over the Cramer-Rao bound and coverage of the intervals."""

from dataclasses import dataclass, replace
from importlib import import_module

import numpy as np
from scipy.stats import chi2, norm

import ema.fit
from ema.data import FrfSet, ModalModel
from tests.bench.cases import Case, unit_noise
from tests.bench.scoring import Bound, score

SIMULTANEOUS = 0.99
"""Probability with which all single modes of an efficient estimator lie inside their band at once."""
COVERAGE = 0.95


@dataclass(frozen=True)
class Knowledge:
    """What the fit is told about the noise: nothing, its variance, or a variance from so many averages."""

    name: str
    averages: int | None = None
    known: bool = True


UNTOLD = Knowledge("unknown", known=False)
KNOWN = Knowledge("known")
FIVE = Knowledge("from 5 averages", averages=5)


def drawn(case: Case, knowledge: Knowledge, rng: np.random.Generator) -> FrfSet:
    """The FRFs of the case with new noise, and with what is known about it."""
    values = case.clean + case.noise_std * unit_noise(rng, case.clean.shape)
    if not knowledge.known:
        return replace(case.frfs, values=values)
    variance = case.noise_std**2
    if knowledge.averages is None:
        return replace(case.frfs, values=values, variance=variance)
    freedom = 2 * (knowledge.averages - 1)
    averages = np.full(case.clean.shape[1:], float(knowledge.averages))
    variance = variance * rng.chisquare(freedom, variance.shape) / freedom
    return replace(case.frfs, values=values, variance=variance, averages=averages)


def one(case: Case, bound: Bound, knowledge: Knowledge, seed: list[int]) -> dict:
    """One draw, fitted with default settings: errors of each true mode over the bound and over its own interval.

    ``frequency``, ``damping``: error over the standard deviation of the bound; ``own frequency``, ``own damping``: over
    the standard deviation that the fit states; ``residue``: norm of the error over that of the residue matrix;
    ``residues inside``: share of its real and imaginary parts that lie in their 95 % intervals. ``None`` where missed.
    """
    frfs = drawn(case, knowledge, np.random.default_rng(seed))
    model = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
    scored = score(case, model, bound)
    match, hit = scored.match, scored.match >= 0
    own_frequency, own_damping, inside = (np.full(len(match), np.nan) for _ in range(3))
    if model.covariance is not None:
        std = np.sqrt(np.maximum(model.covariance[match[hit]][:, [0, 1], [0, 1]], 1e-300))
        own_frequency[hit] = (scored.frequency_error * case.truth.natural_frequencies)[hit] / std[:, 0]
        own_damping[hit] = (scored.damping_error * case.truth.damping_ratios)[hit] / std[:, 1]
    for mode in np.flatnonzero(hit):
        inside[mode] = residues_inside(case, model, int(mode), int(match[mode]))
    return {
        "frequency": _plain(scored.frequency_ratio),
        "damping": _plain(scored.damping_ratio),
        "own frequency": _plain(own_frequency),
        "own damping": _plain(own_damping),
        "residue": _plain(scored.residue_error),
        "residues inside": _plain(inside),
        "false": len(scored.false),
    }


def residues_inside(case: Case, model: ModalModel, mode: int, place: int) -> float:
    """Share of the real and imaginary parts of a residue matrix whose 95 % interval holds the truth.

    NaN where the fit states no intervals of residues.
    """
    statement = _residue_std(model)
    if statement is None:
        return float("nan")
    error = case.truth.residues()[mode] - model.residues()[place]
    std = statement[place]
    parts = np.stack([error.real / std.real, error.imag / std.imag])
    return float(np.mean(np.abs(parts) <= norm.ppf(0.5 + COVERAGE / 2)))


def _residue_std(model: ModalModel) -> np.ndarray | None:
    """Standard deviations of the residues (mode, dof, in), real and imaginary part; ``None`` where not offered."""
    try:
        verb = import_module("ema.fit.uncertainty").residue_std
    except (ImportError, AttributeError):
        return None
    return verb(model)


def summary(draws: list[dict], bound: Bound, residue_bound: np.ndarray) -> dict:
    """Pooled and per-mode statistics of many draws."""
    stack = {name: np.array([draw[name] for draw in draws], float) for name in draws[0] if name != "false"}
    count = len(draws)
    wanted = bound.identifiable
    pooled = {name: stack[name][:, wanted] for name in stack}
    return {
        "draws": count,
        "modes": int(wanted.sum()),
        "missed": int(np.isnan(pooled["frequency"]).sum()),
        "false": sum(draw["false"] for draw in draws),
        **{f"{name} over bound": _against_bound(pooled[name]) for name in ("frequency", "damping")},
        **{f"{name} coverage": _coverage(pooled[f"own {name}"]) for name in ("frequency", "damping")},
        "residues coverage": _mean(pooled["residues inside"]),
        "residue median": _nan(np.nanmedian, pooled["residue"]),
        "residue largest": _nan(np.nanmax, pooled["residue"]),
        "residue over bound": _rms(pooled["residue"] / residue_bound[wanted]),
        "residue over bound, worst mode": float(
            np.nanmax(np.sqrt(np.nanmean((pooled["residue"] / residue_bound[wanted]) ** 2, axis=0)))
        ),
    }


def band(count: int, statistics: int) -> tuple[float, float]:
    """Where the root mean square of ``count`` standard normal errors lies, for all ``statistics`` of them at once."""
    tail = (1 - SIMULTANEOUS) / statistics / 2
    low, high = chi2.ppf([tail, 1 - tail], count)
    return float(np.sqrt(low / count)), float(np.sqrt(high / count))


def _against_bound(errors: np.ndarray) -> dict:
    """Errors (draw, mode) in units of the bound: pooled, per mode against the simultaneous band, and bias."""
    count = len(errors)
    low, high = band(count, 2 * errors.shape[1])
    single = np.sqrt(np.nanmean(errors**2, axis=0))
    bias = np.nanmean(errors, axis=0)
    return {
        "pooled": _rms(errors),
        "bias": _mean(errors),
        "band": [low, high],
        "largest": float(single.max()),
        "smallest": float(single.min()),
        "above": [int(mode) for mode in np.flatnonzero(single > high)],
        "single": [round(float(value), 4) for value in single],
        "single bias": [round(float(v), 4) for v in bias],
    }


def _coverage(errors: np.ndarray) -> float:
    known = errors[np.isfinite(errors)]
    return float(np.mean(np.abs(known) <= norm.ppf(0.5 + COVERAGE / 2))) if len(known) else float("nan")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(_mean(values**2)))


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _nan(function, values: np.ndarray) -> float:
    return float(function(values)) if np.isfinite(values).any() else float("nan")


def _plain(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 5) if np.isfinite(value) else None for value in values]
