"""What linear methods read from a mode with a friction joint: fits, averages over impacts, fast sweeps, windows.

One mode at 499 Hz with 0.638 % viscous damping and a Masing joint of kappa times its stiffness; the numbers are those
of independent prototypes on the same oscillator.
"""

from dataclasses import replace

import numba as nb
import numpy as np
import pytest

import ema
from ema.data import (
    BeamModel,
    Channel,
    Condition,
    Damping,
    FrfSet,
    FrictionLaw,
    Joint,
    Matrices,
    ModalModel,
    Run,
    poles_from,
)
from ema.datasets import work_table_hammer
from ema.dof import Dof
from ema.simulate import FrictionRig, RovingHammer, SweptShaker
from tests.closed_forms import masing_oscillator

F0, ZETA = 499.0, 0.00638
OMEGA = 2 * np.pi * F0
LINES = np.arange(440.0, 580.0, 0.25)
AT = Dof(1, "+X")


def steady(ratio, kappa):
    """FRF of unit mass over the lines, slip force ``ratio`` times the force, and the largest A / x_c."""
    values, amplitude = masing_oscillator(LINES, F0, ZETA, ratio, kappa)
    return values, float(amplitude.max() * kappa * OMEGA**2 / ratio)


def frozen(slip, kappa):
    """Damping of the mode at an amplitude of ``slip`` times the slip-through displacement."""
    y = 1 / slip
    theta = np.arccos(1 - 2 * y)
    k = kappa * OMEGA**2
    square = OMEGA**2 + k / np.pi * (theta - np.sin(2 * theta) / 2)
    return (2 * ZETA * OMEGA * np.sqrt(square) + 4 * k * y * (1 - y) / np.pi) / (2 * square)


@pytest.mark.parametrize(
    ("kappa", "slip", "true", "narrow", "wide", "half_power", "left"),
    [
        (0.03, 5.4, 0.924, 0.875, 0.952, 0.828, 0.025),
        (0.03, 2.2, 1.100, 1.027, 1.078, 1.113, 0.074),
        (0.09, 9.6, 1.170, 1.029, 1.186, 0.943, 0.035),
        (0.09, 2.9, 1.890, 1.404, 1.797, 1.727, 0.115),
        (0.09, 1.5, 1.842, 1.657, 1.640, 2.373, 0.168),
    ],
)
def test_a_fit_of_a_friction_peak_misreads_it_and_says_so(kappa, slip, true, narrow, wide, half_power, left):
    """Damping in percent, every entry within 3 %: of one mode fitted over 1.5 half-power widths of the measured peak to
    either side and over all lines, and of the half-power width itself, which takes lines 0.005 Hz apart: those of
    0.25 Hz leave it uncertain by 4 %."""
    assert 100 * frozen(slip, kappa) == pytest.approx(true, rel=0.03)
    low, high = 1e-3, 10.0
    for _ in range(50):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if steady(middle, kappa)[1] > slip else (low, middle)
    ratio = np.sqrt(low * high)
    values, reached = steady(ratio, kappa)
    assert reached == pytest.approx(slip, rel=0.02)
    fine = np.arange(LINES[0], LINES[-1], 0.005)
    size = np.abs(masing_oscillator(fine, F0, ZETA, ratio, kappa)[0])
    above = fine[size**2 >= 0.5 * size.max() ** 2]
    assert 50 * np.ptp(above) / fine[size.argmax()] == pytest.approx(half_power, rel=0.03)
    top = float(LINES[np.abs(values).argmax()])
    width = float(np.ptp(LINES[np.abs(values) ** 2 >= 0.5 * np.abs(values).max() ** 2]))
    frfs = FrfSet(LINES, values[:, None, None], (AT,), (AT,), "receptance", "m/N")
    found = ema.fit.local_fit(frfs.band(top - 1.5 * width, top + 1.5 * width), top, 99.0, np.ones((1, 1)))
    assert 100 * found.damping_ratio == pytest.approx(narrow, rel=0.03)
    assert found.residual == pytest.approx(left, abs=0.01)
    assert (found.residual > 0.05) == any(finding.code == "misfit" for finding in found.findings)
    assert 100 * found.quadrature_damping == pytest.approx(true, rel=0.03)
    assert found.natural_frequency == pytest.approx(top, abs=3.0)
    everything = ema.fit.local_fit(frfs, top, 99.0, np.ones((1, 1)))
    assert 100 * everything.damping_ratio == pytest.approx(wide, rel=0.03)


def oscillator(ratio: float, force: float, kappa: float = 0.03) -> BeamModel:
    """1 kg at 499 Hz that rubs against a wall; slip force ``ratio`` times ``force``."""
    host = Matrices(np.diag([1.0, 1.0]), np.diag([OMEGA**2, 1e9]), (AT, Dof(1, "+Z")))
    wall = Matrices(np.diag([1e3, 1e3]), np.diag([1e16, 1e16]), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    law = FrictionLaw("masing", 1.0, kappa * OMEGA**2)
    return BeamModel(
        host, wall, (Joint("contact", ((1, 1),), (0.0, 0.0), law, ratio * force, 1.0),), Damping(ratio=ZETA)
    )


ACC = (Channel("acc", AT, quantity="acceleration", unit="m/s^2"),)


def swept(ratio: float, period: float) -> tuple[float, list[str]]:
    """Damping from a periodic sweep of 200 to 850 Hz, and the codes of what is noticed about its rate."""
    drive = SweptShaker(AT, 10.0, (200.0, 850.0), period, period * 3, sweeps=3)
    rig = FrictionRig(oscillator(ratio, 10.0), drive, ACC, 4096.0)
    record = rig.take(0)
    run = Run("sweep", Condition(replace(drive.excitation, period=period)), (record,))
    frfs = ema.estimate.sweep(run)
    found = ema.fit.local_fit(frfs.band(440, 560), 502.0)
    noticed = ema.estimate.sweep_rate(record, found.natural_frequency, found.damping_ratio, True, True)[2]
    return found.damping_ratio, [finding.code for finding in noticed]


def independent(ratio: float, period: float, factor: int = 8) -> float:
    """Damping that the same fit reads from the fourth period, integrated step by step (average acceleration)."""
    rate = factor * 4096
    step, k, z = 1 / rate, 0.03 * OMEGA**2, 2 * ZETA * OMEGA
    t = np.arange(round(period * rate)) * step
    force = 10.0 * np.sin(2 * np.pi * (200 * t + 0.5 * 650 / period * t * t))
    x = v = friction = 0.0
    a, taken = float(force[0]), []
    for now in np.tile(force, 4).tolist():
        ahead, guess, pulled = x + step * v + step**2 / 4 * a, x, friction
        for _ in range(4):
            pulled = min(max(friction + k * (guess - x), -10.0 * ratio), 10.0 * ratio)
            new = (now - pulled - z * (v + step / 2 * a) - OMEGA**2 * ahead) / (
                1 + z * step / 2 + (OMEGA * step) ** 2 / 4
            )
            guess = ahead + step**2 / 4 * new
        v, x, a, friction = v + step / 2 * (a + new), guess, new, pulled
        taken.append(a)
    frequencies = np.fft.rfftfreq(len(t), step)
    held = (frequencies > 440) & (frequencies < 560)
    values = (np.fft.rfft(taken[-len(t) :]) / np.fft.rfft(force))[held]
    frfs = FrfSet(frequencies[held], values[:, None, None], (AT,), (AT,), "accelerance", "(m/s^2)/N")
    return ema.fit.local_fit(frfs, 502.0).damping_ratio


def test_a_fast_sweep_misreads_a_friction_joint_and_is_flagged():
    """A sweep of 1 s reads a fifth too much at this slip force and a third too little at twice as much: either sign."""

    def stepped(ratio):
        frfs = FrfSet(LINES, steady(ratio, 0.03)[0][:, None, None], (AT,), (AT,), "receptance", "m/N")
        return ema.fit.local_fit(frfs, 502.0).damping_ratio

    fast, told = swept(0.3, 1.0)
    assert fast / stepped(0.3) == pytest.approx(1.20, abs=0.03) and "sweep-rate" in told
    assert fast == pytest.approx(independent(0.3, 1.0), rel=0.03)
    less, told = swept(0.6, 1.0)
    assert less / stepped(0.6) < 0.8 and "sweep-rate" in told
    slow, told = swept(0.3, 16.0)
    assert slow == pytest.approx(stepped(0.3), rel=0.02) and "sweep-rate" not in told


CONTACT = 0.5e-3


def impacts(model: BeamModel, level: float) -> tuple[list[float], list[FrfSet]]:
    """Peak forces of ten impacts with 35 % scatter by their impulses, N; their FRFs by H1, and the mean of ten FRFs."""
    drive = RovingHammer((AT,), hits=10, peak=level, scatter=0.35, contact_time=CONTACT, spacing=1.2)
    record = FrictionRig(model, drive, ACC, 4096.0, seed=4).take(0)
    size = round(drive.spacing * record.sampling_rate)
    first = int(np.flatnonzero(np.abs(record.signals[0]) > 0.1 * level)[0]) - round(0.1 * record.sampling_rate)
    cut = [
        replace(record, signals=np.array(record.signals[:, start : start + size]))
        for start in range(max(first, 0), record.signals.shape[1] - size + 1, size)
    ]
    assert len(cut) >= 9
    condition = Condition(drive.excitation)
    single = [
        ema.estimate.hammer(Run("impact", condition, (one,)), ema.estimate.HammerSettings(block=4096)) for one in cut
    ]
    every = ema.estimate.hammer(Run("impacts", condition, tuple(cut)), ema.estimate.HammerSettings(block=4096))
    peaks = [np.pi / 2 / CONTACT * float(one.signals[0].sum()) / record.sampling_rate for one in cut]
    mean = np.mean([one.values for one in single], axis=0)
    return peaks, [every, replace(every, values=mean, variance=None, coherence=None)]


@nb.njit
def struck(force, step, stiffness, limit):
    """Acceleration of the oscillator under a force, step by step (average acceleration), with a Masing spring."""
    x, v, pulled = 0.0, 0.0, 0.0
    a = force[0]
    taken = np.empty(len(force))
    for i in range(len(force)):
        ahead = x + step * v + step**2 / 4 * a
        guess, held, new = x, pulled, a
        for _ in range(8):
            held = min(max(pulled + stiffness * (guess - x), -limit), limit)
            rest = force[i] - held - 2 * ZETA * OMEGA * (v + step / 2 * a) - OMEGA**2 * ahead
            new = rest / (1 + ZETA * OMEGA * step + OMEGA**2 * step**2 / 4)
            guess = ahead + step**2 / 4 * new
        v, x, a, pulled = v + step / 2 * (a + new), guess, new, held
        taken[i] = a
    return taken


def mean_over_h1(peaks, kappa: float, limit: float, near: float) -> float:
    """Damping read from the mean of the FRFs of half sines over that from H1, less one, integrated independently."""
    rate = 65536
    t = np.arange(rate) / rate
    pulses = [np.where(t < CONTACT, peak * np.sin(np.pi * t / CONTACT), 0.0) for peak in peaks]
    force = np.fft.rfft(pulses)
    moved = np.fft.rfft([struck(pulse, 1 / rate, kappa * OMEGA**2, limit) for pulse in pulses])
    lines = slice(441, 570)
    values = [(force.conj() * moved).sum(axis=0) / (abs(force) ** 2).sum(axis=0), (moved / force).mean(axis=0)]
    read = []
    for one in values:
        frfs = FrfSet(np.arange(441.0, 570.0), one[lines, None, None], (AT,), (AT,), "accelerance", "(m/s^2)/N")
        read.append(ema.fit.local_fit(frfs, near).damping_ratio)
    return read[1] / read[0] - 1


@pytest.mark.parametrize(("limit", "low", "high"), [(3.0, 0.05, 0.15), (6.0, -0.5, -0.2), (1e6, -0.005, 0.005)])
def test_the_mean_of_frfs_is_not_h1_where_friction_acts(limit, low, high):
    """Asked was a mean of FRFs that reads 5 to 15 % more damping than H1 from friction, and the same from a linear
    structure. Impacts that slip throughout show it, 11 %. It is no rule: where the weakest impacts stick, the mean reads a
    third less, and an independent integration of the same impacts says the same (11 and -36 %)."""
    near = {3.0: 504.0, 6.0: 518.0, 1e6: 521.0}[limit]
    peaks, both = impacts(oscillator(limit / 10, 10.0, 0.09), 500.0)
    h1, mean = (ema.fit.local_fit(one.band(440, 570), near).damping_ratio for one in both)
    assert low <= mean / h1 - 1 <= high
    assert mean / h1 - 1 == pytest.approx(mean_over_h1(peaks, 0.09, limit, near), abs=0.03)


@pytest.mark.parametrize("duration", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("end", [0.3, 0.1, 0.01, 0.001])
def test_the_window_of_a_hammer_test_is_taken_off_the_damping(duration, end):
    from ema.simulate import VirtualRig

    pole = poles_from(np.array([F0]), np.array([ZETA]))
    model = ModalModel(
        pole, np.ones((1, 1), complex), (AT,), 1 / (2j * pole.imag)[None], (AT,), scaling="unit modal mass"
    )
    drive = RovingHammer((AT,), hits=3, peak=500.0, contact_time=0.4e-3, spacing=max(1.3 * duration, 0.9))
    rig = VirtualRig(model, drive, ACC, 8192.0, noise={"acceleration": 0.05, "force": 0.02}, seed=2)
    run = Run("hammer", Condition(rig.drive.excitation), (rig.take(0),))
    frfs = ema.estimate.hammer(
        run, ema.estimate.HammerSettings(block=round(duration * 8192), decay=-np.log(end) / duration)
    )
    assert ema.fit.local_fit(frfs.band(400, 600), F0).damping_ratio == pytest.approx(ZETA, rel=0.005)


def of_hammer(force: float, peak: float) -> float:
    """Damping of mode 1 of the work table under impacts of ``peak`` N, by a fit of one mode to six points."""
    rig = work_table_hammer._rig(f"{force:g} N", force, peak, (1, 10, 71, 80, 35, 46))
    run = Run("hammer", Condition(rig.drive.excitation), tuple(rig.takes()))
    return ema.fit.local_fit(ema.estimate.hammer(run).band(430, 560), 500.0).damping_ratio


def test_half_the_impact_changes_the_damping_at_1_kn_only():
    assert abs(of_hammer(1000.0, 500.0) / of_hammer(1000.0, 1000.0) - 1) >= 0.30
    for force in (5000.0, 10000.0):
        assert of_hammer(force, 500.0) == pytest.approx(of_hammer(force, 1000.0), rel=0.05)
