"""Discs and square plates have double roots: are both modes found, is their group stated rightly, and what of one reference?

Clamped circular plates and simply supported square plates in closed form (Leissa 1969, Vibration of plates). Each double
root counts as found where two accepted modes lie there; the sum of their poles has a common interval, and their shapes span
the true space. One reference sees one mode of each root and cannot tell its multiplicity.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import subspace_angles
from scipy.optimize import brentq
from scipy.special import iv, jv

from ema.data import FrfSet, ModalModel
from ema.dof import Dof
from tests.bench.cases import Case, _accelerance, _log_uniform, noise_std
from tests.bench.draws import Knowledge, drawn
from tests.bench.stated import ELLIPSE, Stated, automatic, finite

TITLE = "Repeated roots: discs and square plates"
COUNT, QUICK = 320, 24
KINDS = ("two references", "two references, one poor", "three references, one poor", "one reference")
POOR = 23.0
"""Condition of the participation of one double root that a poor second reference leaves."""
MULTIPLICITY = ("multiplicity-not-observable",)
"""Findings that say that one reference cannot tell how many modes there are."""
LINES = 1601


@dataclass(frozen=True)
class Symmetric:
    """A case whose modes come alone or in pairs: ``pairs`` holds the indices of both modes of each double root."""

    case: Case
    pairs: tuple[tuple[int, int], ...]
    kind: str
    exact: bool


def disc(x: np.ndarray, y: np.ndarray, large: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Clamped circular plate of radius 1: relative frequencies (mode,) and shapes (point, mode), up to 69 or 121.

    J_n(k) I_n+1(k) + I_n(k) J_n+1(k) = 0, frequency k^2, shape [J_n(k r) - J_n(k) / I_n(k) I_n(k r)] cos, sin(n t).
    """
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    found = []
    for n in range(9):

        def characteristic(k: float, n: int = n) -> float:
            return float(jv(n, k) * iv(n + 1, k) + iv(n, k) * jv(n + 1, k)) / float(iv(n, k) + 1e-300)

        grid = np.linspace(0.5, 11.0 if large else 8.3, 400)
        values = [characteristic(k) for k in grid]
        for low, high, a, b in zip(grid[:-1], grid[1:], values[:-1], values[1:], strict=True):
            if a * b < 0:
                k = brentq(characteristic, low, high, xtol=1e-14)
                radial = jv(n, k * radius) - jv(n, k) / iv(n, k) * iv(n, k * radius)
                found += [(k**2, radial * np.cos(n * angle))] + ([(k**2, radial * np.sin(n * angle))] if n else [])
    return _ordered(found)


def square(x: np.ndarray, y: np.ndarray, large: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Simply supported square plate on (-1, 1): frequency m^2 + n^2, shape sin(m pi (x+1)/2) sin(n pi (y+1)/2)."""
    found = [
        (float(m * m + n * n), np.sin(m * np.pi * (x + 1) / 2) * np.sin(n * np.pi * (y + 1) / 2))
        for m in range(1, 7)
        for n in range(1, 7)
        if m * m + n * n <= (41 if large else 18)
    ]
    return _ordered(found)


def _ordered(found: list[tuple[float, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    found = sorted(found, key=lambda one: one[0])
    shapes = np.array([shape for _, shape in found]).T
    return np.array([frequency for frequency, _ in found]), shapes / np.sqrt(np.mean(shapes**2, axis=0))


def symmetric(seed: int, number: int) -> Symmetric:
    """A plate with 12 to 30 outputs; kinds of references in turn; every other root exactly double, the others split."""
    rng = np.random.default_rng([seed, number])
    kind, exact = KINDS[number % len(KINDS)], number // len(KINDS) % 2 == 0
    noise = (0.001, 0.01, 0.03)[number // (2 * len(KINDS)) % 3]
    round_plate = bool(rng.random() < 0.5)
    outputs = int(rng.integers(12, 31))
    x, y = _points(rng, 4000, round_plate)
    natural, shapes = (disc if round_plate else square)(x, y, bool(rng.random() < 0.5))
    natural = natural * 60.0 / natural[0]
    pairs = tuple((i, i + 1) for i in range(len(natural) - 1) if natural[i + 1] - natural[i] < 1e-9 * natural[i])
    zeta = _log_uniform(rng, 0.002, 0.01, len(natural))
    for a, b in pairs:
        zeta[b] = zeta[a]
        if not exact:
            # Apart by 0.1 to 30 % of the half-power bandwidth.
            natural[b] *= 1 + 2 * zeta[a] * float(_log_uniform(rng, 1e-3, 0.3, 1)[0])
    references = _references(rng, shapes, pairs, kind)
    chosen = np.concatenate([references, rng.choice(np.setdiff1d(np.arange(4000), references), outputs)])
    shapes = shapes[chosen]
    omega = 2 * np.pi * natural
    poles = omega * (-zeta + 1j * np.sqrt(1 - zeta**2))
    dofs = tuple(Dof(node, "+Z") for node in range(1, len(chosen) + 1))
    rows = list(range(len(references)))
    truth = ModalModel(
        poles=poles,
        shapes=shapes.astype(complex),
        dofs=dofs,
        participation=shapes[rows] / (2j * poles.imag),
        inputs=dofs[: len(references)],
        scaling="unit modal mass",
        name="plate",
    )
    frequencies = np.linspace(0.6 * natural[0], 1.15 * natural[-1], LINES)
    clean = _accelerance(truth, frequencies)
    std = noise_std(clean, noise)
    frfs = FrfSet(
        frequencies=frequencies,
        values=clean,
        outputs=dofs,
        inputs=truth.inputs,
        quantity="accelerance",
        unit="m/s^2/N",
        estimator="synthetic",
        name="plate",
    )
    nothing = replace(truth, poles=poles[:0], shapes=truth.shapes[:, :0], participation=truth.participation[:, :0])
    case = Case("plate", seed, noise, frfs, clean, std, truth, nothing)
    known = bool(rng.random() < 0.5)
    return Symmetric(
        replace(case, frfs=drawn(case, Knowledge("", 10 if known else 1, known=known), rng)), pairs, kind, exact
    )


def _points(rng: np.random.Generator, count: int, round_plate: bool) -> tuple[np.ndarray, np.ndarray]:
    x, y = rng.uniform(-0.95, 0.95, (2, 3 * count))
    inside = np.flatnonzero(np.hypot(x, y) < 0.95)[:count] if round_plate else np.arange(count)
    return x[inside], y[inside]


def _references(rng: np.random.Generator, shapes: np.ndarray, pairs: tuple, kind: str) -> np.ndarray:
    """Points that see every mode; the pairs through them well conditioned, or one pair poorly through the second."""
    visible = np.ones(len(shapes), bool)
    paired = {index for pair in pairs for index in pair}
    for mode in set(range(shapes.shape[1])) - paired:
        visible &= np.abs(shapes[:, mode]) > 0.2
    for a, b in pairs:
        visible &= np.hypot(shapes[:, a], shapes[:, b]) > 0.3
    points = rng.permutation(np.flatnonzero(visible))
    first = int(points[0])
    if kind == "one reference":
        return np.array([first])

    def conditions(second: int, rows: tuple[int, ...] = ()) -> np.ndarray:
        chosen = [first, *rows, second]
        return np.array([np.linalg.cond(shapes[np.ix_(chosen, list(pair))]) for pair in pairs])

    others = points[1:401]
    every = np.array([conditions(int(one)) for one in others])
    good = int(others[np.argmin(every.max(axis=1))])
    if kind == "two references":
        return np.array([first, good])
    target = int(rng.integers(len(pairs)))
    poor = int(others[np.argmin(np.abs(np.log(every[:, target] / POOR)) + 10 * (every.max(axis=1) > 1.5 * POOR))])
    return np.array([first, poor]) if kind == "two references, one poor" else np.array([first, poor, good])


def one(seed: int, number: int, quick: bool = False) -> dict:
    """One plate, fitted automatically."""
    made = symmetric(seed, number)
    case = made.case
    about = {"number": number, "kind": made.kind, "exact": made.exact, "noise": case.noise, "pairs": len(made.pairs)}
    try:
        stated = automatic(case.frfs)
    except Exception as error:  # a fit that fails is a result
        return about | {"error": f"{type(error).__name__}: {error}"}
    taken: set[int] = set()
    counts, sums, angles = [], [], []
    for pair in made.pairs:
        near = _near(case, pair, stated)
        taken |= set(near)
        counts.append(len(near))
        if made.kind == "one reference" and len(near) == 1:
            sums.append(_inside(_sum(stated, near), case.truth.poles[list(pair)].mean()) if made.exact else None)
        if made.kind != "one reference" and len(near) == 2:
            sums.append(_inside(_sum(stated, near), case.truth.poles[list(pair)].sum()))
            angles.append(
                np.degrees(subspace_angles(case.truth.shapes[:, list(pair)], stated.model.shapes[:, near])[0])
            )
    alone = [mode for mode in range(len(case.truth.poles)) if not any(mode in pair for pair in made.pairs)]
    found_alone = 0
    for mode in alone:
        near = _near(case, (mode,), stated)
        found_alone += len(near) >= 1
        taken |= set(near[:1])
    return about | {
        "counts": counts,
        "sums": [None if one is None else bool(one) for one in sums],
        "angles": finite(np.array(angles)),
        "alone": len(alone),
        "alone found": found_alone,
        "false": len(stated.model.poles) - len(taken),
        "multiplicity": bool(set(stated.findings) & set(MULTIPLICITY)),
        "seconds": round(stated.seconds, 3),
    }


def _near(case: Case, modes: tuple[int, ...], stated: Stated) -> list[int]:
    """Accepted modes within one half-power bandwidth or 0.1 % of a root, nearest first."""
    own = case.truth.natural_frequencies[list(modes)]
    reach = max(2 * case.truth.damping_ratios[modes[0]], 1e-3) * own.mean()
    distance = np.abs(stated.frequencies - own.mean())
    return [int(index) for index in np.argsort(distance) if distance[index] <= reach]


def _sum(stated: Stated, modes: list[int]) -> tuple[complex, np.ndarray]:
    """Sum of the poles of these modes and the covariance of its real and imaginary part."""
    poles = stated.model.poles[modes]
    slopes = []
    for pole in poles:
        omega, zeta = abs(pole), -pole.real / abs(pole)
        by_zeta = omega * (-1 - 1j * zeta / np.sqrt(1 - zeta**2))
        slopes += [pole / omega * 2 * np.pi, by_zeta]
    slope = np.array([np.real(slopes), np.imag(slopes)])
    if stated.model.uncertainty is None:
        return complex(poles.sum()), np.full((2, 2), np.nan)
    rows = [2 * mode + part for mode in modes for part in (0, 1)]
    return complex(poles.sum()), slope @ np.asarray(stated.model.uncertainty.values)[np.ix_(rows, rows)] @ slope.T


def _inside(said: tuple[complex, np.ndarray], truth: complex) -> bool:
    value, covariance = said
    error = np.array([(value - truth).real, (value - truth).imag])
    if not np.isfinite(covariance).all() or np.linalg.det(covariance) <= 0:
        return False
    return bool(error @ np.linalg.solve(covariance, error) <= ELLIPSE)


def line(row: dict) -> str:
    """One plate as a line."""
    start = f"plate {row['number']:3} {row['kind']:27} {'exact' if row['exact'] else 'split'} {100 * row['noise']:g} %:"
    if "error" in row:
        return f"{start} {row['error']}"
    angles = [angle for angle in row["angles"] if angle is not None]
    return (
        f"{start} modes at the double roots {row['counts']}, others {row['alone found']} of {row['alone']}, false "
        f"{row['false']}, sums inside {row['sums'].count(True)} of {len(row['sums'])}, largest angle "
        f"{max(angles, default=float('nan')):.2f} deg"
    )


def summary(rows: list[dict]) -> dict:
    """For each kind of references: double roots found as two, sums covered, angles, and what is false."""
    kinds = {}
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind and "error" not in row]
        counts = [count for row in own for count in row["counts"]]
        sums = [one for row in own for one in row["sums"] if one is not None]
        angles = [angle for row in own for angle in row["angles"] if angle is not None]
        kinds[kind] = {
            "plates": sum(row["kind"] == kind for row in rows),
            "failed": sum(row["kind"] == kind and "error" in row for row in rows),
            "roots": len(counts),
            **{f"with {number}": counts.count(number) for number in (0, 1, 2)},
            "with more": sum(count > 2 for count in counts),
            "sums": len(sums),
            "sums inside": sum(sums),
            "angle median": float(np.median(angles)) if angles else None,
            "angle largest": float(np.max(angles)) if angles else None,
            "alone": sum(row["alone"] for row in own),
            "alone found": sum(row["alone found"] for row in own),
            "false": sum(row["false"] for row in own),
            "multiplicity": sum(row["multiplicity"] for row in own),
        }
    return {"plates": len(rows), "kinds": kinds}


def report(found: dict) -> str:
    """The summary in words."""
    lines = []
    for kind, own in found["kinds"].items():
        angle = (
            "-" if own["angle median"] is None else f"{own['angle median']:.2f} (largest {own['angle largest']:.1f})"
        )
        lines.append(
            f"{kind}: {own['roots']} double roots, with 0 / 1 / 2 / more modes: {own['with 0']} / {own['with 1']} / "
            f"{own['with 2']} / {own['with more']}; sum of the poles inside {own['sums inside']} of {own['sums']}; angle "
            f"{angle} deg; others {own['alone found']} of {own['alone']}; false {own['false']}; multiplicity named in "
            f"{own['multiplicity']} of {own['plates']}; failed {own['failed']}"
        )
    return "\n".join(lines)
