"""Records of hammer tests in closed form: half-sine impacts on a structure of known modes, sampled exactly."""

from collections.abc import Callable

import numpy as np

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof

FREQUENCIES = np.array([22.4, 47.3, 61.8, 131.0])
DAMPING = np.array([0.011, 0.007, 0.009, 0.006])
POINTS = 5
_PLACES = np.arange(1, POINTS + 1) / (POINTS + 1.3)
SHAPES = np.column_stack([np.sin(order * np.pi * _PLACES) for order in (1, 2, 3, 4)]) / np.sqrt(1.7)
"""Unit modal mass; four modes at ``1:+Z`` to ``5:+Z``."""
RATE = 1024.0
CONTACT = 0.004


def impact(times: np.ndarray, peak: float, begin: float, outputs: list[int], point: int) -> np.ndarray:
    """Force [N] and accelerations [m/s^2] of a half sine of 4 ms that begins at ``begin`` [s], at points from 1 on.

    A mode answers the pulse with ``q'' = Im(p^2 I) / w_d + f``, ``I`` the integral of ``exp(p (t - tau)) f(tau)``.
    """
    since = times - begin
    inside = (since >= 0) & (since <= CONTACT)
    force = np.where(inside, peak * np.sin(np.pi * np.clip(since, 0, CONTACT) / CONTACT), 0.0)
    omega, rate = 2 * np.pi * FREQUENCIES, np.pi / CONTACT
    damped = omega * np.sqrt(1 - DAMPING**2)
    pole = -DAMPING * omega + 1j * damped
    pressed, later = np.clip(since, 0, CONTACT)[:, None], np.clip(since - CONTACT, 0, None)[:, None]
    integral = rate * np.exp(pole * pressed) - pole * np.sin(rate * pressed) - rate * np.cos(rate * pressed)
    integral = np.where(since[:, None] < 0, 0, integral * np.exp(pole * later)) * peak / (pole**2 + rate**2)
    modal = np.imag(pole**2 * integral) / damped + force[:, None]
    rows = [modal @ (SHAPES[output - 1] * SHAPES[point - 1]) for output in outputs]
    return np.array([force, *rows])


Change = Callable[[int, int, np.ndarray, np.ndarray], np.ndarray]
"""From point, number of the impact, times and signals to the signals that are recorded."""


def hammer_run(
    change: Change | None = None,
    *,
    outputs: tuple[int, ...] = (1, 4),
    points: tuple[int, ...] = (1, 2, 3, 4, 5),
    impacts: int = 3,
    duration: float = 2.0,
    noise: float = 0.002,
    seed: int = 0,
) -> Run:
    """A roving hammer with fixed accelerometers: impacts of 80, 91, 102 ... N, noise relative to each channel's peak."""
    times = np.arange(round(duration * RATE)) / RATE
    records = []
    for point in points:
        for number in range(impacts):
            rng = np.random.default_rng(1000 * seed + 100 * point + number)
            signals = impact(times, 80.0 + 11 * number, 0.05, list(outputs), point)
            signals = signals + noise * np.abs(signals).max(axis=1, keepdims=True) * rng.standard_normal(signals.shape)
            if change is not None:
                signals = change(point, number, times, signals)
            channels = (
                Channel("hammer", Dof(point, "+Z"), "force", "reference", "N"),
                *(Channel(f"a{one}", Dof(one, "+Z"), "acceleration", "response", "m/s^2") for one in outputs),
            )
            records.append(Recording(signals, RATE, channels, name=f"p{point}_{number}"))
    return Run("bare", Condition(Excitation("hammer")), tuple(records))
