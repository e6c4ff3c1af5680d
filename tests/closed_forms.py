"""Losses and steady states that can be written down, to compare solvers and estimators with."""

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from ema.contact.curves import virgin_rate


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


def masing_area(stiffness, slip_force, amplitude):
    """Closed-form energy per cycle of a Masing spring, 4 F_C (A - F_C/k_T) above A = F_C/k_T, else 0."""
    return max(4 * slip_force * (amplitude - slip_force / stiffness), 0.0)


def regularised_area(stiffness, slip_force, amplitude, exponent):
    """Energy per stabilised cycle of Eq. (5) by quadrature of its virgin curve.

    Unloading is elastic to F = 0; from there the virgin curve is followed to the other end, so that
    W = 2 (integral of F dx over the virgin part - F_max^2 / 2 k_T).
    """

    def part(y, weighted):
        def rate(q):
            return float(virgin_rate(np.asarray(q), exponent)) * (-np.expm1(-q) if weighted else 1.0)

        return float(quad(rate, 0, y, epsabs=0, epsrel=1e-9, limit=500)[0])

    way = 2 * amplitude * stiffness / slip_force
    y = brentq(lambda q: part(q, False) - np.expm1(-q) - way, 1e-12, 36 + exponent * way, xtol=1e-14)
    return float(2 * (slip_force**2 / stiffness) * (part(y, True) - 0.5 * np.expm1(-y) ** 2))


def dahl_area(stiffness, slip_force, amplitude):
    """Closed-form energy per stabilised cycle of Dahl's law with shape 1: 4 F_C (A - F_C/k_T tanh(k_T A/F_C))."""
    ratio = stiffness * amplitude / slip_force
    return float(4 * slip_force * (amplitude - slip_force / stiffness * np.tanh(ratio)))


def iwan_area(stiffness, slip_force, amplitude, chi, beta):
    """Closed-form energy per cycle of the continuous Iwan model in microslip, ~ A^(chi + 3) (Segalman 2005)."""
    scale = beta + (chi + 1) / (chi + 2)
    largest = slip_force * (1 + beta) / (stiffness * scale)
    density = slip_force * (chi + 1) / (largest ** (chi + 2) * scale)
    return float(4 * density * amplitude ** (chi + 3) / ((chi + 3) * (chi + 2)))


def damping_rule(slip_stiffness, slip_shape, frequency):
    """Largest damping that a Masing contact adds to a mode, kappa / (2 pi (1 + kappa/2)), kappa = k psi^2 / w^2.

    ``slip_stiffness`` k N/m (contact and beam in series), ``slip_shape`` psi the mass-normalised modal relative
    displacement, ``frequency`` Hz of the mode. Power balance at the amplitude 2 F_C/k, Masing's describing function.
    """
    kappa = slip_stiffness * slip_shape**2 / (2 * np.pi * frequency) ** 2
    return float(kappa / (2 * np.pi * (1 + kappa / 2)))


def slip_force_rule(added, total, force, shape_at_force, slip_shape):
    """Slip force mu F_N in N of most damping under a harmonic force: (pi/2) (dzeta/zeta) F_E phi_e/psi."""
    return float(np.pi / 2 * added / total * force * shape_at_force / slip_shape)
