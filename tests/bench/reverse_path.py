"""How often the reverse path is right about tables with a friction joint under random excitation, and about linear ones.

The tables of `tests.bench.detection_lines`, stepped without the simulator, under Gaussian noise in place of a multisine;
the joint of every third one never slips. Every sensor and the force have 1 % of noise, and a second force that nobody
measures acts at the shaker, for a disturbance is to be no friction. The truth is the
homogeneity index: the change of the responses from half of this level to this level.

    python -m tests.bench.reverse_path --n 150 --seed 1
"""

import argparse
from itertools import pairwise

import numpy as np

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.estimate.reverse_path import amplitude_dependence, amplitude_finding
from tests.bench.detection_lines import HIGH, LOW, NOISE, RATE, Tables, responses, tables

SECONDS = 120
EDGES = (-1.0, 1e-9, 0.01, 0.025, 0.05, 0.1, 0.2, np.inf)


def random_force(rng: np.random.Generator, seconds: float = SECONDS) -> np.ndarray:
    """Gaussian noise of unit rms in the band of the tables."""
    count = round(seconds * RATE)
    lines = np.fft.rfftfreq(count, 1 / RATE)
    spectrum = rng.normal(size=len(lines)) + 1j * rng.normal(size=len(lines))
    force = np.fft.irfft(np.where((lines > LOW) & (lines < HIGH), spectrum, 0), count)
    return force / force.std()


def run_of(rng: np.random.Generator, force: np.ndarray, motion: np.ndarray) -> Run:
    """A shaker run of one table, with noise."""
    rows = [Channel("force", None, "force", "reference", "N")]
    rows += [Channel(f"d{row}", None, "displacement", unit="m") for row in range(len(motion))]
    signals = np.vstack([force, motion])
    signals = signals + NOISE * signals.std(axis=1, keepdims=True) * rng.standard_normal(signals.shape)
    return Run("table", Condition(Excitation("random")), (Recording(signals, float(RATE), tuple(rows)),))


def stuck_modes(made: Tables, table: int) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies [Hz] and damping ratios with the joint sticking."""
    joint = made.stiffness[table] * np.outer(made.joint[table], made.joint[table])
    squares, shapes = np.linalg.eigh(np.diag(made.omega[table] ** 2) + joint)
    decay = np.sum(shapes**2 * (2 * made.zeta[table] * made.omega[table])[:, None], axis=0)
    return np.sqrt(squares) / (2 * np.pi), decay / (2 * np.sqrt(squares))


def outcomes(seed: int, count: int, disturbance: float) -> list[tuple[float, bool]]:
    """Homogeneity index of each table, and whether it was named."""
    rng = np.random.default_rng(seed)
    made, force = tables(rng, count), random_force(rng)
    made.limit[::3] = np.inf
    acting = force + disturbance * random_force(rng)
    half, whole = (responses(made, acting, level, settle=0, periods=1) for level in (0.5, 1.0))
    told = []
    for table in range(count):
        read = amplitude_dependence(run_of(rng, force, whole[table]), *stuck_modes(made, table))
        change = float(np.linalg.norm(whole[table] - 2 * half[table]) / np.linalg.norm(2 * half[table]))
        told.append((change, amplitude_finding(read, "table") is not None))
    return told


def summary(told: list[tuple[float, bool]]) -> str:
    """Counts by class of the homogeneity index."""
    text = [f"{'homogeneity index':22s}{'tables':>8s}{'named':>8s}"]
    for low, high in pairwise(EDGES):
        part = [named for change, named in told if low <= change < high]
        if part:
            words = "none" if high < 1e-6 else f"{max(low, 0):.3f} to {high:.3f}"
            text.append(f"{words:22s}{len(part):8d}{sum(part):8d}")
    return "\n".join(text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=150, help="tables to draw")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--disturbance", type=float, default=0.03, help="over the force")
    given = parser.parse_args()
    print(summary(outcomes(given.seed, given.n, given.disturbance)))


if __name__ == "__main__":
    main()
