"""What the window of a random test does to the FRF: averaged Hann blocks multiply the impulse response.

Over stationary white excitation the expected cross spectrum of blocks of length T under a window w is the transform of
h(t) r(t), with r(t) the correlation of the window with itself (Bendat and Piersol, Random Data;
Schmidt 1985), and the force spectrum is flat: H1 shows

    integral_0^T r(t) h(t) exp(-s t) dt   instead of   integral_0^inf h(t) exp(-s t) dt,

which is a peak that is lower and broader. For the Hann window, with u = t / T,

    r(u) = (1 - u) (2/3 + 1/3 cos(2 pi u)) + sin(2 pi u) / (2 pi),

and the transform of r(u) exp(p t) follows in closed form. The difference is taken off the measured FRFs with the modes
of a fit, which is repeated until it converges. The force has to be about flat over each resonance.
"""

import numpy as np
from jaxtyping import Complex
from scipy.sparse.csgraph import connected_components

from ema.data import FrfSet
from ema.shapes import mac
from ema.units import DERIVATIVE_ORDER

TURNS = 12
"""Fits within which the correction has to converge. Blocks of six decay times 1 / d of the slowest mode needed two, of
three times three to eight, and of 1.5 times some did not converge in twelve."""
SETTLED = 0.04
"""Energy, in units of the noise, by which the correction of two turns may differ: no value moves by more than 0.2
standard deviations."""
RESOLVED = 1.5
"""Lines within which two peaks are one under a Hann window, whose half-power bandwidth is 1.44 lines (Harris 1978)."""
ALIKE = 0.9
"""MAC of residues from which on poles that close are taken as one peak, for the initial guess alone."""
SEEN = 2.0
"""Change of a damping ratio by the correction, in its standard deviations, from which on a finding names it."""


def applies(frfs: FrfSet) -> bool:
    """Whether FRFs are known to be averages over Hann blocks of stationary excitation."""
    return frfs.window == "hann" and frfs.record_length is not None and frfs.estimator == "H1"


def excess(
    frfs: FrfSet, poles: Complex[np.ndarray, "mode"], residues: Complex[np.ndarray, "mode out in"]
) -> Complex[np.ndarray, "freq out in"]:
    """What Hann blocks add to FRFs of modes (poles in rad/s, residues of the receptance), in their quantity."""
    assert frfs.record_length is not None
    s = 2j * np.pi * frfs.frequencies[:, None]
    order, duration = DERIVATIVE_ORDER[frfs.quantity], frfs.record_length
    result = np.zeros(frfs.values.shape, complex)
    # The n-th derivative of a free vibration has the residue p^n R; impulses at t = 0 are not touched by the window.
    for p, r in ((poles, residues), (poles.conj(), residues.conj())):
        change = duration * _transform((s - p) * duration) - 1 / (s - p)
        result += np.tensordot(change, p[:, None, None] ** order * r, 1)
    return result


def initial_guess(
    frfs: FrfSet, poles: Complex[np.ndarray, "mode"], residues: Complex[np.ndarray, "mode out in"]
) -> tuple[Complex[np.ndarray, "left"], Complex[np.ndarray, "left out in"]]:
    """Poles and residues without leakage, from those of FRFs with it: a first guess.

    A peak that blocks have broadened is no resonance, and may be described by several poles next to each other. Those
    closer than the blocks resolve and alike are taken as one. The window is 1 at t = 0, so that their residues add up
    to the true one; its decay rate follows from the height of the peak.
    """
    assert frfs.record_length is not None
    duration = frfs.record_length
    flat = residues.reshape(len(poles), -1)
    near = np.abs(poles.imag[:, None] - poles.imag) < RESOLVED * 2 * np.pi / duration
    count, group = connected_components(near & (mac(flat.T, flat.T) > ALIKE), directed=False)
    rates = np.geomspace(1e-4, 1e3, 400)
    heights = duration * _transform(rates[:, None].astype(complex)).real[:, 0]
    guess, total = np.empty(count, complex), np.empty((count, *residues.shape[1:]), complex)
    for number in range(count):
        members = np.flatnonzero(group == number)
        total[number] = residues[members].sum(axis=0)
        energy = np.sum(np.abs(flat[members]) ** 2, axis=1)
        frequency = float(energy @ poles.imag[members] / energy.sum())
        peak = np.sum(flat[members] / (1j * frequency - poles[members])[:, None], axis=0)
        height = np.linalg.norm(peak) / max(np.linalg.norm(total[number]), np.finfo(float).tiny)
        # The height falls with the decay rate.
        rate = float(np.interp(np.log(height), np.log(heights[::-1]), rates[::-1])) / duration
        guess[number] = -rate + 1j * frequency
    return guess, total


def _transform(a: Complex[np.ndarray, "freq mode"]) -> Complex[np.ndarray, "freq mode"]:
    """Integral over u from 0 to 1 of r(u) exp(-a u)."""
    turn = 2j * np.pi
    falling = sum(weight * _ramp(a + shift) for weight, shift in ((2 / 3, 0), (1 / 6, turn), (1 / 6, -turn)))
    result: np.ndarray = falling + (1 - np.exp(-a)) / (a**2 + 4 * np.pi**2)
    return result


def _ramp(a: Complex[np.ndarray, "freq mode"]) -> Complex[np.ndarray, "freq mode"]:
    """Integral over u from 0 to 1 of (1 - u) exp(-a u)."""
    near = np.abs(a) < 1e-2
    safe = np.where(near, 1.0, a)
    series = 0.5 - a / 6 + a**2 / 24 - a**3 / 120
    return np.where(near, series, (safe - 1 + np.exp(-safe)) / safe**2)
