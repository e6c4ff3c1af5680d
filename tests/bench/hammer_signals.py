"""Force signals of hammer impacts with everything a measuring chain adds, and with known truth."""

from dataclasses import dataclass

import numpy as np
import scipy.signal

FINE = 16
"""Samples of the "analogue" signal per sample of the record."""


@dataclass(frozen=True)
class Chain:
    """A measuring chain: sampling rate Hz, high-pass time constant s, anti-alias filter, noise relative to the peak."""

    rate: float
    tau: float
    filter: str
    cutoff: float
    noise: float


@dataclass(frozen=True)
class Second:
    """A second contact: height and width relative to the main one, and its start behind the main one's end in s."""

    ratio: float
    width: float
    gap: float


def draw_chain(rng):
    """Any chain of the goal: 5-50 kHz, noise 0.05-0.2 %, undershoot, three families of anti-alias filters."""
    return Chain(
        rate=float(np.exp(rng.uniform(np.log(5e3), np.log(50e3)))),
        tau=float(np.exp(rng.uniform(np.log(0.05), np.log(5.0)))),
        filter=str(rng.choice(["butterworth", "elliptic", "linear phase"])),
        cutoff=float(rng.uniform(0.39, 0.45)),
        noise=float(np.exp(rng.uniform(np.log(5e-4), np.log(2e-3)))),
    )


def draw_contact(rng):
    """Contact time in s, 0.3-5 ms."""
    return float(np.exp(rng.uniform(np.log(0.3e-3), np.log(5e-3))))


def pulse(t, contact, shape):
    """A pulse of height 1 that starts at 0 and lasts ``contact``."""
    x = np.clip(t / contact, 0, 1)
    if shape == "half sine":
        return np.sin(np.pi * x)
    if shape == "haversine":
        return np.sin(np.pi * x) ** 2
    skew = x**1.2 * (1 - x) ** 2.2
    return skew / (1.2**1.2 * 2.2**2.2 / 3.4**3.4)


def force(chain, samples, start, contact, shape, second=None, rng=None):
    """The recorded force of one impact of height about 1 that starts at ``start`` s; its second contact, where there is one."""
    fine = chain.rate * FINE
    t = np.arange(samples * FINE) / fine
    signal = pulse(t - start, contact, shape)
    if second is not None:
        later = start + contact + second.gap
        signal = signal + second.ratio * pulse(t - later, second.width * contact, shape)
    signal = high_pass(signal, chain.tau, fine)
    signal = anti_alias(signal, chain)[::FINE]
    return signal / signal.max() + (0 if rng is None else chain.noise * rng.standard_normal(samples))


def high_pass(signal, tau, rate):
    """First-order high-pass of an IEPE sensor or an AC coupling: the signal sags and undershoots."""
    a = np.exp(-1 / (tau * rate))
    return scipy.signal.lfilter([(1 + a) / 2, -(1 + a) / 2], [1, -a], signal)


def anti_alias(signal, chain):
    """The anti-alias filter on the fine time axis."""
    cut = 2 * chain.cutoff / FINE
    if chain.filter == "linear phase":
        taps = scipy.signal.firwin(40 * FINE + 1, cut, window=("kaiser", 7.0))
        return scipy.signal.oaconvolve(signal, taps, mode="same")
    if chain.filter == "butterworth":
        sections = scipy.signal.butter(8, cut, output="sos")
    else:
        sections = scipy.signal.ellip(7, 0.1, 80, cut, output="sos")
    return scipy.signal.sosfilt(sections, signal)


def ringing(chain, contact, shape):
    """Largest ripple relative to the peak that the filter leaves later than 2 ms behind the end of the pulse."""
    samples = int((0.02 + 2 * contact) * chain.rate) + 64
    start = 0.004
    with_filter = force(Chain(chain.rate, 1e9, chain.filter, chain.cutoff, 0.0), samples, start, contact, shape)
    behind = int((start + contact) * chain.rate) + 8
    return float(np.abs(with_filter[behind:]).max())
