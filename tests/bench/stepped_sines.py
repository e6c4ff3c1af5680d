"""Stepped sines whose stays are short against the decay: FRFs and modes of systems drawn at random, by closed form.

One to four modes between 75 and 125 Hz with damping ratios of 0.3 to 1 %, one to four responses, steps of 0.3 to 1
half-power bandwidths with a force of constant amplitude and no jump in its phase, noise of every channel. In each stay
x'' + 2 zeta w x' + w^2 x = F has its steady vibration and a free one that makes position and velocity continuous.

    python -m tests.bench.stepped_sines --stays 0.5,1,2,4 --draws 40 --seed 7
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from ema.data import Channel, Condition, Excitation, FrfSet, Recording, Run
from ema.dof import Dof
from ema.estimate import stepped
from ema.fit import modes, stabilise

RATE = 1024.0
LEVEL = 5.0
BAND = (60.0, 140.0)


@dataclass(frozen=True)
class Structure:
    """Natural frequencies [Hz], damping ratios, and mode shapes of unit modal mass (output, mode); the force acts at
    the first output."""

    frequency: np.ndarray
    damping: np.ndarray
    shapes: np.ndarray

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Structure":
        count = int(rng.integers(1, 5))
        shapes = rng.normal(size=(int(rng.integers(1, 5)), count))
        shapes = np.sign(shapes) * np.maximum(np.abs(shapes), 0.3)
        return cls(np.sort(rng.uniform(75, 125, count)), rng.uniform(0.003, 0.01, count), shapes)

    @property
    def decay_time(self) -> float:
        """That of the mode that decays most slowly [s]."""
        return float(1 / np.min(self.damping * 2 * np.pi * self.frequency))

    def accelerance(self, frequencies: np.ndarray) -> np.ndarray:
        """(frequency, output)."""
        w, own = 2 * np.pi * np.asarray(frequencies)[:, None], 2 * np.pi * self.frequency
        return (-(w**2) / (own**2 - w**2 + 2j * self.damping * own * w)) @ (self.shapes * self.shapes[0]).T


def vibration(frequency: float, damping: float, lines: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Force and acceleration of x'' + 2 zeta w x' + w^2 x = F from rest, the lines one after the other."""
    own = 2 * np.pi * frequency
    pole = own * complex(-damping, np.sqrt(1 - damping**2))
    time = np.arange(samples + 1) / RATE
    position, velocity, phase = 0.0, 0.0, 0.0
    force, acceleration = [], []
    for line in lines:
        w = 2 * np.pi * line
        driven = -1j * LEVEL * np.exp(1j * phase)  # F = Re(driven e^(jwt))
        steady = driven / (own**2 - w**2 + 2j * damping * own * w)
        off, rate_off = position - steady.real, velocity - (1j * w * steady).real
        free = complex(off, (pole.real * off - rate_off) / pole.imag)
        turning, dying = np.exp(1j * w * time), np.exp(pole * time)
        force.append((driven * turning[:-1]).real)
        acceleration.append((-(w**2) * steady * turning + pole**2 * free * dying)[:-1].real)
        position = (steady * turning[-1] + free * dying[-1]).real
        velocity = (1j * w * steady * turning[-1] + pole * free * dying[-1]).real
        phase = (phase + w * time[-1]) % (2 * np.pi)
    return np.concatenate(force), np.concatenate(acceleration)


def noisy(signals: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    return signals + share * np.sqrt(np.mean(signals**2, axis=1, keepdims=True)) * rng.normal(size=signals.shape)


def run_of(records: Sequence[np.ndarray], period: float = float("nan"), kind: str = "stepped sine") -> Run:
    """Signals of records, the force first."""
    channels = (
        Channel("force", Dof(1, "+Z"), "force", "reference", "N"),
        *(Channel(f"a{k}", Dof(k, "+Z"), "acceleration", unit="m/s^2") for k in range(1, len(records[0]))),
    )
    takes = tuple(Recording(signals, RATE, channels, name=str(k)) for k, signals in enumerate(records))
    return Run("steps", Condition(Excitation(kind, period=period)), takes)


def recorded(
    structure: Structure, stay: float, rng: np.random.Generator, noise: float = 0.01, step: float = 0.5
) -> Run:
    """A test in one record: stays over the decay time, steps over the narrowest half-power bandwidth."""
    samples = max(round(stay * structure.decay_time * RATE), round(8 * RATE / BAND[0]))
    width = float(np.min(2 * structure.damping * structure.frequency))
    lines = np.arange(*BAND, step * width)
    parts = [vibration(*mode, lines, samples) for mode in zip(structure.frequency, structure.damping, strict=True)]
    answers = (structure.shapes * structure.shapes[0]) @ np.array([part[1] for part in parts])
    return run_of([noisy(np.vstack([parts[0][0], answers]), noise, rng)], samples / RATE)


def deviations(frfs: FrfSet, structure: Structure) -> tuple[np.ndarray, int, int]:
    """Errors of frequencies and damping ratios of the modes over their standard deviations, (mode, 2); modes that were
    missed, and false ones."""
    found = modes(frfs, stabilise(frfs))
    assert found.covariance is not None
    off = np.abs(found.natural_frequencies[:, None] - structure.frequency)
    each, true = linear_sum_assignment(off)  # one to one: of two close modes the missed one has no other's errors
    near = off[each, true] < 5 * (structure.damping * structure.frequency)[true]
    each, true = each[near], true[near]
    std = np.sqrt(found.covariance[each][:, [0, 1], [0, 1]])
    errors = np.stack(
        [
            found.natural_frequencies[each] - structure.frequency[true],
            found.damping_ratios[each] - structure.damping[true],
        ],
        axis=1,
    )
    return errors / std, off.shape[1] - len(true), len(off) - len(each)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--stays", default="0.5,1,2,4")
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=7)
    args = parser.parse_args()
    for stay in map(float, args.stays.split(",")):
        rng = np.random.default_rng([args.seed, round(1000 * stay)])
        missed, false = 0, 0
        every: list[np.ndarray] = []
        chi: list[float] = []
        for _ in range(args.draws):
            structure = Structure.draw(rng)
            frfs = stepped(recorded(structure, stay, rng, 10 ** rng.uniform(-3, -1), rng.uniform(0.3, 1)))
            assert frfs.variance is not None
            error = np.abs(frfs.values[:, :, 0] - structure.accelerance(frfs.frequencies)) ** 2
            chi.append(float(np.mean(error / frfs.variance[:, :, 0])))
            z, lost, added = deviations(frfs, structure)
            every, missed, false = [*every, z], missed + lost, false + added
        z = np.concatenate(every)
        inside = 100 * np.mean(np.abs(z) < 1.96, axis=0)
        rms = np.sqrt(np.mean(z**2, axis=0))
        print(
            f"stays of {stay:g} decay times: f {inside[0]:.1f} %, zeta {inside[1]:.1f} % of {len(z)} inside 95 %, rms "
            f"{rms[0]:.2f} and {rms[1]:.2f} std; {missed} missed, {false} false; FRFs {np.sqrt(np.mean(chi)):.2f} std"
        )


if __name__ == "__main__":
    main()
