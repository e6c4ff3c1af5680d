"""Fig. 4: velocity of the free vibration at F_N = 6 kN in time and frequency.

Gaul, Roseira and Becker, Shock and Vibration 15 (2008) 291-298. The "measurement" is the exact event-driven solution
with the 0.1 % damping that the paper finds missing in its model; the "computation" is the fast mode without it.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.simulate import Masing, double_beam, snapback
from ema.simulate.events import run_reference
from ema.simulate.transient import prepare, released

TIP = "beam 2:10:+Z"
STUCK = 31.55
MISSING = 0.001 * 2 * (2 * np.pi * STUCK)


def double(damping=0.0):
    return double_beam(Masing(0.3, 1e9), 6000.0, elements=10, damping=Damping(mass_factor=damping))


@pytest.fixture(scope="module")
def pair():
    problem = prepare(double(MISSING), [TIP])
    measured = run_reference(problem, released(problem, 20.0, problem.outputs[0]), 1.5, 5000.0, None, None)
    return measured, snapback(double(), 20.0, TIP, 1.5)


def envelope(run):
    """Amplitude of the first mode over time: analytic signal of the velocity between 15 and 60 Hz."""
    velocity = run.velocities[0]
    spectrum = np.fft.fft(velocity)
    frequencies = np.fft.fftfreq(len(velocity), run.times[1])
    spectrum[(frequencies < 15) | (frequencies > 60)] = 0
    return np.abs(2 * np.fft.ifft(spectrum))


def test_time(pair):
    measured, computed = pair
    early = measured.times < 0.1
    error = np.abs(measured.velocities[0, early] - computed.velocities[0, early]).max()
    assert error < 0.05 * np.abs(measured.velocities[0]).max()


def test_frequency(pair):
    peaks = []
    for run in pair:
        spectrum = np.abs(np.fft.rfft(run.velocities[0] * np.hanning(len(run.times)), 16 * len(run.times)))
        peaks.append(np.argmax(spectrum) / (16 * len(run.times) * run.times[1]))
    assert peaks[0] == pytest.approx(peaks[1], rel=5e-3)
    assert peaks[0] == pytest.approx(STUCK, rel=0.01)


def test_the_missing_exponential_decay_is_seen_and_measured(pair):
    measured, _ = pair
    late = (measured.times > 0.8) & (measured.times < 1.3)
    rates = [-np.polyfit(run.times[late], np.log(envelope(run)[late]), 1)[0] for run in pair]
    assert abs(rates[1]) < 0.1 * rates[0]
    zeta = (rates[0] - rates[1]) / (2 * np.pi * STUCK)
    assert zeta == pytest.approx(0.001, abs=1e-4)
