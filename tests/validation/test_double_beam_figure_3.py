"""Fig. 3: free vibration after the release of 20 N, its sliding, transition and sticking phases, and the hysteresis.

Gaul, Roseira and Becker, Shock and Vibration 15 (2008) 291-298; 1 kN and 8 kN as there, 100 N and 200 N where enough
sliding cycles exist to measure the phase. Reference set, Eq. (4); truths from beam theory.
"""

from itertools import pairwise

import numpy as np
import pytest

from ema.simulate import Masing, assemble, double_beam, snapback
from ema.simulate.loops import enclosed_area
from ema.simulate.reduction import modal_base

TIP = "beam 2:20:+Z"
E, RHO, L, B, H, MU, LOAD, K = 210e9, 7850.0, 0.5, 0.04, 0.005, 0.3, 20.0, 1e9
INERTIA = B * H**3 / 12
SLIDING = 1.8751040687**2 / (2 * np.pi * L**2) * np.sqrt(E * INERTIA / (RHO * B * H))
STICK = 3 * LOAD * L / (4 * MU * H)


@pytest.fixture(scope="module")
def runs():
    return {
        f: snapback(double_beam(Masing(MU, K), f), LOAD, TIP, d)
        for f, d in ((100.0, 1.5), (200.0, 1.5), (1000.0, 1.0), (8000.0, 1.0))
    }


@pytest.fixture(scope="module")
def stuck():
    return float(modal_base(assemble(double_beam(Masing(MU, K), 0.0))).frequencies[0]) / (2 * np.pi)


def half_cycles(run):
    """Time, frequency and amplitude of every half cycle below 60 Hz (zero phase)."""
    x = run.displacements[0]
    spectrum = np.fft.rfft(np.concatenate([x, x[::-1]]))
    spectrum /= 1 + (np.fft.rfftfreq(2 * len(x), run.times[1]) / 60) ** 12
    y = np.fft.irfft(spectrum, 2 * len(x))[: len(x)]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y)))) + 1
    time, swing = run.times[turns], np.abs(np.diff(y[turns])) / 2
    return 0.5 * (time[1:] + time[:-1]), 0.5 / np.diff(time), swing


@pytest.mark.parametrize("force", [100.0, 200.0])
def test_sliding_phase(runs, force):
    """Frequency of one beam; the amplitude falls along a straight line by the Coulomb decrement; few cycles long."""
    _, frequency, amplitude = half_cycles(runs[force])
    number = int(np.argmax(frequency > 1.05 * SLIDING))
    assert number / 2 == pytest.approx(STICK / (3 * force) - 0.25, abs=1.6)
    early = slice(0, int(0.75 * number))
    assert frequency[early].mean() == pytest.approx(SLIDING, rel=0.01)
    fall = -np.diff(amplitude[early])
    assert 2 * fall.mean() == pytest.approx(4 * MU * force * H * L**2 / (6 * E * INERTIA), rel=0.05)
    assert fall.std() < 0.05 * fall.mean()
    steps = np.arange(len(amplitude[early]))
    line = np.polyval(np.polyfit(steps, amplitude[early], 1), steps)
    exponential = np.exp(np.polyval(np.polyfit(steps, np.log(amplitude[early]), 1), steps))
    misfits = [np.sqrt(np.mean((curve - amplitude[early]) ** 2)) for curve in (line, exponential)]
    assert misfits[1] > 5 * misfits[0]


@pytest.mark.parametrize("force", [100.0, 200.0, 1000.0])
def test_transition_is_short_and_raises_the_frequency(runs, stuck, force):
    _, frequency, amplitude = half_cycles(runs[force])
    first, last = int(np.argmax(frequency > 1.05 * SLIDING)), int(np.argmax(frequency > 0.97 * stuck))
    assert 1 <= last - first <= 7
    assert np.all(np.diff(frequency[first:last]) > 0)
    assert amplitude[last] < 0.15 * amplitude[0]


@pytest.mark.parametrize("force", [200.0, 1000.0, 8000.0])
def test_sticking_phase(runs, stuck, force):
    """Frequency of the stuck beams, nearly twice that of one; no decay: 20 half cycles take 1 % at most."""
    time, frequency, amplitude = half_cycles(runs[force])
    late = (time > 0.6) & (time < 0.95)
    assert frequency[late].mean() == pytest.approx(stuck, rel=5e-3)
    assert 1.85 < frequency[late].mean() / SLIDING < 2.0
    assert amplitude[late][-1] > 0.99 * amplitude[late][0]
    energy = np.interp([0.6, 0.95], runs[force].times, runs[force].energy.total)
    assert energy[1] > 0.99 * energy[0]


def test_high_force_starts_lower_and_only_sticks(runs, stuck):
    """8 kN: smaller deflection, no sliding phase: the stuck frequency from the first half cycle on."""
    _, frequency, amplitude = half_cycles(runs[8000.0])
    assert runs[1000.0].displacements[0, 0] / runs[8000.0].displacements[0, 0] == pytest.approx(3.1, abs=0.1)
    np.testing.assert_allclose(frequency[:20], stuck, rtol=0.015)
    assert amplitude[20] > 0.95 * amplitude[0]


def swings(run, contact, least):
    """Indices between the turning points of a slip that are further apart than ``least`` m."""
    u = run.slips[contact]
    turns, up = [0], u[1] > u[0]
    for n in range(1, len(u)):
        if (u[n] > u[turns[-1]]) == up:
            turns[-1] = n
        elif abs(u[n] - u[turns[-1]]) > least:
            turns.append(n)
            up = not up
    return list(pairwise(turns))


@pytest.mark.parametrize("contact", [4, 9, 14, 19])
def test_loops_at_1_kn_are_parallelograms(runs, contact):
    """Each swing from one reversal to the next dissipates F_C (swing - 2 F_C/k_T), its flanks have the slope k_T."""
    run = runs[1000.0]
    share = (0.5 if contact == 19 else 1.0) / 19.5
    top, k = MU * 1000.0 * share, K * share
    assert np.abs(run.forces[contact]).max() == pytest.approx(top, rel=1e-9)
    large = [(a, b) for a, b in swings(run, contact, 20 * top / k) if abs(np.ptp(run.slips[contact, a : b + 1])) > 0]
    assert len(large) >= 2
    for a, b in large[1:3]:
        u, f = run.slips[contact, a : b + 1], run.forces[contact, a : b + 1]
        width = abs(u[-1] - u[0])
        lost = enclosed_area(u, f) - (f[-1] ** 2 - f[0] ** 2) / (2 * k)
        assert lost == pytest.approx(top * (width - 2 * top / k), rel=0.02)
    flat = np.abs(run.forces[contact]) < 0.9 * top
    both = flat[1:] & flat[:-1] & (np.abs(np.diff(run.slips[contact])) > 1e-9)
    slope = np.diff(run.forces[contact])[both] / np.diff(run.slips[contact])[both]
    assert np.median(slope) == pytest.approx(k, rel=1e-3)


def test_loops_at_8_kn_are_lines_but_for_the_inner_half(runs):
    """Stuck contacts: F = k_T u, no area. The release lets pairs 3 to 9 slip a little; the outer half never does."""
    run = runs[8000.0]
    for contact in (0, 1, *range(9, 20)):
        k = K * (0.5 if contact == 19 else 1.0) / 19.5
        np.testing.assert_allclose(run.forces[contact], k * run.slips[contact], atol=1e-6 * np.abs(run.forces).max())
        assert run.dissipated[contact] < 1e-9 * run.energy.total[0]
    assert np.argmax(run.dissipated) == 4
    assert run.dissipated[2:9].sum() > 0.99 * run.dissipated.sum()


def test_relative_displacement_along_the_beam(runs):
    """Near the clamp it is small, near the tip large: 7, 44 and 57 um in pairs 1, 10 and 20 at 1 kN; 2.8 um at 8 kN."""
    largest = {force: np.abs(run.slips).max(axis=1) for force, run in runs.items()}
    assert np.all(np.diff(largest[1000.0]) > 0)
    np.testing.assert_allclose(1e6 * largest[1000.0][[0, 9, 19]], [6.9, 45.2, 56.8], rtol=0.02)
    assert 1e6 * largest[8000.0].max() == pytest.approx(2.8, rel=0.05)
    assert runs[1000.0].slip_time[0] < runs[100.0].slip_time[0]
