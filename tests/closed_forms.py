"""Steady states that can be written down, to hold solvers and estimators against."""

import numpy as np


def masing_oscillator(lines, frequency, damping, ratio, kappa):
    """Receptance and amplitude per force of a unit mass with a Masing spring, first harmonic, at every line in Hz.

    ``frequency`` Hz and ``damping`` without the joint; its stiffness is ``kappa`` times that of the mode, its slip force
    ``ratio`` times the exciting force. The amplitude is found by bisection.
    """
    omega, w = 2 * np.pi * frequency, 2 * np.pi * lines
    k = kappa * omega**2

    def stiffness(amplitude):
        y = np.minimum(ratio / (k * amplitude), 1.0)
        theta = np.arccos(1 - 2 * y)
        contact = k / np.pi * (theta - np.sin(2 * theta) / 2) + 4j * k * y * (1 - y) / np.pi
        return omega**2 - w**2 + 2j * damping * omega * w + contact

    low, high = np.full(len(w), np.log(1e-12)), np.zeros(len(w))
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = np.abs(stiffness(np.exp(middle))) * np.exp(middle) < 1
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    amplitude = np.exp(low)
    return 1 / stiffness(amplitude), amplitude
