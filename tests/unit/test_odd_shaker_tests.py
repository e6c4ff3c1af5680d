"""Shaker tests as they go wrong in a laboratory: what is said of them, against FRFs in closed form."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import force_at_resonance, local_model, random_excitation, shaker, stepped, sweep
from ema.study.chain import default_band, fitted
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable, FitTable

RATE = 512.0
FREQUENCIES, DAMPING = np.array([41.0, 63.0, 97.0]), np.array([0.012, 0.009, 0.015])
SHAPES = np.random.default_rng(8).normal(size=(5, 3))


def accelerance(frequencies, inputs=(0,), warmer=1.0):
    """(out, in, freq) of the structure, whose frequencies change by a factor when it is warmer."""
    w, r = 2 * np.pi * np.asarray(frequencies), 2 * np.pi * warmer * FREQUENCIES[:, None]
    modes = -(w**2) / (r**2 - w**2 + 2j * DAMPING[:, None] * r * w)
    return np.einsum("om,im,mf->oif", SHAPES, SHAPES[list(inputs)], modes)


def responses(forces, rng, noise=0.01, inputs=(0,), warmer=1.0):
    """Accelerations of a structure at rest under band-limited forces, with noise."""
    forces = np.atleast_2d(forces)
    length = 2 ** int(np.ceil(np.log2(forces.shape[1] + 12 * RATE)))
    structure = accelerance(np.fft.rfftfreq(length, 1 / RATE), inputs, warmer)
    answer = np.fft.irfft(np.einsum("oif,if->of", structure, np.fft.rfft(forces, length)), length)[:, : forces.shape[1]]
    return answer + noise * answer.std(axis=1, keepdims=True) * rng.normal(size=answer.shape)


def record(forces, answers, name="", **more):
    forces = np.atleast_2d(forces)
    force = [Channel(f"F{n + 1}", Dof((1, 4)[n], "+Z"), quantity="force", role="reference", unit="N") for n in range(2)]
    acceleration = [
        Channel(f"a{n + 1}", Dof(n + 1, "+Z"), quantity="acceleration", unit="m/s^2") for n in range(len(answers))
    ]
    channels = (*force[: len(forces)], *acceleration)
    return Recording(np.concatenate([forces, answers]), RATE, channels, name=name, **more)


def run(records, kind="random", **more):
    return Run("test", Condition(Excitation(kind, **more)), tuple(records))


def random_records(rng, count=4, samples=2048):
    forces = [10 * rng.normal(size=samples) for _ in range(count)]
    return [record(force, responses(force, rng), f"take_{n}") for n, force in enumerate(forces)]


def sweeps(rng, count=3, band=(20.0, 150.0)):
    t = np.arange(int(12 * RATE)) / RATE
    phase = 2 * np.pi * (band[0] * t + (band[1] - band[0]) / 16 * t**2)
    force = np.where(t < 8, 5 * np.sin(phase), 0.0)
    return [record(force, responses(force, rng), f"take_{n}") for n in range(count)]


def worst(frfs, inputs=(0,), band=(30, 120)):
    """Largest error of the FRFs in a band, over the largest FRF of each output."""
    part = frfs.band(*band)
    wanted = accelerance(part.frequencies, inputs).transpose(2, 0, 1)
    return float(np.max(np.abs(part.values - wanted) / np.abs(wanted).max(axis=(0, 2), keepdims=True)))


def said(frfs, code):
    return [finding for finding in frfs.findings if finding.code == code]


ODD = ("records-disagree", "overload", "unsteady", "excited-band")


def test_clean_tests_are_called_clean():
    rng = np.random.default_rng(1)
    for frfs in (shaker(run(random_records(rng))), sweep(run(sweeps(rng), "sweep"))):
        assert not [finding.code for finding in frfs.findings if finding.code in ODD]
        assert worst(frfs) < 0.02


def test_sweeps_over_parts_of_the_band_do_not_disagree():
    rng = np.random.default_rng(2)
    frfs = sweep(run([*sweeps(rng, 2, (20.0, 80.0)), *sweeps(rng, 2, (75.0, 150.0))], "sweep"))
    assert not said(frfs, "records-disagree")


@pytest.mark.parametrize("records", [1, 5])
def test_bursts_of_random_force_with_silence_behind(records):
    """The second half of each record has no force at all: it had ended in a singular matrix."""
    rng = np.random.default_rng(3)
    takes = []
    for _ in range(records):
        force = np.append(10 * rng.normal(size=1024), np.zeros(1024))
        takes.append(record(force, responses(force, rng)))
    frfs = shaker(run(takes))
    assert worst(frfs) < 0.05
    assert np.all(np.isfinite(frfs.variance))
    assert frfs.averages[0, 0] == records  # whole records where there are several, the driven half of a single one


def test_two_shakers_one_after_the_other():
    rng = np.random.default_rng(4)
    forces = 10 * rng.normal(size=(2, 8192))
    forces[0, 4096:], forces[1, :4096] = 0, 0
    frfs = shaker(run([record(forces, responses(forces, rng, inputs=(0, 3)))]))
    assert worst(frfs, (0, 3)) < 0.05


def test_a_force_that_acts_in_no_block_is_refused():
    rng = np.random.default_rng(5)
    force = np.append(np.zeros(4096), 10 * rng.normal(size=1000))
    with pytest.raises(InputError, match="acts in no block"):
        shaker(run([record(force, responses(force, rng))]), block=2048)


def test_a_channel_of_noise_leaves_the_others_right():
    """A sensor that shows nothing weighs as little as it should, and is named."""
    rng = np.random.default_rng(6)
    force = 10 * rng.normal(size=8192)
    answers = responses(force, rng)
    alone = shaker(run([record(force, answers)])).band(30, 120)
    with_noise = np.vstack([answers, 0.01 * rng.normal(size=answers.shape[1])])
    both = shaker(run([record(force, with_noise)])).band(30, 120)
    wanted = accelerance(alone.frequencies).transpose(2, 0, 1)
    errors = [np.mean(np.abs(one.values[:, :5] - wanted) ** 2 / one.variance[:, :5]) for one in (alone, both)]
    assert errors[1] < 1.5 * errors[0]
    (finding,) = said(both, "records-disagree")
    assert finding.where.endswith("a6") and "shows noise" in finding.message


CHANGES = {"as large": 2.0, "opposite sign": -1.0}


@pytest.mark.parametrize("words", CHANGES)
@pytest.mark.parametrize("kind", ["random", "sweep"])
def test_a_channel_that_one_record_has_otherwise_is_named(kind, words):
    rng = np.random.default_rng(7)
    takes = sweeps(rng) if kind == "sweep" else random_records(rng)
    signals = takes[1].signals.copy()
    signals[2] *= CHANGES[words]
    takes[1] = replace(takes[1], signals=signals)
    (finding,) = said((sweep if kind == "sweep" else shaker)(run(takes, kind)), "records-disagree")
    assert finding.severity == "error"
    assert finding.where.endswith("channel a2") and "take_1" in finding.message and words in finding.message


def test_a_sensor_that_falls_off_between_records_is_named():
    rng = np.random.default_rng(9)
    takes = random_records(rng)
    signals = takes[3].signals.copy()
    signals[3] = 1e-3 * rng.normal(size=signals.shape[1])
    takes[3] = replace(takes[3], signals=signals)
    (finding,) = said(shaker(run(takes)), "records-disagree")
    assert (
        finding.where.endswith("channel a3") and "nothing in common" in finding.message and "take_3" in finding.message
    )


def test_a_structure_that_changes_is_not_called_a_fault_of_one_channel():
    rng = np.random.default_rng(10)
    takes = []
    for warmer in (1.0, 0.995, 0.99, 0.985):
        force = 10 * rng.normal(size=4096)
        takes.append(record(force, responses(force, rng, warmer=warmer)))
    assert not said(shaker(run(takes)), "records-disagree")


@pytest.mark.parametrize(("kind", "row"), [("random", 2), ("random", 0), ("sweep", 3)])
def test_a_clipped_channel_is_named(kind, row):
    """Of Gaussian noise the gain of a limiter is the share that it leaves alone (Bussgang 1952)."""
    rng = np.random.default_rng(11)
    takes = sweeps(rng) if kind == "sweep" else random_records(rng)
    signals = takes[0].signals.copy()
    limit = 1.5 * signals[row].std()
    share = np.mean(np.abs(signals[row]) >= limit)
    signals[row] = np.clip(signals[row], -limit, limit)
    takes[0] = replace(takes[0], signals=signals)
    (finding,) = said((sweep if kind == "sweep" else shaker)(run(takes, kind)), "overload")
    assert finding.value == pytest.approx(share, rel=1e-6)
    assert f"channel {takes[0].channels[row].name}" in finding.message and finding.severity == "error"


def test_overloads_by_range_and_by_the_front_end_are_named():
    rng = np.random.default_rng(12)
    (take,) = random_records(rng, 1)
    top = np.abs(take.signals[1]).max()
    ranged = [replace(channel, range=1.01 * top if channel.name == "a1" else None) for channel in take.channels]
    assert "cut off" in said(shaker(run([replace(take, channels=tuple(ranged))])), "overload")[0].message
    reported = replace(take, overloads=np.array([False, False, True, False, False, False]))
    (finding,) = said(shaker(run([reported])), "overload")
    assert "a2 was overloaded" in finding.message and finding.severity == "warning"


def test_coarse_converters_and_signals_that_repeat_are_no_overload():
    rng = np.random.default_rng(13)
    force = 10 * np.round(rng.normal(size=8192), 1)  # 80 steps
    assert not said(shaker(run([record(force, responses(force, rng))])), "overload")
    period = 5 * rng.normal(size=1024)
    force = np.tile(period, 6)
    frfs = sweep(run([record(force, responses(force, rng, noise=0))], "sweep", period=2.0))
    assert not said(frfs, "overload")
    t = np.arange(4096) / RATE
    force = np.round(5 * np.sin(2 * np.pi * 32 * t), 2)  # 16 samples in each period
    assert not said(stepped(run([record(force, responses(force, rng))], "stepped sine"), discard=4.0), "overload")


def test_a_period_that_the_force_does_not_have_is_refused():
    """Frequencies of modes had been many deviations off, without a word."""
    rng = np.random.default_rng(14)
    t = np.arange(int(4 * RATE)) / RATE
    force = np.tile(5 * np.sin(2 * np.pi * (20 * t + 16 * t**2)), 6)
    take = record(force, responses(force, rng))
    for period in (2.0, 3.0, 5.0):
        with pytest.raises(InputError, match="does not repeat with the period"):
            sweep(run([take], "sweep", period=period))
    assert worst(sweep(run([take], "sweep", period=4.0))) < 0.02


def steps(rng, lines, seconds, settle=0.0):
    takes = []
    for f in lines:
        t = np.arange(int((settle + seconds) * RATE)) / RATE
        force = 5 * np.sin(2 * np.pi * f * t)
        keep = int(settle * RATE)
        takes.append(record(force[keep:], responses(force, rng)[:, keep:], f"{f:.2f} Hz"))
    return takes


def test_a_stepped_sine_is_fitted_over_all_its_lines():
    """Twenty lines had been taken off as if they lay above 0 Hz, half of this test with its resonance."""
    frfs = stepped(run(steps(np.random.default_rng(15), np.linspace(36, 46, 41), 1.0, 6.0), "stepped sine"))
    assert default_band(frfs, None) == pytest.approx((36, 46), abs=1e-3)
    whole = shaker(run(random_records(np.random.default_rng(15))))
    assert default_band(whole, None)[0] == pytest.approx(21 * whole.frequency_step)


def test_the_free_vibration_of_steps_that_had_not_settled_is_taken_off():
    """Each record begins at rest and holds three decay times of the resonance."""
    lines = np.linspace(38, 44, 25)
    frfs = stepped(run(steps(np.random.default_rng(16), lines, 1.0), "stepped sine"))
    error = np.abs(frfs.values - accelerance(frfs.frequencies).transpose(2, 0, 1)) ** 2
    (finding,) = said(frfs, "unsteady")
    assert finding.severity == "info" and finding.value > 0.2
    assert np.median(error / frfs.variance) < 4
    assert np.sqrt(error.max()) < 0.03 * np.abs(frfs.values).max()


def test_steps_at_one_frequency_that_differ_are_named():
    rng = np.random.default_rng(17)
    takes = steps(rng, np.linspace(36, 46, 21), 1.0, 6.0)
    signals = takes[10].signals.copy()
    signals[2] *= 3
    frfs = stepped(run([*takes, replace(takes[10], signals=signals)], "stepped sine"))
    (finding,) = said(frfs, "records-disagree")
    assert "41 Hz" in finding.message
    row = int(np.abs(frfs.frequencies - 41).argmin())
    assert np.sqrt(frfs.variance[row, 1, 0]) > 0.3 * np.abs(frfs.values[row, 1, 0])


@pytest.mark.parametrize("kind", ["random", "sweep", "stepped sine"])
def test_records_at_two_levels_in_one_run_are_named(kind):
    """The mean of two levels had been the FRF of the run, and its label the level of the first record or between."""
    rng = np.random.default_rng(18)
    if kind == "random":
        takes, estimate = random_records(rng, 2, 4096), shaker
    elif kind == "sweep":
        takes, estimate = sweeps(rng, 2), sweep
    else:
        takes, estimate = steps(rng, [39.0, 41.0], 1.0, 6.0), stepped
    assert not said(estimate(run(takes, kind)), "levels-in-one-run")
    doubled = [replace(take, signals=2 * take.signals) for take in takes]
    (finding,) = said(estimate(run([*takes, *doubled], kind)), "levels-in-one-run")
    assert finding.value == pytest.approx(2, rel=0.05)


def test_the_level_of_a_sweep_is_not_read_where_it_rests():
    """The noise of a resting force has any frequency: the force beside the resonance had been that of the pause."""
    rng = np.random.default_rng(19)
    take = sweeps(rng)[0]
    signals = take.signals.copy()
    signals[0] += 1e-3 * rng.normal(size=signals.shape[1])
    level = force_at_resonance(replace(take, signals=signals), 97.0, 0.004)
    assert level.level == pytest.approx(5, rel=0.02)
    assert level.dropout == pytest.approx(1, rel=0.02)


def test_lines_that_the_force_does_not_excite_are_left_out():
    """FRFs beyond a band-limited force had hidden every mode within it: no mode was found."""
    rng = np.random.default_rng(20)
    shape = scipy.signal.butter(6, [30, 120], "band", fs=RATE, output="sos")
    takes = []
    for _ in range(3):
        force = scipy.signal.sosfiltfilt(shape, 10 * rng.normal(size=4096))
        takes.append(record(force + 1e-3 * rng.normal(size=4096), responses(force, rng)))
    estimates = {method: shaker(run(takes), method=method) for method in ("local", "welch")}
    for method, frfs in estimates.items():
        (finding,) = said(frfs, "excited-band")
        assert 20 < frfs.frequencies[0] < 30 and 120 < frfs.frequencies[-1] < 150
        assert finding.value == pytest.approx(
            len(frfs.frequencies) / 4096 * 2 * (1 if method == "local" else 8), rel=0.1
        )
    _, modes = fitted(estimates["local"], FitTable())
    assert modes.natural_frequencies == pytest.approx(FREQUENCIES, rel=1e-4)


def narrow_forces(rng, count, samples, period=None):
    """Forces of random noise from 30 to 60 of 256 Hz, or those of a period, again and again."""
    shape = scipy.signal.butter(8, [30, 60], "band", fs=RATE, output="sos")
    if period is None:
        return np.array([scipy.signal.sosfiltfilt(shape, 10 * rng.normal(size=samples)) for _ in range(count)])
    spectrum = np.fft.rfft(10 * rng.normal(size=(count, period)))
    frequencies = np.fft.rfftfreq(period, 1 / RATE)
    spectrum[:, (frequencies < 30) | (frequencies > 60)] = 0
    return np.tile(np.fft.irfft(spectrum, period), samples // period)


ALONG_LINES = ("frequencies", "values", "coherence", "variance", "effective_lines", "output_correlation")


@pytest.mark.parametrize(
    ("inputs", "takes", "options", "period"),
    [
        ((0,), 1, {}, None),
        ((0,), 4, {}, None),
        ((0, 3), 3, {}, None),
        ((0, 3), 1, {"block": 2048}, None),
        ((0,), 2, {"block": 4096}, 1024),
        ((0, 3), 4, {}, 2048),
        ((0,), 2, {"method": "welch"}, None),
        ((0, 3), 2, {"method": "welch"}, None),
        ((0,), 2, {"method": "welch"}, 1024),
    ],
)
def test_excited_lines_are_estimated_as_if_all_were(monkeypatch, inputs, takes, options, period):
    """Every digit is that of the estimate on all lines, and so is every finding but those of the band itself: where lines
    without a force count as excited the force is not flat.
    """
    rng = np.random.default_rng([23, len(inputs), takes, period or 0])
    # Lines are modelled 256 together: of 1023 lines of four records, some 240 are excited, in two such groups.
    samples = 2048 if takes == 4 and not period else 4096
    records = []
    for n in range(takes):
        forces = narrow_forces(rng, len(inputs), samples, period)
        noisy = forces + 1e-3 * rng.normal(size=forces.shape)
        records.append(record(noisy, responses(forces, rng, inputs=inputs), f"take_{n}"))
    frfs = shaker(run(records), **options)
    (band,) = said(frfs, "excited-band")
    assert 20 < frfs.frequencies[0] < frfs.frequencies[-1] < 80
    monkeypatch.setattr(random_excitation, "excited_band", lambda *_: (0.0, np.inf))
    everywhere = shaker(run(records), **options)
    assert everywhere.frequencies[-1] > 250
    of_all = everywhere.band(*frfs.frequencies[[0, -1]])
    for name in ALONG_LINES:
        np.testing.assert_array_equal(getattr(frfs, name), getattr(of_all, name), err_msg=name)
    if frfs.deviations is None:
        assert of_all.deviations is None
    else:
        np.testing.assert_array_equal(frfs.deviations.values, of_all.deviations.values)
        np.testing.assert_array_equal(frfs.deviations.blows, of_all.deviations.blows)
    np.testing.assert_array_equal(frfs.averages, of_all.averages)
    assert [one for one in frfs.findings if one != band] == [
        one for one in everywhere.findings if one.code != "force-not-flat"
    ]


def test_lines_that_are_left_out_are_not_modelled(monkeypatch):
    """Where a force ends at 60 of 512 Hz they had taken eight ninths of the time."""
    rng, solved, modelled = np.random.default_rng(24), local_model._solved, []

    def counted(parts, powers, *forces):
        modelled.append(len(powers))
        return solved(parts, powers, *forces)

    monkeypatch.setattr(local_model, "_solved", counted)
    forces = narrow_forces(rng, 1, 2**15)
    frfs = shaker(run([record(forces, responses(forces, rng))]))
    # Lines are modelled 256 together: those at the ends of the band have company.
    assert len(frfs.frequencies) <= sum(modelled) < len(frfs.frequencies) + 2 * 256
    assert len(frfs.frequencies) < 2**13 / 4


def test_a_channel_that_changed_is_named_by_the_excited_lines(monkeypatch):
    """What lies beyond them weighs so little that the change is the same to three digits."""
    rng, changes = np.random.default_rng(25), []
    records = []
    for n in range(4):
        forces = narrow_forces(rng, 1, 4096)
        answers = responses(forces, rng)
        answers[2] *= 1.6 if n == 3 else 1.0
        records.append(record(forces + 1e-3 * rng.normal(size=forces.shape), answers, f"take_{n}"))
    changes.extend(said(shaker(run(records)), "records-disagree"))
    monkeypatch.setattr(random_excitation, "excited_band", lambda *_: (0.0, np.inf))
    changes.extend(said(shaker(run(records)), "records-disagree"))
    here, everywhere = changes
    assert "take_3" in here.message and here.where == everywhere.where and "a3" in here.where
    assert here.value == pytest.approx(1.6, rel=0.01)
    assert here.value == pytest.approx(everywhere.value, rel=1e-3)


def test_drift_and_tones_of_a_force_are_no_band():
    rng = np.random.default_rng(21)
    t = np.arange(8192) / RATE
    force = 10 * rng.normal(size=8192)
    answers = responses(force, rng)
    measured = force + 300 * (t / 16) ** 1.5 + 60 * np.sin(2 * np.pi * 50 * t)
    assert not said(shaker(run([record(measured, answers)])), "excited-band")


@pytest.mark.parametrize("kind", ["random", "sweep"])
def test_set_ups_that_were_excited_over_slightly_different_bands_are_joined(kind):
    """They had been refused for their unequal frequency axes."""
    rng = np.random.default_rng(22)
    takes = []
    for setup, band in (("A", (30.0, 120.0)), ("B", (29.0, 124.0))):
        if kind == "random":
            shape = scipy.signal.butter(6, band, "band", fs=RATE, output="sos")
            force = scipy.signal.sosfiltfilt(shape, 10 * rng.normal(size=8192))
            take = record(force, responses(force, rng))
        else:
            take = sweeps(rng, 1, band)[0]
        moved = [replace(channel, dof=Dof(channel.dof.node + 10, "+Z")) for channel in take.channels[2:]]
        channels = take.channels if setup == "A" else (*take.channels[:2], *moved)
        takes.append(replace(take, setup=setup, channels=channels))
    joined, _ = frfs_of(run(takes, kind), EstimateTable())
    assert len(joined.outputs) == 9
    inside = joined.band(40, 110)
    wanted = accelerance(inside.frequencies).transpose(2, 0, 1)
    assert np.abs(inside.values[:, :5] - wanted).max() < 0.05 * np.abs(wanted).max()


def test_the_ends_of_a_sweep_are_no_force_beside_the_resonance():
    """Where a sweep does not reach that far, its fading ends had been taken for it, and a drop-out of 1.9 was stated."""
    t = np.arange(24 * 2048) / 2048
    force = np.where(t < 20, 10 * np.cos(2 * np.pi * (170 * t + 1.5 * t**2)), 0.0)  # 170 to 230 Hz
    take = replace(record(force, np.zeros((1, len(t)))), sampling_rate=2048.0)
    level = force_at_resonance(take, 200.602, 0.012185)
    assert level.level == pytest.approx(10, rel=0.02)
    assert np.isnan(level.dropout)
