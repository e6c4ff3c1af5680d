"""Cross-talk of the excitation force into normal-force channels: named where it is, and not where vibration is.

A table and a friction beam, both finite elements of Euler and Bernoulli, the beam on two contact springs, the table on
two supports at random: the force of a contact spring is the normal force, and all of it, by modal superposition. The
load cell carries a random part of that; it has noise, white and slow. Hammer tests of 1 to 30 points, random and sweep
tests of one. The share of the force that is added is none in half of the draws, else 0.5 to 10 % of either sign.

    python -m tests.bench.cross_talk --n 400 --seed 7
"""

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.fft import next_fast_len
from scipy.linalg import eigh
from scipy.signal import chirp

from acquisition.force_cross_talk import cross_talk_findings
from ema.data import Channel, Recording
from ema.dof import Dof

ELEMENTS = 60
_POINTS = (1, 3, 10, 30)


def elements(count: int, length: float, bending: float, mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of a free beam: deflection and slope of its nodes."""
    h = length / count
    k = np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    m = np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    stiffness, inertia = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for first in range(0, 2 * count, 2):
        part = slice(first, first + 4)
        stiffness[part, part] += bending / h**3 * k
        inertia[part, part] += mass * h / 420 * m
    return stiffness, inertia


@dataclass(frozen=True)
class Structure:
    """Modes of table and beam; ``cells`` (joint, mode) is what the load cells of the joints carry of the contact force."""

    omega: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray
    cells: np.ndarray

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Structure":
        young, density = (7e10, 2700.0) if rng.random() < 0.5 else (2.1e11, 7800.0)
        length, width = rng.uniform(0.6, 2.0), rng.uniform(0.03, 0.1)
        height = np.exp(rng.uniform(np.log(0.008), np.log(0.04)))
        first, last = sorted(rng.choice(np.arange(2, ELEMENTS - 1), 2, replace=False))
        last = max(last, first + 6) if first + 6 <= ELEMENTS else last
        first = min(first, last - 6)
        thin = height * rng.uniform(0.3, 1.0)
        table = elements(ELEMENTS, length, young * width * height**3 / 12, density * width * height)
        beam = elements(
            last - first,
            length * (last - first) / ELEMENTS,
            young * width * thin**3 / 12,
            density * width * thin,
        )
        size, start = len(table[0]) + len(beam[0]), len(table[0])
        stiffness, mass = np.zeros((2, size, size))
        for whole, parts in ((stiffness, (table[0], beam[0])), (mass, (table[1], beam[1]))):
            whole[:start, :start], whole[start:, start:] = parts
        for end in (0, 2 * ELEMENTS):
            stiffness[end, end] += np.exp(rng.uniform(np.log(1e3), np.log(1e7)))
        contact = np.exp(rng.uniform(np.log(1e6), np.log(3e8)))
        openings = np.zeros((2, size))
        for row, (node, other) in enumerate(((first, 0), (last, last - first))):
            openings[row, 2 * node], openings[row, start + 2 * other] = 1.0, -1.0
            stiffness += contact * np.outer(openings[row], openings[row])
        squares, vectors = eigh(stiffness, mass)
        kept = (squares > (2 * np.pi) ** 2) & (squares < (2 * np.pi * 6e4) ** 2)
        shapes = vectors[:, kept]
        carried = np.exp(rng.uniform(np.log(0.05), 0.0))
        damping = np.exp(rng.uniform(np.log(0.002), np.log(0.02), kept.sum()))
        return cls(np.sqrt(squares[kept]), damping, shapes, carried * contact * openings @ shapes)

    def respond(self, node: int, force: np.ndarray, rate: float, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations of ``nodes`` and changes of the normal forces."""
        size = next_fast_len(4 * len(force), real=True)
        omega = 2 * np.pi * np.fft.rfftfreq(size, 1 / rate)
        spectrum = np.fft.rfft(force, size)
        modal = (self.shapes[2 * node] * spectrum[:, None]) / (
            self.omega**2 - omega[:, None] ** 2 + 2j * self.damping * self.omega * omega[:, None]
        )
        moved = np.fft.irfft(-(omega**2) * (modal @ self.shapes[2 * nodes].T).T, size)[:, : len(force)]
        return moved, np.fft.irfft((modal @ self.cells.T).T, size)[:, : len(force)]


def slow_noise(rng: np.random.Generator, count: int) -> np.ndarray:
    """White noise and flicker noise of equal power, rms 1."""
    lines = np.fft.rfft(rng.standard_normal(count))
    flicker = np.fft.irfft(lines / np.sqrt(np.maximum(np.arange(len(lines)), 1)), count)
    total = rng.standard_normal(count) + flicker / flicker.std()
    return total / total.std()


@dataclass(frozen=True)
class DrawnTest:
    """Records of a test and the share of the force in the channel of each joint."""

    kind: str
    points: int
    records: tuple[Recording, ...]
    shares: tuple[float, float]

    @classmethod
    def draw(cls, seed: int, number: int, share: float | None = None) -> "DrawnTest":
        """``share`` of the first joint; the second has none."""
        rng = np.random.default_rng([seed, number])
        structure = Structure.draw(rng)
        kind = ("hammer", "hammer", "random", "sweep")[number % 4]
        points = int(rng.choice(_POINTS)) if kind == "hammer" else 1
        if share is None:
            size = np.exp(rng.uniform(np.log(0.005), np.log(0.1)))
            share = 0.0 if rng.random() < 0.5 else size * rng.choice([-1, 1])
        band = np.exp(rng.uniform(np.log(300), np.log(2500)))
        rate = 2.56 * band * rng.uniform(1.0, 2.0)
        nodes = rng.choice(ELEMENTS + 1, 2, replace=False)
        channels = (
            *(
                Channel(f"acc {node}", Dof(int(node) + 1, "+Z"), unit="m/s^2", quantity="acceleration")
                for node in nodes
            ),
            *(
                Channel(f"ring {one}", quantity="force", role="normal force", unit="N", joint=one)
                for one in ("J1", "J2")
            ),
        )
        mean = np.exp(rng.uniform(np.log(50), np.log(5000)))
        ring_noise = mean * np.exp(rng.uniform(np.log(1e-4), np.log(3e-3)))
        level = np.exp(rng.uniform(np.log(100), np.log(2000))) if kind == "hammer" else rng.uniform(3, 30)
        records = []
        for node in rng.choice(ELEMENTS + 1, points, replace=False):
            for _ in range(2 if kind == "hammer" else 1):
                force = _force(rng, kind, band, rate) * level
                moved, pressing = structure.respond(node, force, rate, nodes)
                moved += 1e-3 * moved.std() * rng.standard_normal(moved.shape)
                pressing += mean + np.outer([share, 0.0], force)
                pressing += ring_noise * np.array([slow_noise(rng, len(force)) for _ in pressing])
                force = force + 2e-4 * level * rng.standard_normal(len(force))
                reference = Channel("force", Dof(int(node) + 1, "+Z"), role="reference", unit="N", quantity="force")
                signals = np.vstack([force, moved, pressing])
                records.append(Recording(signals, rate, (reference, *channels), name=f"take {len(records) + 1}"))
        return cls(kind, points, tuple(records), (float(share), 0.0))

    def named(self) -> dict[str, tuple[float, float]]:
        """Share and half of its 95 % interval of each joint that is named."""
        found = cross_talk_findings(self.records, {"J1": "ring J1", "J2": "ring J2"}, self.kind, "run")
        return {one.where[-2:]: (float(one.value), float(one.limit)) for one in found}


def _force(rng: np.random.Generator, kind: str, band: float, rate: float) -> np.ndarray:
    if kind == "hammer":
        width = 1.2 / band
        count = int(max(1.0, 400 / band) * rate)
        place = (np.arange(count) / rate - 0.05 * count / rate) / width
        return np.where((place > 0) & (place < 1), np.sin(np.pi * np.clip(place, 0, 1)), 0.0)
    count = int(20 * rate)
    if kind == "sweep":
        return np.asarray(chirp(np.arange(count) / rate, band / 60, count / rate, band))
    lines = np.fft.rfft(rng.standard_normal(count))
    frequencies = np.fft.rfftfreq(count, 1 / rate)
    noise = np.fft.irfft(np.where((frequencies < band) & (frequencies > band / 100), lines, 0), count)
    return noise / noise.std()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--n", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows = []
    for number in range(options.n):
        test = DrawnTest.draw(options.seed, number)
        named = test.named()
        for joint, share in zip(("J1", "J2"), test.shares, strict=True):
            value, half = named.get(joint, (np.nan, np.nan))
            rows.append((test.kind, test.points, share, value, half))
    for label in sorted({(kind, points) for kind, points, *_ in rows}):
        chosen = np.array([row[2:] for row in rows if row[:2] == label])
        clean = chosen[:, 0] == 0
        line = f"{label[0]:7} {label[1]:3} points: {np.isfinite(chosen[clean, 1]).sum()} of {clean.sum()} clean named"
        for low, high in ((0.005, 0.01), (0.01, 0.02), (0.02, 0.05), (0.05, 0.1)):
            inside = (np.abs(chosen[:, 0]) >= low) & (np.abs(chosen[:, 0]) < high)
            hit = chosen[inside & np.isfinite(chosen[:, 1])]
            right = np.abs(hit[:, 1] - hit[:, 0]) <= hit[:, 2]
            line += f"; {100 * low:g} to {100 * high:g} %: {len(hit)} of {inside.sum()}, {right.sum()} inside"
        print(line)


if __name__ == "__main__":
    main()
