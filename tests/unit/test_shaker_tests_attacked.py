"""Shaker tests that are not what their campaign states, against vibrations integrated in time."""

import numpy as np
import pytest
import scipy.signal

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import shaker, stepped, sweep
from ema.estimate.gain_changes import about_gains

RATE, FINER = 1024.0, 8
FREQUENCIES, DAMPING = np.array([61.0, 97.5, 148.0]), np.array([0.008, 0.0105, 0.006])
SHAPES = np.random.default_rng(31).normal(size=(5, 3))


def times(seconds):
    return np.arange(int(seconds * RATE) * FINER) / (RATE * FINER)


def chirp(t, band, seconds, level=10.0):
    low, high = band
    return np.where(t < seconds, level * np.sin(2 * np.pi * (low * t + (high - low) / (2 * seconds) * t**2)), 0.0)


def vibration(force):
    """Accelerations at RATE under a force that is linear between samples of FINER * RATE: exact, mode by mode."""
    w, step = 2 * np.pi * FREQUENCIES, 1 / (RATE * FINER)
    answer = np.zeros((len(SHAPES), len(force) // FINER))
    for r, zeta, shape in zip(w, DAMPING, SHAPES.T, strict=True):
        pole = r * (-zeta + 1j * np.sqrt(1 - zeta**2))
        z = pole * step
        late = (np.exp(z) - 1 - z) / z**2
        early = (np.exp(z) - 1) / z - late
        # q = sum of Im(e^(pole t)) / Im(pole) over the force; its second derivative is force - 2 zeta r q' - r^2 q
        state = scipy.signal.lfilter([late * step, early * step], [1, -np.exp(z)], shape[0] * force)[::FINER]
        q, rate = (state / pole.imag).imag, (pole * state / pole.imag).imag
        answer += np.outer(shape, shape[0] * force[::FINER] - 2 * zeta * r * rate - r**2 * q)
    return answer


def accelerance(frequencies):
    """(freq, out) of the structure."""
    w, r = 2 * np.pi * np.asarray(frequencies)[:, None], 2 * np.pi * FREQUENCIES
    return (-(w**2) / (r**2 - w**2 + 2j * DAMPING * r * w)) @ (SHAPES * SHAPES[0]).T


def noisy(signals, rng, share=0.01):
    signals = np.atleast_2d(signals)
    return signals + share * signals.std(axis=1, keepdims=True) * rng.normal(size=signals.shape)


def record(force, answers, name="", more=(), extra=()):
    channels = (
        Channel("F", Dof(1, "+Z"), quantity="force", role="reference", unit="N"),
        *(Channel(f"a{n}", Dof(n, "+Z"), quantity="acceleration", unit="m/s^2") for n in range(1, 1 + len(answers))),
        *extra,
    )
    return Recording(np.vstack([force, answers, *more]), RATE, channels, name=name)


def run(records, kind, **more):
    return Run("test", Condition(Excitation(kind, **more)), tuple(records))


def said(findings, code):
    return [finding for finding in findings if finding.code == code]


def worst(frfs, low, high):
    """Largest error of the FRFs in a band over their largest value."""
    part = frfs.band(low, high)
    wanted = accelerance(part.frequencies)
    return float(np.abs(part.values[:, :, 0] - wanted).max() / np.abs(wanted).max())


def slow_sweep(rng, band, seconds=60.0):
    force = chirp(times(seconds), band, seconds)
    return record(force[::FINER], noisy(vibration(force), rng))


def steps_in_one(rng, lines, stay, noise=0.0):
    phase = 2 * np.pi * np.cumsum(np.repeat(lines, int(stay * RATE) * FINER)) / (RATE * FINER)
    force = 10 * np.sin(phase)
    return record(noisy(force[::FINER], rng, noise)[0], noisy(vibration(force), rng))


@pytest.mark.parametrize("band", [(90.0, 106.0), (106.0, 90.0), (96.0, 99.0)])
@pytest.mark.parametrize("period", [0.25, 1.0])
def test_a_slow_sweep_is_no_stepped_sine(band, period):
    """Its stays had passed for sines: one mode became two, four deviations to either side."""
    take = slow_sweep(np.random.default_rng(1), band)
    with pytest.raises(InputError, match="does not stay"):
        stepped(run([take], "stepped sine", period=period))


@pytest.mark.parametrize(("apart", "noise"), [(0.5, 0.0), (0.03, 0.05)])
def test_steps_one_after_the_other_stay(apart, noise):
    take = steps_in_one(np.random.default_rng(2), 97 + apart * np.arange(12), 2.0, noise)
    frfs = stepped(run([take], "stepped sine", period=2.0), discard=1.0)
    assert worst(frfs, 90, 110) < 0.02


def test_single_sines_are_no_sweep_and_not_random():
    rng = np.random.default_rng(3)
    takes = []
    for line in (95.0, 96.3, 97.5, 99.1):
        force = 10 * np.sin(2 * np.pi * line * times(6))
        takes.append(record(force[::FINER], noisy(vibration(force), rng)))
    for kind, estimate in (("sweep", sweep), ("random", shaker)):
        with pytest.raises(InputError, match="sine of one frequency"):
            estimate(run(takes, kind))


def test_a_sweep_that_repeats_without_a_stated_period_is_named():
    rng = np.random.default_rng(4)
    force = np.tile(chirp(times(4), (20, 200), 4), 5)
    takes = [record(force[::FINER], noisy(vibration(force), rng)) for _ in range(2)]
    (finding,) = said(sweep(run(takes, "sweep")).findings, "excitation-not-as-stated")
    assert finding.severity == "error"
    frfs = sweep(run(takes, "sweep", period=4.0))
    assert not said(frfs.findings, "excitation-not-as-stated") and worst(frfs, 40, 180) < 0.02


def sweeps(rng, count=3, seconds=10.0, rest=6.0, band=(15.0, 240.0)):
    force = chirp(times(seconds + rest), band, seconds)
    answers = vibration(force)
    return [record(force[::FINER], noisy(answers, rng), f"take_{n}") for n in range(count)]


DRIFTS = {
    "line": lambda t: t / t[-1],
    "strong line": lambda t: 20 * t / t[-1],
    "discharge": lambda t: 5 * np.exp(-t / 2),
}


@pytest.mark.parametrize("name", DRIFTS)
def test_drift_of_a_charge_amplifier_is_taken_off(name):
    """A drift by the rms of the vibration had made FRFs ten times as wrong as stated, and lost all modes."""
    rng = np.random.default_rng(5)
    takes = []
    for n, take in enumerate(sweeps(rng)):
        signals = take.signals.copy()
        t = np.arange(signals.shape[1]) / RATE
        signals[1:] += (1 + 0.1 * n) * signals[1:].std(axis=1, keepdims=True) * DRIFTS[name](t)
        takes.append(Recording(signals, RATE, take.channels))
    frfs = sweep(run(takes, "sweep"))
    (finding,) = said(frfs.findings, "drift")
    assert "and 4 further channels" in finding.message and not said(frfs.findings, "leakage")
    inside = frfs.band(30, 230)
    error = np.abs(inside.values[:, :, 0] - accelerance(inside.frequencies)) ** 2
    assert np.mean(error / inside.variance[:, :, 0]) < 1.5


def test_drift_of_the_force_is_taken_off():
    rng = np.random.default_rng(6)
    takes = sweeps(rng)
    for take in takes:
        assert not said(sweep(run([take], "sweep")).findings, "drift")
    signals = takes[0].signals.copy()
    signals[0] += 3 * signals[0].std() * np.linspace(0, 1, signals.shape[1]) ** 2
    frfs = sweep(run([Recording(signals, RATE, takes[0].channels)], "sweep"))
    (finding,) = said(frfs.findings, "drift")
    assert "channel F" in finding.message and worst(frfs, 30, 230) < 0.01


def dropping(force, mass):
    """The force behind a moving mass of a shaker (closed form), which falls at the resonances."""
    drive = accelerance(np.fft.rfftfreq(len(force), 1 / (RATE * FINER)))[:, 0]
    return np.fft.irfft(np.fft.rfft(force) / (1 + mass * drive), len(force))


@pytest.mark.parametrize("period", [np.nan, 12.0])
def test_noise_of_a_force_that_drops_has_no_bias_in_sweeps_that_repeat(period):
    """H1 is too low by the share of noise in the power of the force: by 5 to 70 % about the three peaks."""
    rng = np.random.default_rng(7)
    force = dropping(chirp(times(12), (20, 220), 8), 0.6)
    count = 6 if np.isnan(period) else 1
    if count == 1:
        force = np.tile(force, 7)
    answers = vibration(force)
    takes = [record(noisy(force[::FINER], rng, 0.1)[0], noisy(answers, rng, 0.005)) for _ in range(count)]
    frfs = sweep(run(takes, "sweep", period=period))
    biased = sweep(run(takes, "sweep", period=period), estimator="H2").values * frfs.coherence
    (finding,) = said(frfs.findings, "force-noise")
    wanted = accelerance(frfs.frequencies)
    shares = []
    for frequency in FREQUENCIES:
        line = int(np.abs(frfs.frequencies - frequency).argmin())
        row, near = int(np.abs(wanted[line]).argmax()), slice(line - 4, line + 5)
        ratio = frfs.values[near, row, 0] / wanted[near, row]
        std = np.sqrt(frfs.variance[near, row, 0]) / np.abs(wanted[near, row])
        assert abs(np.mean(ratio) - 1) < 3 * np.mean(std) / 3  # nine lines
        assert np.mean(np.abs(ratio - 1) ** 2 / std**2) < 2.5
        shares.append(1 - np.mean(biased[near, row, 0] / wanted[near, row]).real)
    assert min(shares) > 0.03 and max(shares) > 0.5
    one = force[: int(12 * RATE) * FINER : FINER]
    noise = 0.01 * np.var(one) * len(one)
    lines = np.round(FREQUENCIES * 12).astype(int)
    in_force = noise / (noise + np.abs(np.fft.rfft(one)[lines]) ** 2)
    assert finding.value == pytest.approx(in_force.max(), rel=0.35)


def test_sweeps_whose_force_is_clean_are_h1():
    frfs = sweep(run(sweeps(np.random.default_rng(8)), "sweep"))
    assert not said(frfs.findings, "force-noise")


def test_a_normal_force_that_is_cut_off_is_named():
    rng = np.random.default_rng(9)
    cell = (Channel("ring", quantity="force", role="normal force", unit="N"),)
    for limit, severity in ((1e9, None), (1050.0, "error")):
        takes = []
        for take in sweeps(rng, 2):
            force = 1000 + 60 * rng.normal(size=take.signals.shape[1])
            takes.append(record(take.signals[0], take.signals[1:], more=[np.minimum(force, limit)], extra=cell))
        found = said(sweep(run(takes, "sweep")).findings, "overload")
        assert [finding.severity for finding in found] == ([severity] if severity else [])
        if found:
            assert found[0].value == pytest.approx(0.202, abs=0.02)  # share of a normal distribution above 50 / 60


LINES = np.linspace(89.0, 106.0, 31)


def single_steps(rng, lines=LINES):
    """One record for each frequency, at its steady state in closed form."""
    t = np.arange(int(0.5 * RATE)) / RATE
    takes = []
    for line, answer in zip(lines, accelerance(lines), strict=True):
        wave = 10 * np.exp(2j * np.pi * line * t)
        takes.append(record(wave.imag, noisy((answer[:, None] * wave).imag, rng), f"{line:.4g} Hz"))
    return takes


def amplified(takes, row, gain, which):
    changed = list(takes)
    for k in which:
        signals = takes[k].signals.copy()
        signals[row] *= gain
        changed[k] = Recording(signals, RATE, takes[k].channels, name=takes[k].name)
    return changed


@pytest.mark.parametrize(
    ("row", "gain", "which", "said_gain", "place"),
    [
        (0, 10.0, range(16, 31), 0.1, "from 98.067 Hz on"),
        (0, 0.5, range(20), 0.5, "from 100.33 Hz on"),
        (2, 3.1623, range(14, 31), 3.1623, "from 96.933 Hz on"),
        (3, 1.25, range(17, 31), 1.25, "from 98.633 Hz on"),
    ],
)
def test_a_range_that_is_switched_between_steps_is_named(row, gain, which, said_gain, place):
    """A gain of ten in the force, from the resonance on, had made a damping ratio six deviations too low."""
    rng = np.random.default_rng(10)
    frfs = stepped(run(amplified(single_steps(rng), row, gain, which), "stepped sine"))
    findings = said(frfs.findings, "records-disagree")
    (finding,) = [one for one in findings if one.where.endswith(("F", "a1", "a2", "a3")[row])]
    assert finding.value == pytest.approx(said_gain, rel=0.05) and place in finding.message


def test_lines_that_hardly_resolve_a_resonance_show_no_gain():
    """Closed form: 15 of 32 such tests had a change of a gain named, where a mode lay between two lines."""
    rng = np.random.default_rng(16)
    for _ in range(12):
        poles, ratios = np.sort(rng.uniform(20, 300, 5)), np.exp(rng.uniform(np.log(0.002), np.log(0.03), 5))
        shapes = rng.normal(size=(5, 5))
        f = np.linspace(15, 310, int(rng.integers(20, 80)))
        values = (-(f[:, None] ** 2) / (poles**2 - f[:, None] ** 2 + 2j * ratios * poles * f[:, None])) @ shapes.T
        noise = rng.normal(size=(2, *values.shape)) * 0.01 * np.abs(values) / np.sqrt(2)
        variance = 1e-4 * np.abs(values) ** 2
        noisy_values = values + noise[0] + 1j * noise[1]
        assert not about_gains(f, noisy_values, variance, names=["F", *"abcde"], where="run")


def test_an_frf_that_rises_out_of_noise_has_no_gain_that_changed():
    """Beside an antiresonance; that it had been 49 times too large from a line on was said in 5 of these draws."""
    frequencies = np.linspace(60, 70, 40)
    curve = np.outer(1 / (80.0**2 - frequencies**2), [1.0, 0.0]) + np.outer((frequencies - 64) / 1e6, [0.0, 1.0])
    for seed in range(300):
        rng = np.random.default_rng([seed, 11])
        noise = rng.normal(size=(40, 2)) + 1j * rng.normal(size=(40, 2))
        values, variance = curve + 1e-6 * noise, np.full((40, 2), 2 * 1e-6**2)
        assert not about_gains(frequencies, values, variance, names=["F", "a1", "a2"], where="")


def test_steps_of_one_gain_are_called_clean():
    for seed, lines in ((11, LINES), (12, np.linspace(50, 160, 23)), (13, np.linspace(97, 98, 60))):
        frfs = stepped(run(single_steps(np.random.default_rng(seed), lines), "stepped sine"))
        assert not said(frfs.findings, "records-disagree")


def test_drift_within_a_periodic_sweep_is_taken_off():
    """It had hidden every mode, and that of the force had been called a nonlinear structure."""
    rng = np.random.default_rng(14)
    force = np.tile(chirp(times(4), (15, 240), 4), 8)
    take = record(force[::FINER], noisy(vibration(force), rng))
    ramp = np.linspace(0, 1, take.signals.shape[1])
    for rows in (slice(0, 1), slice(1, 6)):
        signals = take.signals.copy()
        signals[rows] += 5 * signals[rows].std(axis=1, keepdims=True) * ramp
        frfs = sweep(run([Recording(signals, RATE, take.channels)], "sweep", period=4.0))
        assert len(said(frfs.findings, "drift")) == 1 and worst(frfs, 30, 220) < 0.01
        assert not said(frfs.findings, "nonlinear-distortion")
    assert not said(sweep(run([take], "sweep", period=4.0)).findings, "drift")


@pytest.mark.parametrize("method", ["local", "welch"])
def test_drift_of_a_random_force_is_taken_off(method):
    """The lines that it filled were taken for excited ones, and no mode was found."""
    rng = np.random.default_rng(15)
    shape = scipy.signal.butter(4, [20, 250], "band", fs=RATE * FINER, output="sos")
    force = scipy.signal.sosfiltfilt(shape, 100 * rng.normal(size=int(12 * RATE) * FINER))
    measured = force[::FINER] + 10 * force.std() * np.linspace(0, 1, int(12 * RATE))
    take = record(measured, noisy(vibration(force), rng))
    frfs = shaker(run([take], "random"), method=method)
    assert len(said(frfs.findings, "drift")) == 1
    assert frfs.frequencies[0] > 8
    assert method == "welch" or worst(frfs, 40, 180) < 0.03
    assert not said(shaker(run([record(force[::FINER], take.signals[1:])], "random"), method=method).findings, "drift")


@pytest.mark.parametrize("kind", ["random", "sweep"])
@pytest.mark.parametrize("channels", [1, 2, 5])
def test_a_force_that_is_turned_in_one_record_is_named(kind, channels):
    """All its FRFs have the other sign: their mean had been taken with a low coherence at most."""
    rng = np.random.default_rng(61)
    if kind == "sweep":
        takes = sweeps(rng)
    else:
        takes = []
        for n in range(3):
            force = np.cumsum(rng.normal(size=int(4 * RATE) * FINER)) * 0.1
            force = scipy.signal.sosfilt(
                scipy.signal.butter(2, [10, 300], "band", fs=RATE * FINER, output="sos"), force
            )
            takes.append(record(force[::FINER], noisy(vibration(force), rng), f"take_{n}"))
    takes = [record(take.signals[0], take.signals[1 : 1 + channels], take.name) for take in takes]
    estimate = sweep if kind == "sweep" else shaker
    assert not said(estimate(run(takes, kind)).findings, "records-disagree")
    takes[1] = record(-takes[1].signals[0], takes[1].signals[1:], "turned")
    (finding,) = said(estimate(run(takes, kind)).findings, "records-disagree")
    assert "all FRFs from turned" in finding.message and finding.severity == "error"


@pytest.mark.parametrize("kind", ["random", "sweep", "stepped sine"])
def test_channels_that_show_one_signal_are_named(kind):
    rng = np.random.default_rng(62)
    if kind == "stepped sine":
        takes, estimate = single_steps(rng), stepped
    elif kind == "sweep":
        takes, estimate = sweeps(rng), sweep
    else:  # a fit on every line, which short records have fewer of
        takes, estimate = sweeps(rng, seconds=3.0, rest=2.0), shaker
    assert not said(estimate(run(takes, kind)).findings, "equal-channels")
    for source in (0, 2):
        copies = []
        for take in takes:
            signals = np.array(take.signals)
            signals[4] = 0.5 * signals[source]
            copies.append(Recording(signals, RATE, take.channels, name=take.name))
        (finding,) = said(estimate(run(copies, kind)).findings, "equal-channels")
        assert f"channels {'F' if source == 0 else 'a2'} and a4 show one signal" in finding.message
