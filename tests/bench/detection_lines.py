"""How often detection lines of a multisine are right about tables with a friction joint, and about linear ones.

A table has 4 to 6 modes of 10 to 40 Hz and a Jenkins element between one point and ground; the shaker drives another
point with a multisine of odd lines, of which one in four is left out. All tables are stepped at once by the exact
propagation of their modes, with the joint's force held over a step: nothing of the simulator is in it. The truth is the
homogeneity index: the change of the FRFs at the excited lines from half of this level to this level, over the FRFs; of
what begins to slip beyond this level, no measurement at this level can know.

    python -m tests.bench.detection_lines --n 300 --seed 1
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.estimate.detection_lines import nonlinear_distortion

RATE, PERIOD, SETTLE, KEPT, LOW, HIGH = 1024, 4.0, 5, 4, 5.0, 60.0
NOISE = 0.01
EDGES = (1e-9, 0.01, 0.025, 0.05, 0.1, 0.2, np.inf)


@dataclass(frozen=True)
class Tables:
    """Poles (table, mode), mass-normalised shapes of shaker, joint and sensors, stiffness and limit of the joint."""

    omega: np.ndarray
    zeta: np.ndarray
    drive: np.ndarray
    joint: np.ndarray
    sensors: np.ndarray
    stiffness: np.ndarray
    limit: np.ndarray


def tables(rng: np.random.Generator, count: int) -> Tables:
    """Random tables; the joint's stiffness raises the lowest mode by 1 to 15 %, its limit runs from free to stuck."""
    modes = 6
    omega = 2 * np.pi * np.sort(np.exp(rng.uniform(np.log(10), np.log(40), (count, modes))), axis=1)
    shapes = np.linalg.qr(rng.normal(size=(count, modes, modes)))[0]
    kappa = np.exp(rng.uniform(np.log(0.02), np.log(0.3), count))
    stiffness = kappa * np.median(omega, axis=1) ** 2 / np.max(shapes[:, 1] ** 2, axis=1)
    zeta = rng.uniform(0.005, 0.015, (count, modes))
    # rms of the joint's motion without the joint, under a force of rms 1 spread over the band
    spread = 2 * np.pi * (HIGH - LOW)
    moves = np.sqrt(np.sum(np.pi * (shapes[:, 0] * shapes[:, 1]) ** 2 / (4 * zeta * omega**3) * 2 / spread, axis=1))
    limit = stiffness * moves * np.exp(rng.uniform(np.log(0.1), np.log(30), count))
    return Tables(omega, zeta, shapes[:, 0], shapes[:, 1], shapes[:, 2:4], stiffness, limit)


def multisine(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One period of unit rms, and its excited lines: odd ones, of four one left out."""
    odd = np.arange(int(LOW * PERIOD) | 1, int(HIGH * PERIOD), 2)
    lines = np.concatenate([np.delete(odd[k : k + 4], rng.integers(4)) for k in range(0, len(odd) - 3, 4)])
    spectrum = np.zeros(int(RATE * PERIOD) // 2 + 1, complex)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
    force = np.fft.irfft(spectrum)
    return force / force.std(), lines


def responses(
    made: Tables, force: np.ndarray, level: float, *, settle: int = SETTLE, periods: int = KEPT
) -> np.ndarray:
    """Displacement of the sensors (table, sensor, sample) in ``periods`` that are kept behind ``settle`` others."""
    poles = made.omega * (-made.zeta + 1j * np.sqrt(1 - made.zeta**2))
    step = np.exp(poles / RATE)
    # q'' + 2 zeta omega q' + omega^2 q = f is z' = pole z + f / (2 j Im pole), q = 2 Re z, with f held over a step
    gain = (step - 1) / poles / (2j * poles.imag)
    z = np.zeros(poles.shape, complex)
    pull, last, before = np.zeros((3, len(poles)))
    kept = np.empty((len(poles), made.sensors.shape[1], periods * len(force)))
    for number in range((settle + periods) * len(force)):
        acting = level * force[number % len(force)] * made.drive - pull[:, None] * made.joint
        z = step * z + gain * acting
        q = 2 * z.real
        at = np.sum(made.joint * q, axis=1)
        # the joint acts in the middle of the next step; held from its start it would lag, and feed energy in
        middle, last = 1.5 * at - 0.5 * last, at
        pull = np.clip(pull + made.stiffness * (middle - before), -made.limit, made.limit)
        before = middle
        if number >= settle * len(force):
            kept[:, :, number - settle * len(force)] = np.einsum("tsm,tm->ts", made.sensors, q)
    return kept


def run_of(force: np.ndarray, motion: np.ndarray) -> Run:
    """A shaker run of one table."""
    rows = [Channel("force", None, "force", "reference", "N")]
    rows += [Channel(f"d{row}", None, "displacement", unit="m") for row in range(len(motion))]
    signals = np.vstack([np.tile(force, KEPT), motion])
    return Run("table", Condition(Excitation("random", period=PERIOD)), (Recording(signals, float(RATE), tuple(rows)),))


def index(lines: np.ndarray, half: np.ndarray, motion: np.ndarray) -> float:
    """Change of the FRFs at the excited lines from half the force, over the FRFs."""
    at = [np.fft.rfft(one.reshape(len(one), KEPT, -1).mean(axis=1), axis=1)[:, lines] for one in (2 * half, motion)]
    return float(np.linalg.norm(at[1] - at[0]) / np.linalg.norm(at[0]))


def outcomes(seed: int, count: int) -> list[tuple[float, float, str]]:
    """Homogeneity index, distortion and verdict of each table; the joint of every fifth one never slips."""
    rng = np.random.default_rng(seed)
    made, (force, lines) = tables(rng, count), multisine(rng)
    made.limit[::5] = np.inf
    halves, motions = (responses(made, force, level) for level in (0.5, 1.0))
    told = []
    for half, motion in zip(halves, motions, strict=True):
        noisy = motion + NOISE * motion.std(axis=1, keepdims=True) * rng.standard_normal(motion.shape)
        read = nonlinear_distortion(run_of(force, noisy))
        told.append((index(lines, half, motion), read.odd, read.verdict))
    return told


def summary(told: list[tuple[float, float, str]]) -> str:
    """Verdicts by class of the homogeneity index."""
    text = [f"{'homogeneity index':22s}{'tables':>8s}{'distortion':>12s}{'named':>8s}{'not testable':>14s}"]
    for low, high in pairwise((-1.0, *EDGES)):
        part = [one for one in told if low <= one[0] < high]
        if part:
            counts = [sum(one[2] == verdict for one in part) for verdict in ("not linear", "not testable")]
            middle = np.median([one[1] for one in part])
            named = "none" if high < 1e-6 else f"{max(low, 0):.3f} to {high:.3f}"
            text.append(f"{named:22s}{len(part):8d}{middle:12.4f}{counts[0]:8d}{counts[1]:14d}")
    return "\n".join(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=300, help="tables to draw")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print(summary(outcomes(given.seed, given.n)))


if __name__ == "__main__":
    main()
