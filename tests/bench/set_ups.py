"""Roving set-ups that do not agree: the temperature changes between them, or the roving sensors load the structure.

A structure is measured in two to five set-ups with the same forces. In kind *common shift* all natural frequencies of a
set-up are off by one factor; in kind *mass loading* the sensors of a set-up add their mass where they sit, which lowers
each mode by half the mass times the square of its shape there, to first order (it is solved exactly here).
"""

from dataclasses import dataclass, replace

import numpy as np

from acquisition.setups import Part, merge
from ema.data import FrfSet, ModalModel, poles_from
from ema.dof import Dof
from tests.bench.cases import Case, _log_uniform, _spread, noise_std, unit_noise
from tests.bench.scoring import mac
from tests.bench.stated import REACH, Stated, automatic, errors, finite
from tests.bench.systems import least_share

TITLE = "Set-ups that do not agree"
COUNT, QUICK = 300, 24
KINDS = ("common shift", "mass loading")
SIZES = (0.0, 0.0003, 0.001, 0.003, 0.01)
"""Largest relative shift of a natural frequency between set-ups."""
CAUSES = ("setup-shift", "mass-loading")
"""Findings that say that the set-ups do not agree; their warning or error counts."""
LINES = 801


@dataclass(frozen=True)
class SetUps:
    """FRFs of each set-up, the structure without shift or sensors (``case``), true shifts and damping of each mode there,
    (set-up, mode)."""

    parts: tuple[FrfSet, ...]
    case: Case
    shifts: np.ndarray
    damping: np.ndarray
    kind: str
    size: float


@dataclass(frozen=True)
class Merged:
    """What is stated of several set-ups: accepted modes, relative shift of each set-up against their mean, and its std."""

    stated: Stated
    shifts: np.ndarray | None
    shifts_std: np.ndarray | None


def merged(parts: tuple[FrfSet, ...]) -> Merged:
    """The set-ups joined and fitted as the estimator offers it; the one place that knows how."""
    whole = merge([Part(frfs, f"{number + 1}") for number, frfs in enumerate(parts)], "set-ups")
    stated = automatic(whole)
    found = stated.model.set_ups
    if found is None:
        return Merged(stated, None, None)
    return Merged(stated, found.common, found.common_std)


def made(seed: int, number: int) -> SetUps:
    """Kinds in turn, then sizes in turn; the rest at random."""
    rng = np.random.default_rng([seed, number])
    kind, size = KINDS[number % len(KINDS)], SIZES[number // len(KINDS) % len(SIZES)]
    modes, count, references = int(rng.integers(4, 11)), int(rng.integers(2, 6)), int(rng.integers(1, 3))
    each = int(rng.integers(3, 9))
    outputs = count * each
    natural = np.concatenate([_spread(rng, modes, 100.0, 500.0), [65.0, 640.0]])
    order = np.argsort(natural)
    natural = natural[order]
    zeta = _log_uniform(rng, 0.002, 0.01, len(natural))
    x = (np.arange(outputs) + rng.uniform(0, 1, outputs)) / outputs
    shapes = np.array([np.cos(np.pi * (mode + 1) * x + 0.4) for mode in range(len(natural))]).T
    shapes += 0.15 * rng.standard_normal(shapes.shape)
    forces = _visible(rng, shapes, references)
    owner = rng.permutation(np.repeat(np.arange(count), each))
    omega = 2 * np.pi * natural
    if kind == "common shift":
        factors = np.concatenate([[0.0], rng.uniform(-1, 1, count - 1)])
        span = np.ptp(factors)
        shifts = np.tile((size * factors / span)[:, None], (1, len(natural)))
        masses = np.zeros(count)
    else:
        shifts = np.zeros((count, len(natural)))
        load = [np.sum(shapes[owner == part][:, 1:-1] ** 2, axis=0).max() for part in range(count)]
        masses = np.full(count, 2 * size / max(load))
    dofs = tuple(Dof(node, "+Z") for node in range(1, outputs + 1))
    inputs = tuple(dofs[row] for row in forces)
    frequencies = np.linspace(100.0, 500.0, LINES)
    parts, own_shifts, own_damping = [], [], []
    for part in range(count):
        rows = np.flatnonzero(owner == part)
        local = omega * (1 + shifts[part])
        mass = np.eye(len(omega)) + masses[part] * shapes[rows].T @ shapes[rows]
        clean = _responses(frequencies, mass, local, zeta, shapes[rows], shapes[forces])
        std = noise_std(clean, 0.005)
        parts.append(
            FrfSet(
                frequencies=frequencies,
                values=clean + std * unit_noise(rng, std.shape),
                outputs=tuple(dofs[row] for row in rows),
                inputs=inputs,
                quantity="accelerance",
                unit="m/s^2/N",
                estimator="synthetic",
                name=f"set-up {part + 1}",
            )
        )
        poles = _poles(mass, local, zeta)
        own_shifts.append(np.abs(poles) / omega - 1)
        own_damping.append(-poles.real / np.abs(poles))
    inside = (natural >= 100.0) & (natural <= 500.0)
    truth, outside = (
        ModalModel(
            poles=poles_from(natural[keep], zeta[keep]),
            shapes=shapes[:, keep].astype(complex),
            dofs=dofs,
            participation=shapes[forces][:, keep] / (2j * poles_from(natural[keep], zeta[keep]).imag),
            inputs=inputs,
            scaling="unit modal mass",
        )
        for keep in (inside, ~inside)
    )
    case = Case("set-ups", seed, 0.005, parts[0], np.zeros(0), np.zeros(0), truth, outside)
    own = np.array(own_shifts)[:, inside], np.array(own_damping)[:, inside]
    return SetUps(tuple(parts), case, *own, kind, size)


def _poles(mass: np.ndarray, omega: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Poles of M = ``mass``, K = diag(w^2), D = diag(2 z w), ascending, from the state matrix."""
    size = len(omega)
    stiffness, damping = (np.linalg.solve(mass, np.diag(row)) for row in (omega**2, 2 * zeta * omega))
    state = np.block([[np.zeros((size, size)), np.eye(size)], [-stiffness, -damping]])
    poles = np.linalg.eigvals(state)
    poles = poles[poles.imag > 0]
    return poles[np.argsort(np.abs(poles))]


def _visible(rng: np.random.Generator, shapes: np.ndarray, count: int) -> np.ndarray:
    """Rows for the forces, of those where the weakest mode is strongest."""
    weakest = np.abs(shapes).min(axis=1)
    return rng.choice(np.argsort(-weakest)[: max(3, count)], count, replace=False)


def _responses(
    frequencies: np.ndarray, mass: np.ndarray, omega: np.ndarray, zeta: np.ndarray, shapes: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Accelerance (freq, out, in) of M = ``mass``, K = diag(w^2), D = diag(2 z w) in modal coordinates."""
    w = 2 * np.pi * frequencies[:, None, None]
    dynamic = np.diag(omega**2) + 1j * w * np.diag(2 * zeta * omega) - w**2 * mass
    return -(w**2) * (shapes @ np.linalg.solve(dynamic, np.broadcast_to(at.T, (len(frequencies), *at.T.shape))))


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One structure in its set-ups. Values are right where their intervals meet the ranges over the set-ups."""
    drawn = made(seed, number)
    about = {"number": number, "kind": drawn.kind, "size": drawn.size, "set-ups": len(drawn.parts)}
    try:
        found = merged(drawn.parts)
    except Exception as error:  # a fit that fails is a result
        return about | {"error": f"{type(error).__name__}: {error}"}
    case = replace(drawn.case, truth=_in_order(drawn.case.truth, found.stated))
    truth = _nearest(case.truth, drawn, found.stated)
    scored = errors(replace(case, truth=truth), found.stated)
    natural = drawn.case.truth.natural_frequencies
    span = np.ptp(np.vstack([drawn.shifts, np.zeros(len(natural))]), axis=0) * natural
    apart = case.spacing > 2 * np.maximum(span, 1e-12)
    hit = scored.match >= 0
    inside = None
    if found.shifts is not None and found.shifts_std is not None:
        true = np.mean((1 + drawn.shifts) / np.mean(1 + drawn.shifts, axis=0) - 1, axis=1)
        inside = finite(np.abs(found.shifts - true) / found.shifts_std)
    return about | {
        "modes": int(apart.sum()),
        "found": int(np.sum(hit & apart)),
        "false": len(scored.false),
        "frequency": finite(scored.frequency[hit]),
        "damping": finite(scored.damping[hit]),
        "shifts": inside,
        "named": bool(set(found.stated.warned) & set(CAUSES)),
        "seconds": round(found.stated.seconds, 3),
    }


def _in_order(truth: ModalModel, stated: Stated) -> ModalModel:
    """The truth on the DOFs of the fit, in their order."""
    rows = [truth.dofs.index(dof) for dof in stated.model.dofs]
    return replace(truth, shapes=truth.shapes[rows], dofs=stated.model.dofs)


def _nearest(truth: ModalModel, drawn: SetUps, stated: Stated) -> ModalModel:
    """Of the frequencies and the damping between those of the set-ups and of the unloaded structure, those nearest to what
    is stated."""
    natural, damping = truth.natural_frequencies.copy(), truth.damping_ratios.copy()
    every = natural * (1 + np.vstack([drawn.shifts, np.zeros(len(natural))]))
    ratios = np.vstack([drawn.damping, damping])
    alike = mac(truth.shapes, stated.model.shapes) >= 0.8
    for mode in range(len(natural)):
        clipped = np.clip(stated.frequencies, every[:, mode].min(), every[:, mode].max())
        distance = np.where(alike[mode], np.abs(stated.frequencies - clipped), np.inf)
        if len(distance) and distance.min() <= 0.01 * natural[mode]:
            own = np.argmin(distance)
            natural[mode] = clipped[own]
            damping[mode] = np.clip(stated.damping[own], ratios[:, mode].min(), ratios[:, mode].max())
    return replace(truth, poles=poles_from(natural, damping))


def line(row: dict) -> str:
    """One structure as a line."""
    start = f"set-ups {row['number']:3} {row['kind']:13} {100 * row['size']:5.2f} %, {row['set-ups']} set-ups:"
    if "error" in row:
        return f"{start} {row['error']}"
    return f"{start} {row['found']} of {row['modes']}, false {row['false']}{', named' if row['named'] else ''}"


def summary(rows: list[dict]) -> dict:
    """For each kind and size: recall, false modes, coverage, shifts and what names them."""
    cells = []
    for kind in KINDS:
        for size in SIZES:
            own = [row for row in rows if row["kind"] == kind and row["size"] == size]
            ended = [row for row in own if "error" not in row]
            if own:
                shifts = [value for row in ended if row["shifts"] for value in row["shifts"] if value is not None]
                clean = sum(row["false"] == 0 for row in ended)
                cells.append(
                    {
                        "kind": kind,
                        "size": size,
                        "structures": len(own),
                        "failed": len(own) - len(ended),
                        "modes": sum(row["modes"] for row in ended),
                        "found": sum(row["found"] for row in ended),
                        "false": sum(row["false"] for row in ended),
                        "without false": clean,
                        "without false, least": least_share(clean, len(ended)),
                        "frequency": _share([v for row in ended for v in row["frequency"]]),
                        "damping": _share([v for row in ended for v in row["damping"]]),
                        "shifts": len(shifts),
                        "shifts inside": _share(shifts),
                        "named": sum(row["named"] for row in ended),
                    }
                )
    return {"structures": len(rows), "cells": cells}


def _share(errors_: list[float]) -> float | None:
    return float(np.mean(np.abs(errors_) <= REACH)) if errors_ else None


def report(found: dict) -> str:
    """The summary in words."""

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{100 * value:.1f} %"

    return "\n".join(
        f"{one['kind']:13} {100 * one['size']:5.2f} %: {one['found']} of {one['modes']} modes, false {one['false']} in "
        f"{one['structures']}, coverage f {percent(one['frequency'])}, zeta {percent(one['damping'])}; named in "
        f"{one['named']} of {one['structures']}; intervals of shifts: {percent(one['shifts inside'])} of {one['shifts']}; "
        f"failed {one['failed']}"
        for one in found["cells"]
    )
