"""Records of hammer and shaker tests on small structures drawn at random: closed-form decays, none of our solvers.

A beam with a dashpot at one point has complex modes; each of its poles answers a force that is linear from sample to
sample by a recursion without error (four steps for each sample that is kept).
"""

from dataclasses import dataclass

import numpy as np
import scipy.signal

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof

FINER = 4
"""Steps of the simulation for each sample."""


@dataclass(frozen=True)
class Beam:
    """State matrices of a beam in modal coordinates: force at the drive point, accelerations at the points."""

    poles: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray
    through: np.ndarray
    rate: float

    @property
    def time_constant(self) -> float:
        """Of the mode that decays most slowly [s]."""
        return float(1 / np.min(-self.poles.real))

    def answer(self, force: np.ndarray) -> np.ndarray:
        """Accelerations (point, sample) under a force given at `FINER` times the rate; at rest at first."""
        h = 1 / (FINER * self.rate)
        result = self.through[:, None] * force
        for pole, b, c in zip(self.poles, self.inputs, self.outputs.T, strict=True):
            z = pole * h
            e = np.exp(z)
            one, two = (e - 1) / z, (e - 1 - z) / z**2
            state = scipy.signal.lfilter([two * h * b, (one - two) * h * b], [1, -e], force.astype(complex))
            result += 2 * np.real(c[:, None] * state[None, :])
        return result


def beam(rng, rate=2048.0, modes=None, points=4, lightest=0.002, heaviest=0.02, nodes=True, dashpot=0.3) -> Beam:
    """A beam with modes up to 0.35 of the sampling rate, its points at random places (near nodes too)."""
    modes = int(rng.integers(3, 8)) if modes is None else modes
    top = rate * rng.uniform(0.2, 0.35)
    f = np.sort(top * (np.arange(1, modes + 1) + rng.uniform(-0.3, 0.3, modes)) / modes)
    omega = 2 * np.pi * f
    zeta = np.exp(rng.uniform(np.log(lightest), np.log(heaviest), modes))
    order = np.arange(1, modes + 1)
    places = rng.uniform(0.03, 0.97, points) if nodes else np.linspace(0.07, 0.43, points)
    kind = rng.integers(3)

    def shape(x):
        x = np.atleast_1d(x)[:, None]
        if kind == 0:
            return np.sin(order * np.pi * x)
        if kind == 1:
            return np.cos(order * np.pi * x)
        return np.sin((order - 0.5) * np.pi * x)

    phi = shape(places) / np.sqrt(0.5 * rng.uniform(0.5, 5))
    at = shape(rng.uniform(0.1, 0.9))[0]
    damping = np.diag(2 * zeta * omega)
    extra = rng.uniform(0, dashpot) * np.min(np.diag(damping)) * modes
    damping = damping + extra * np.outer(at, at)
    a = np.block([[np.zeros((modes, modes)), np.eye(modes)], [-np.diag(omega**2), -damping]])
    b = np.concatenate([np.zeros(modes), phi[0]])
    values, vectors = np.linalg.eig(a)
    kept = values.imag > 0
    inputs = np.linalg.solve(vectors, b)[kept]
    outputs = (phi @ np.hstack([-np.diag(omega**2), -damping])) @ vectors[:, kept]
    return Beam(values[kept], inputs, outputs, phi @ phi[0], rate)


def random_force(rng, samples, rate, low=0.01, high=0.42) -> np.ndarray:
    """Noise from ``low`` to ``high`` of the rate, at `FINER` times the rate."""
    count = samples * FINER
    f = np.fft.rfftfreq(count, 1 / (FINER * rate))
    spectrum = rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))
    spectrum[(f < low * rate) | (f > high * rate)] = 0
    force = np.fft.irfft(spectrum, count)
    return 10 * force / force.std()


def sweep_force(rng, samples, rate, pause=0.3) -> np.ndarray:
    """A sweep over the band and a pause."""
    count = samples * FINER
    t = np.arange(count) / (FINER * rate)
    stop = (1 - pause) * t[-1]
    low, high = 0.01 * rate, 0.42 * rate
    phase = 2 * np.pi * (low * t + 0.5 * (high - low) * t**2 / stop)
    ends = np.clip(np.minimum(t, stop - t) / (0.02 * stop), 0, 1)
    return 10 * np.sin(phase) * ends


def blow(rng, samples, rate, before) -> np.ndarray:
    """A half sine of two to five samples' length after ``before`` samples."""
    t = np.arange(samples * FINER) / FINER - before - rng.uniform(0, 1)
    width = rng.uniform(2.5, 6)
    return rng.uniform(100, 800) * np.where((t > 0) & (t < width), np.sin(np.pi * t / width), 0.0)


def measured(rng, force, answer, noise):
    """Every ``FINER``-th sample, with noise relative to the rms of each channel (of the force: of its rms)."""
    signals = np.vstack([force, answer])[:, ::FINER]
    size = signals.std(axis=1, keepdims=True)
    return signals + noise * size * rng.standard_normal(signals.shape)


def record(signals, rate, name="take") -> Recording:
    channels = [Channel("force", Dof(1, "+Z"), quantity="force", role="reference", unit="N")]
    channels += [
        Channel(f"a{k}", Dof(k, "+Z"), quantity="acceleration", role="response", unit="m/s^2")
        for k in range(1, len(signals))
    ]
    return Recording(signals, rate, tuple(channels), name=name)


def hammer_run(rng, structure: Beam, noise=0.01, hits=3, length=None, fault=None) -> Run:
    """Impacts at the first point, each in a record of its own that holds the whole decay (to 0.5 %)."""
    rate = structure.rate
    samples = length or int(5.3 * structure.time_constant * rate) + 1024
    records = []
    for k in range(hits):
        before = int(0.06 * rate)
        force = blow(rng, samples, rate, before)
        signals = measured(rng, force, structure.answer(force), 0.0)
        peak = np.abs(signals).max(axis=1, keepdims=True)
        signals += noise * 0.1 * peak * rng.standard_normal(signals.shape)
        signals = fault(signals) if fault else signals
        records.append(record(signals, rate, f"take {k + 1}"))
    return Run("blows", Condition(Excitation("hammer")), tuple(records))


def shaker_run(rng, structure: Beam, noise=0.01, samples=16384, kind="random", force=None, fault=None) -> Run:
    """One record under random noise or a sweep."""
    rate = structure.rate
    if force is None:
        force = {"random": random_force, "sweep": sweep_force}[kind](rng, samples, rate)
    signals = measured(rng, force, structure.answer(force), noise)
    signals = fault(signals) if fault else signals
    return Run("shaker", Condition(Excitation(kind)), (record(signals, rate),))
