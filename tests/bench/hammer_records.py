"""Hammer tests drawn at random: records of one impact or of many, with or without a second contact, and the true FRF."""

from dataclasses import dataclass

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float

from ema.data import Channel, Condition, FrfSet, Recording, Run
from ema.dof import Dof
from tests.bench.hammer_signals import Chain, Second, draw_chain, draw_contact, force

RECORDS = ("one", "many", "lone")
"""Five records of one impact each; one record of five impacts; a single record of a single impact."""

RATIOS = (0.1, 0.2, 0.5)
"""Heights of second contacts relative to the main ones."""

IMPACTS = 5
SHAPES = ("half sine", "haversine", "skew")
POINT = Dof(1, "+Z")


@dataclass(frozen=True)
class Drawn:
    """A hammer test on one point: its run, the impact that is followed by a second contact, and that contact.

    ``delay`` s is from the beginning of the one contact to that of the other; ``poles`` rad/s and ``residues`` are
    those of the true accelerance.
    """

    run: Run
    impact: int | None
    delay: float
    ratio: float
    contact: float
    poles: Complex[np.ndarray, "mode"]
    residues: Float[np.ndarray, "mode"]

    def truth(self, frequencies: Float[np.ndarray, "freq"], decay: float = 0.0) -> Complex[np.ndarray, "freq"]:
        """The accelerance at ``j w + decay``."""
        s = 2j * np.pi * np.asarray(frequencies) + decay
        pairs = self.residues / (s[:, None] - self.poles) + self.residues / (s[:, None] - self.poles.conj())
        return np.asarray(pairs.sum(axis=1))

    def error(self, frfs: FrfSet, band: tuple[float, float]) -> float:
        """Norm of the error of measured FRFs over that of the true ones."""
        inside = frfs.band(*band)
        exact = self.truth(inside.frequencies, inside.added_decay)
        return float(np.linalg.norm(inside.values[:, 0, 0] - exact) / np.linalg.norm(exact))


def draw(rng: np.random.Generator, records: str, *, second: bool, delays: tuple[float, float] = (0.005, 0.5)) -> Drawn:
    """Draw a test; its second contact, if any, comes within ``delays`` s of the beginning of the main one."""
    chain, contact, shape = draw_chain(rng), draw_contact(rng), str(rng.choice(SHAPES))
    block = float(rng.uniform(0.8, 1.6))
    poles, residues = _structure(rng, contact, chain.rate, block)
    chosen, ratio, delay = None, 0.0, 0.0
    if second:
        chosen = 0 if records == "lone" else int(rng.integers(IMPACTS))
        ratio = float(rng.choice(RATIOS))
        low, high = max(delays[0], 1.5 * contact + 0.002), delays[1]
        delay = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    forces = []
    for impact in range(1 if records == "lone" else IMPACTS):
        own = Second(ratio, float(rng.uniform(0.7, 1.4)), delay - contact) if impact == chosen else None
        start = float(rng.uniform(0.02, 0.04)) if records != "many" else float(rng.uniform(0.06, 0.2))
        length = block if records != "many" else (block + 0.3) * float(rng.uniform(0.85, 1.15))
        peak = 100 * float(rng.uniform(0.7, 1.3))
        quiet = Chain(chain.rate, chain.tau, chain.filter, chain.cutoff, 0.0)
        forces.append(peak * force(quiet, int(length * chain.rate), start, contact, shape, own))
    if records == "many":
        forces = [np.concatenate(forces)]
    noise, level = chain.noise, float(np.exp(rng.uniform(np.log(1e-4), np.log(1e-2))))
    channels = (
        Channel("hammer", POINT, "force", "reference", "N"),
        Channel("acc", POINT, "acceleration", "response", "m/s^2"),
    )
    recordings = []
    for number, clean in enumerate(forces):
        response = _response(clean, poles, residues, chain.rate)
        signals = np.stack(
            [
                clean + noise * 100 * rng.standard_normal(len(clean)),
                response + level * response.std() * rng.standard_normal(len(clean)),
            ]
        )
        recordings.append(Recording(signals, chain.rate, channels, name=f"record {number + 1}"))
    return Drawn(Run("drawn", Condition(), tuple(recordings)), chosen, delay, ratio, contact, poles, residues)


def _structure(
    rng: np.random.Generator, contact: float, rate: float, block: float
) -> tuple[Complex[np.ndarray, "mode"], Float[np.ndarray, "mode"]]:
    """Modes that the impact excites and whose free vibration has decayed to less than 1 % in two thirds of a block."""
    highest = min(0.8 / contact, 0.35 * rate)
    omega = 2 * np.pi * np.sort(rng.uniform(max(0.05 * highest, 20.0), highest, int(rng.integers(2, 6))))
    slowest = -np.log(0.01) / (0.67 * block)
    decay = slowest * np.exp(rng.uniform(0, np.log(4), len(omega)))
    return -decay + 1j * omega, rng.choice([-1.0, 1.0], len(omega)) * rng.uniform(0.3, 1.0, len(omega)) * decay


def _response(
    signal: Float[np.ndarray, "sample"],
    poles: Complex[np.ndarray, "mode"],
    residues: Float[np.ndarray, "mode"],
    rate: float,
) -> Float[np.ndarray, "sample"]:
    """The response of the modes to a force, by the transform of a signal that is long enough to wrap nothing."""
    size = scipy.fft.next_fast_len(2 * len(signal), real=True)
    s = 2j * np.pi * scipy.fft.rfftfreq(size, 1 / rate)[:, None]
    values = (residues / (s - poles) + residues / (s - poles.conj())).sum(axis=1)
    return np.asarray(scipy.fft.irfft(values * scipy.fft.rfft(signal, size), size)[: len(signal)])
