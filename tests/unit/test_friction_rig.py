"""A structure with friction is measured: linear limits give its modes, friction gives what harmonic balance says."""

from pathlib import Path

import numpy as np
import pytest

import acquisition
from ema.data import Channel, Condition, Damping, Recording, Run, Source
from ema.dof import Dof
from ema.elements import Section
from ema.errors import InputError
from ema.estimate import hammer, ring_down, sweep
from ema.fit import modes, stabilise
from ema.simulate import (
    FrictionRig,
    Masing,
    RandomShakers,
    RingCell,
    RovingHammer,
    SnapBack,
    SteppedSine,
    SweptShaker,
    double_beam,
    hammer_pulse,
    resonance,
    respond,
    snapback,
    stepped_sine,
    swept_sine,
)
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble

TIP = Dof(8, "+Z", "beam 2")
SENSOR = Dof(8, "+Z", "beam 1")
STUCK = 1e7


def model(normal_force: float, ratio: float = 0.006):
    return double_beam(
        Masing(0.3, 1e9), normal_force, Section(0.5, 0.04, 0.005, elements=8), damping=Damping(ratio=ratio)
    )


def acc(dof: Dof = SENSOR, quantity: str = "acceleration", **more) -> Channel:
    unit = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}[quantity]
    return Channel(f"{quantity} {dof.node}", dof, quantity, unit=unit, **more)


def measured(rig: FrictionRig) -> Run:
    return Run("r", Condition(rig.drive.excitation), tuple(rig.takes()))


@pytest.fixture(scope="module")
def truth():
    base = modal_base(assemble(model(STUCK)))
    return base.frequencies / (2 * np.pi)


def test_a_hammer_test_of_a_stuck_beam_gives_its_modes(truth):
    points = tuple(Dof(n, "+Z", "beam 2") for n in (2, 3, 5, 6, 7, 8))
    rig = FrictionRig(model(STUCK), RovingHammer(points, hits=1, spacing=6.0, contact_time=1e-3), (acc(),), 2048.0)
    band = hammer(measured(rig)).band(15.0, 600.0)
    found = modes(band, stabilise(band))
    assert found.natural_frequencies == pytest.approx(truth[:3], rel=1e-3)
    assert found.damping_ratios == pytest.approx(0.006, rel=1e-3)


def test_a_blow_on_a_stuck_beam_has_the_spectra_of_its_modes(truth):
    """The spectra of a record alone, no estimate and no fit; its end cuts off exp(-zeta omega T) of the first mode."""
    stuck, length = model(STUCK), 6.0
    rig = FrictionRig(stuck, RovingHammer((TIP,), hits=1, spacing=length, contact_time=1e-3), (acc(),), 2048.0)
    force, motion = np.fft.rfft(rig.take(0).signals, axis=1)
    base, system = modal_base(assemble(stuck)), assemble(stuck)
    lines = np.fft.rfftfreq(rig.take(0).signals.shape[1], 1 / 2048.0)
    for frequency in truth[:3]:
        line = np.abs(lines - frequency).argmin()
        rate = 2j * np.pi * lines[line]
        gains = rate**2 / (base.frequencies**2 + rate**2 + rate * base.decay)
        expected = gains @ (base.row(system, SENSOR) * base.row(system, TIP))
        cut = np.exp(-0.006 * 2 * np.pi * frequency * length)
        assert abs(motion[line] / force[line] / expected - 1) < 2e-4 + 1.2 * cut


def test_a_sweep_of_a_stuck_beam_gives_its_mode(truth):
    rig = FrictionRig(model(STUCK), SweptShaker(TIP, 10.0, (15.0, 60.0), 8.0, 12.0), (acc(),), 1024.0)
    lines = sweep(measured(rig), band=(15.0, 60.0))
    found = modes(lines, stabilise(lines))
    assert found.natural_frequencies == pytest.approx(truth[:1], rel=1e-3)
    assert found.damping_ratios == pytest.approx(0.006, rel=1e-3)


@pytest.mark.parametrize("level", [1.0, 2.0])
def test_stepped_sine_in_time_is_that_of_harmonic_balance(level):
    frequencies = (16.5, 16.9)
    drives = [SteppedSine(TIP, level, frequencies, 0.6, settle) for settle in (None, 5.0)]
    lengths = [2 * np.pi * f * np.arange(round(9 / f * 512)) / 512 for f in frequencies]
    found = []
    for drive in drives:
        takes = list(FrictionRig(model(100.0), drive, (acc(),), 512.0).takes())
        spectra = [
            take.signals[:, : len(angle)] @ np.exp(-1j * angle) for take, angle in zip(takes, lengths, strict=True)
        ]
        found.append([abs(s[1] / s[0]) for s in spectra])
    assert found[1] == pytest.approx(found[0], rel=0.02)


def test_damping_falls_with_the_level_on_the_slip_side_as_harmonic_balance_says():
    """A slow sweep at three levels: frequency response peaks within 10 %, damping by the fit in the same order."""
    peaks, fits, expected = [], [], []
    for level in (1.0, 2.0, 4.0):
        rig = FrictionRig(model(100.0), SweptShaker(TIP, level, (14.5, 19.5), 30.0, 33.0), (acc(),), 512.0)
        lines = sweep(measured(rig), band=(15.0, 19.0))
        peaks.append(np.abs(lines.values).max())
        fits.append(float(modes(lines, stabilise(lines), near=[16.8]).damping_ratios[0]))
        top = resonance(model(100.0), level, TIP, SENSOR, (14.5, 19.5))
        expected.append((abs(top.amplitude) * (2 * np.pi * top.frequency) ** 2 / level, top.damping))
    wanted = np.array(expected)
    assert np.all(np.diff(wanted[:, 1]) < 0) and np.all(np.diff(fits) < 0)
    assert fits == pytest.approx(wanted[:, 1], rel=0.3)
    assert peaks[1:] == pytest.approx(wanted[1:, 0], rel=0.25)


def test_a_release_is_that_of_the_time_solver():
    drive = SnapBack(TIP, 20.0, 1.0, pre_trigger=0.2)
    sensors = (acc(TIP, "displacement"), acc(TIP, "velocity"), acc(TIP))
    take = FrictionRig(model(200.0), drive, sensors, 1024.0).take(0)
    plain = snapback(model(200.0), 20.0, TIP, 0.8, sampling_rate=1024.0)
    begin = round(0.2 * 1024)
    assert take.signals[0, : begin - 40] == pytest.approx(20.0, rel=1e-3)
    assert np.abs(take.signals[0, begin + 40 :]).max() < 0.05
    later = slice(begin + 100, begin + 700)
    behind = slice(100, 700)
    for row, motion in ((1, plain.displacements[0]), (2, plain.velocities[0])):
        assert np.abs(take.signals[row, later] - motion[behind]).max() < 0.02 * np.abs(motion).max()
    slope = np.gradient(take.signals[2], 1 / 1024.0)
    low = ring_down(Recording(slope[None], 1024.0, (acc(TIP),)), (8.0, 45.0))
    same = ring_down(Recording(take.signals[3:], 1024.0, (acc(TIP),)), (8.0, 45.0))
    assert same.knee == pytest.approx(low.knee, abs=0.01)


def test_random_forces_have_their_level():
    drive = RandomShakers((TIP,), 3.0, (10.0, 200.0), 4.0)
    take = FrictionRig(model(STUCK), drive, (acc(),), 1024.0).take(0)
    assert np.sqrt(np.mean(take.signals[0] ** 2)) == pytest.approx(3.0, rel=0.15)
    spectrum = np.abs(np.fft.rfft(take.signals[0])) ** 2
    lines = np.fft.rfftfreq(take.signals.shape[1], 1 / 1024.0)
    assert spectrum[lines > 230].sum() < 1e-3 * spectrum.sum()


def test_ring_cells_show_static_and_dynamic_force_drift_noise_and_their_calibration():
    drive = RovingHammer((TIP,), hits=1, spacing=1.5, peak=50.0)
    rings = (RingCell("interface"), RingCell("interface", rms=0.3, drift=-4.0, gain=1.05))
    plain, poor = FrictionRig(model(200.0), drive, (acc(),), 1024.0, rings=rings).take(0).signals[2:]
    assert plain[:90] == pytest.approx(200.0, abs=0.01)
    assert 0.5 < np.ptp(plain) < 200.0
    t = np.linspace(-0.5, 0.5, len(plain))
    rest = poor - 1.05 * plain + 4.0 * t
    assert rest.mean() == pytest.approx(0.0, abs=0.05) and rest.std() == pytest.approx(0.3, rel=0.1)
    held = FrictionRig(model(200.0), drive, (acc(),), 1024.0, rings=(RingCell("interface", mean=150.0),)).take(0)
    assert held.signals[2, :90] == pytest.approx(150.0, abs=0.01)
    assert held.channels[2].role == "normal force" and held.channels[2].joint == "interface"


def test_the_opening_of_the_interface_is_the_loss_of_normal_force():
    """The sum of the pair forces, from the displacements of the time solver."""
    plain, drive = model(200.0), RovingHammer((TIP,), hits=1, spacing=0.5, peak=50.0, scatter=0.0, contact_time=4e-3)
    (ring,) = FrictionRig(plain, drive, (acc(),), 2048.0, rings=(RingCell("interface"),)).take(0).signals[2:]
    times = np.arange(ring.size) / 2048.0
    rng = np.random.default_rng([0, 0])
    (blow,) = drive.blows(0, rng)
    force = hammer_pulse(times, blow.peak, blow.contact_time, blow.time)[None]
    nodes = [(f"beam 1:{n}:+Z", f"beam 2:{n}:+Z") for n in range(1, 9)]
    moved = respond(plain, force, [TIP], 2048.0, [dof for pair in nodes for dof in pair]).displacements
    (joint,) = plain.joints
    lost = joint.normal_stiffness * (np.asarray(joint.area_shares) @ (moved[1::2] - moved[::2]))
    assert ring == pytest.approx(200.0 - lost, abs=0.05 * np.ptp(lost))


def table_under_a_roving_hammer() -> FrictionRig:
    """A table with a friction beam: 5 impacts a point, 2 accelerometers, a load cell under each joint."""
    table = acquisition.open_model(Path(__file__).parents[2] / "datasets" / "table_with_beam")
    points = tuple(Dof(n, "-Z", "table") for n in range(2))
    sensors = (acc(Dof(0, "+Z", "table")), acc(Dof(59, "+Z", "table")))
    return FrictionRig(table, RovingHammer(points, hits=5), sensors, 4096.0, rings=(RingCell("J1"), RingCell("J2")))


def test_a_take_of_a_roving_hammer_over_a_table_is_the_same_whenever_it_is_taken():
    rig = table_under_a_roving_hammer()
    record = rig.take(1)
    assert record.signals.shape == (5, round(4096 * 5.6)) and isinstance(rig, Source)
    assert np.array_equal(rig.take(1).signals, record.signals)


def test_wrong_orders_are_refused_with_a_sentence():
    drive = RovingHammer((TIP,), hits=1)
    with pytest.raises(InputError, match="no such joint; got J9, expected one of interface"):
        FrictionRig(model(100.0), drive, (acc(),), 1024.0, rings=(RingCell("J9"),))
    with pytest.raises(InputError, match="needs a DOF and a motion"):
        FrictionRig(model(100.0), drive, (Channel("x"),), 1024.0)
    with pytest.raises(InputError, match="not a sampling rate"):
        FrictionRig(model(100.0), drive, (acc(),), 0.0)
    with pytest.raises(InputError, match=r"no such DOF; got beam 7:1:.Z"):
        FrictionRig(model(100.0), drive, (acc(Dof(1, "+Z", "beam 7")),), 1024.0).take(0)
    for wrong in (
        lambda t: hammer_pulse(t, 1.0, 0.0),
        lambda t: swept_sine(t, 1.0, (0.0, 10.0), 1.0),
        lambda t: swept_sine(t, 1.0, (1.0, 10.0), np.nan),
        lambda t: stepped_sine(t, 1.0, [5.0, -1.0], 1.0),
    ):
        with pytest.raises(InputError, match="not a positive number"):
            wrong(np.arange(10.0))


def test_waveforms():
    t = np.arange(0, 3.0, 1e-4)
    pulse = hammer_pulse(t, 5.0, 2e-3, 0.5)
    assert pulse.max() == pytest.approx(5.0, rel=1e-3) and np.trapezoid(pulse, t) == pytest.approx(
        5 * 2e-3 * 2 / np.pi, rel=5e-3
    )
    chirp = swept_sine(t, 2.0, (10.0, 100.0), 1.0, sweeps=2)
    assert np.allclose(chirp[:10000], chirp[10000:20000], atol=1e-8) and not chirp[20000:].any()
    crossings = np.flatnonzero(np.diff(np.sign(chirp[:10000])))
    assert len(crossings) == pytest.approx(2 * 55, abs=2)
    steps = stepped_sine(t, 1.0, [10.25, 20.0], 1.0)
    assert np.abs(np.diff(steps[:20000])).max() < 2 * np.pi * 20.1 * 1e-4 and not steps[20000:].any()
