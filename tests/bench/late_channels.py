"""Late channels of random structures: which are named, what the intervals hold, and how often chance names one.

python -m tests.bench.late_channels --draws 200 --seed 1

Structures of 2 to 12 modes, 3 to 40 outputs and one to three forces, damping ratios of 0.1 to 8 %, noise of 0.1 to 5 %;
a quarter each with a diagonal damping matrix, one with a tenth of the coupling that it may have, one fully coupled, and a
dashpot at one point. Each is fitted in time and with one channel, a third, half or a force late by 5 us to 2 ms.
"""

import argparse
from itertools import pairwise

import numpy as np

import ema.fit
from ema.data import FrfSet, ModalModel
from ema.dof import Dof
from ema.synthesis import frfs as synthesise
from tests.bench.draws import unit_noise

KINDS = ("diagonal", "coupled by a tenth", "fully coupled", "a dashpot")
LATE = ("one channel", "a third", "half", "a force")
TURNS = (0.0, 0.03, 0.1, 0.8, np.inf)
"""Edges of the classes of delays, by the angle [rad] by which they turn the highest mode."""


def structure(rng: np.random.Generator, kind: int) -> ModalModel:
    """Modes of a structure with unit modal masses and a damping matrix of this kind."""
    modes, outputs, forces = int(rng.integers(2, 13)), int(rng.integers(3, 41)), int(rng.integers(1, 4))
    omega = 2 * np.pi * np.sort(40 + 420 * (np.arange(modes) + rng.uniform(0.1, 0.9, modes)) / modes)
    rate = 2 * np.exp(rng.uniform(np.log(0.001), np.log(0.08), modes)) * omega
    shapes = rng.standard_normal((outputs, modes))
    scale = np.sqrt(np.outer(rate, rate))
    factors = rng.standard_normal((modes, modes))
    factors /= np.linalg.norm(factors, axis=1, keepdims=True)
    coupled = scale * (factors @ factors.T)
    damping = np.diag(rate)
    if kind in (1, 2):
        share = (0.1, 1.0)[kind - 1]
        damping = (1 - share) * damping + share * coupled
    elif kind == 3:
        at = rng.standard_normal(modes)
        damping = damping + rng.uniform(0.1, 1.0) * rate.min() * np.outer(at, at)
    zero, one = np.zeros((modes, modes)), np.eye(modes)
    poles, vectors = np.linalg.eig(np.block([[zero, one], [-np.diag(omega**2), -damping]]))
    kept = np.flatnonzero(poles.imag > 0)
    kept = kept[np.argsort(poles.imag[kept])]
    poles, vectors = poles[kept], vectors[:modes, kept]
    # psi' (2 s + C) psi is one for residues psi psi' (unit modal masses: Fertis, Mechanical and Structural Vibrations)
    gain = np.einsum("mr,mr->r", vectors, 2 * poles * vectors + damping @ vectors)
    shapes = shapes @ vectors * np.sqrt(2j * poles.imag / gain)
    dofs = tuple(Dof(node, "+Z") for node in range(1, outputs + 1))
    return ModalModel(poles, shapes, dofs, shapes[:forces] / (2j * poles.imag), dofs[:forces])


def fitted(model: ModalModel, turn: np.ndarray, noise: np.ndarray) -> ModalModel:
    """The fit of FRFs with noise, turned by factors (line, output, input)."""
    lines = np.linspace(20.0, 500.0, len(turn))
    clean = synthesise(model, lines, "accelerance").values * turn
    std = np.sqrt(np.mean(np.abs(clean) ** 2, axis=0))
    frfs = FrfSet(lines, clean + std * noise, model.dofs, model.inputs, "accelerance", "m/s^2/N")
    return ema.fit.modes(frfs, ema.fit.stabilise(frfs))


def named(model: ModalModel) -> dict[str, tuple[float, float]]:
    """Delay and half of its interval of each channel that is named; one said to be filtered has none."""
    found = [one for one in model.findings if one.code.startswith("channel-")]
    return {
        f"{'force' if 'relative to all responses' in one.message else 'response'} {one.where.rpartition(' ')[2]}": (
            (float(one.value or 0), float(one.limit or 0)) if one.code == "channel-delay" else (np.nan, np.nan)
        )
        for one in found
    }


def one(seed: int, number: int) -> dict:
    """One structure, in time and with late channels."""
    rng = np.random.default_rng([seed, number])
    kind, which = number % len(KINDS), number // len(KINDS) % len(LATE)
    model = structure(rng, kind)
    outputs, forces = len(model.dofs), len(model.inputs)
    size = np.exp(rng.uniform(np.log(0.001), np.log(0.05)))
    noise = size * unit_noise(rng, (1601, outputs, forces))
    count = {0: 1, 1: max(outputs // 3, 1), 2: outputs // 2}.get(which, 1)
    late = float(np.exp(rng.uniform(np.log(5e-6), np.log(2e-3))))
    rows = rng.choice(forces if which == 3 else outputs, count, replace=False)
    turn = np.ones((1601, outputs, forces), complex)
    factor = np.exp(-2j * np.pi * np.linspace(20.0, 500.0, 1601) * late)
    if which == 3:
        turn[:, :, rows] /= factor[:, None, None]
        true = {f"force {model.inputs[row]}" for row in rows}
    else:
        turn[:, rows] *= factor[:, None, None]
        true = {f"response {model.dofs[row]}" for row in rows}
    found = fitted(model, turn, noise)
    seen = named(found)
    std = (
        np.sqrt(0.5 * np.trace(found.uncertainty.residues, axis1=-2, axis2=-1))
        if found.uncertainty is not None
        else 0.0
    )
    shift = np.abs(np.expm1(1j * found.poles.imag * late))[:, None, None] * np.abs(found.residues())
    touched = (
        shift[:, :, rows] > 2 * np.asarray(std)[:, :, rows]
        if which == 3
        else shift[:, rows] > 2 * np.asarray(std)[:, rows]
    )
    return {
        "kind": kind,
        "late": which,
        "turn": late * float(model.poles.imag.max()),
        "seen": bool(seen) or bool(np.any(touched)),
        "right": set(seen) == true,
        "nothing": not seen,
        "inside": [abs(seen[key][0] - late) <= seen[key][1] for key in seen if key in true],
        "in time": sorted(named(fitted(model, np.ones_like(turn), noise))),
    }


def main() -> None:
    """Draw, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, required=True)
    chosen = parser.parse_args()
    drawn = [one(chosen.seed, number) for number in range(chosen.draws)]
    print(f"in time: {sum(bool(row['in time']) for row in drawn)} of {len(drawn)} have a channel named")
    rows = [row for row in drawn if row["seen"]]

    def counted(title: str, own: list[dict]) -> None:
        right, nothing = (sum(row[key] for row in own) for key in ("right", "nothing"))
        print(f"{title}: {right} of {len(own)} with all late channels and no other, {nothing} without a name")

    counted("late by more than two standard deviations of a residue", rows)
    for number, title in enumerate(KINDS):
        counted(f"  {title}", [row for row in rows if row["kind"] == number])
    for number, title in enumerate(LATE):
        counted(f"  late: {title}", [row for row in rows if row["late"] == number])
    for low, high in pairwise(TURNS):
        counted(f"  turned by {low} to {high} rad", [row for row in rows if low <= row["turn"] < high])
    inside = [value for row in rows for value in row["inside"]]
    structures = [all(row["inside"]) for row in rows if row["inside"]]
    print(
        f"intervals that hold the delay: {sum(inside)} of {len(inside)}; structures: {sum(structures)} of {len(structures)}"
    )


if __name__ == "__main__":
    main()
