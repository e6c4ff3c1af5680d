"""Noise of the force channel by a record at rest, and the interval from H1 to H2, against FRFs in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import open_campaign
from ema.errors import InputError
from ema.estimate import h1_h2_bounds, quality, shaker
from ema.estimate.force_noise import AtRest, predicted
from ema.store import save
from tests.bench import disturbances_shaker as bench
from tests.unit.test_estimate_generator import coverage

WELCH = {"method": "welch", "block": bench.BLOCK}


def run_at_rest(rng, test, noise, samples=bench.SAMPLES):
    """The run with a record of the noise of its channels alone."""
    run = bench.recorded(rng, test, noise)
    (record,) = run.recordings
    calm = np.zeros((len(record.channels), samples))
    calm[0] = noise * record.signals[0].std() / np.sqrt(1 + noise**2) * rng.standard_normal(samples)
    calm[1:] = 1e-3 * rng.standard_normal((len(calm) - 1, samples))
    return replace(run, at_rest=(replace(record, signals=calm, overloads=None, name="rest"),))


def codes(frfs):
    return {finding.code for finding in frfs.findings}


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.3])
@pytest.mark.parametrize("samples", [bench.SAMPLES, bench.SAMPLES // 4])
def test_the_variance_without_the_noise_at_rest_covers(noise, samples):
    """20 dB of drop-out; a record at rest as long as the test, and a quarter of it."""
    at_rest, without = [], []
    for seed in range(4):
        rng = np.random.default_rng([5100, seed, round(100 * noise), samples])
        test = bench.shaken(rng, shaker=10.0)
        run = run_at_rest(rng, test, noise, samples)
        frfs = shaker(run, **WELCH)
        at_rest.append(coverage(frfs, test.case))
        without.append(coverage(shaker(replace(run, at_rest=()), **WELCH), test.case))
        assert noise < 0.05 or "force-noise" in codes(frfs)
    at_peaks, beside = np.mean(at_rest, axis=0)
    assert at_peaks > 0.90 and beside > 0.92
    assert noise < 0.05 or np.mean(without, axis=0)[0] < 0.90


def test_the_local_model_without_the_noise_at_rest():
    """20 dB of drop-out: a fifth of noise puts the peaks of the local model far too low."""
    rng = np.random.default_rng(5150)
    test = bench.shaken(rng, shaker=10.0)
    run = run_at_rest(rng, test, 0.2, 2**15)
    (record,) = run.recordings
    short = replace(run, recordings=(replace(record, signals=record.signals[:, : 2**14]),))
    less, plain = (shaker(one, block=2**12) for one in (short, replace(short, at_rest=())))
    assert less.estimator == "H1 less force noise (local model)" and "force-noise" in codes(less)
    (at_peaks, beside), (biased, _) = coverage(less, test.case), coverage(plain, test.case)
    assert at_peaks > 0.75 and beside > 0.9 and biased < 0.5
    taken, left = (
        np.mean((np.abs(frfs.values) / wanted)[near]) - 1
        for frfs, wanted, near in (peaks_and_band(one, test.case) for one in (less, plain))
    )
    assert left < -0.2 and abs(taken) < 0.4 * abs(left)


def test_the_prediction_has_the_power_of_the_acting_force():
    """Forces with a notch, in blocks of two levels; its power in closed form, the scatter of the ratio over the lines."""
    rng = np.random.default_rng(5160)
    lines = np.arange(1, 4000)
    power = 1 - 0.99 / (1 + ((lines - 2000) / 60) ** 2)

    def normal(size):
        return np.sqrt(size / 2) * (rng.standard_normal((2, len(lines))).T @ np.array([1, 1j]))

    levels = [1.0, 1.0, 4.0, 4.0]
    forces = [normal(level * power) for level in levels]
    measured = [force + normal(0.05) for force in forces]
    found = predicted([one[:, None] for one in measured], AtRest(np.full(len(lines), 0.05), 1e4))
    for level, x, u in zip(levels, measured, found.forces, strict=True):
        wanted = level * power / (level * power + 0.05)
        error = np.abs(u[:, 0] / x - wanted) / wanted
        stated = np.sqrt(found.uncertain)
        assert np.mean(error[20:-20] < 3 * stated[20:-20] + 0.02) > 0.97


def test_clean_force_channels_are_not_named():
    for seed in range(20):
        rng = np.random.default_rng([5200, seed])
        test = bench.shaken(rng)
        run = run_at_rest(rng, test, 1e-4 * (seed % 2), 2**15)
        plain = shaker(replace(run, at_rest=()), method="welch", block=4096)
        frfs = shaker(run, method="welch", block=4096)
        assert not codes(frfs) & {"force-noise", "force-below-noise"}
        near = np.abs(frfs.values - plain.values) < 0.01 * np.abs(plain.values)
        assert near.all()


def test_lines_without_force_are_not_determined_and_have_a_large_variance():
    """From 200 to 300 Hz the shaker does not drive: all that the channel shows there is its noise."""
    rng = np.random.default_rng(5300)
    test = bench.shaken(rng)
    frequencies = np.fft.rfftfreq(bench.PERIOD, 1 / bench.RATE)
    drives = ((frequencies < 200) | (frequencies > 300)).astype(float)
    test = replace(test, force=test.force * drives, responses=test.responses * drives[:, None])
    frfs = shaker(run_at_rest(rng, test, 0.2), method="welch", block=4096)
    (finding,) = [one for one in frfs.findings if one.code == "force-below-noise"]
    assert "20" in finding.message
    inside = frfs.band(205, 295)
    wanted = bench._responses(test.case, inside.frequencies, [test.case.truth.dofs.index(test.case.truth.inputs[0])])
    assert np.mean(np.abs(inside.values - wanted) ** 2 < 3 * inside.variance) > 0.9
    assert np.median(np.sqrt(inside.variance) / np.abs(inside.values)) > 1.0


def test_a_record_that_is_not_at_rest_is_refused():
    rng = np.random.default_rng(5400)
    run = bench.recorded(rng, bench.shaken(rng))
    with pytest.raises(InputError, match="as large as in the test"):
        shaker(replace(run, at_rest=run.recordings), method="welch", block=2048)
    with pytest.raises(InputError, match="differ in sampling rate"):
        shaker(replace(run, at_rest=(replace(run.recordings[0], sampling_rate=100.0),)), method="welch", block=2048)


def test_a_campaign_names_its_record_at_rest(tmp_path):
    rng = np.random.default_rng(5500)
    run = run_at_rest(rng, bench.shaken(rng, shaker=10.0), 0.3, 2**14)
    for name, (record,) in (("shaker.h5", run.recordings), ("rest.h5", run.at_rest)):
        save(tmp_path / name, replace(record, channels=record.channels[:-1], signals=record.signals[:-1]))
    text = (
        '[campaign]\nname = "Shaker"\n\n[[runs]]\nid = "bare"\nkind = "random"\nfiles = "shaker.h5"\n'
        'at_rest = "rest.h5"\n'
    )
    (tmp_path / "campaign.toml").write_text(text)
    (opened,) = open_campaign(tmp_path).runs
    frfs = shaker(opened, method="welch", block=4096)
    assert frfs.estimator == "H1 less force noise" and "force-noise" in codes(frfs)
    (tmp_path / "campaign.toml").write_text(text.replace("random", "hammer"))
    with pytest.raises(InputError, match="record at rest"):
        open_campaign(tmp_path)


def peaks_and_band(frfs, case):
    """FRFs of the band, their true values, and which lines lie within the half-power width of a mode."""
    frfs = frfs.band(bench.LOW, bench.HIGH)
    wanted = bench._responses(case, frfs.frequencies, [case.truth.dofs.index(case.truth.inputs[0])])
    modes, width = case.truth.natural_frequencies, case.truth.natural_frequencies * case.truth.damping_ratios
    return frfs, np.abs(wanted), np.any(np.abs(frfs.frequencies[:, None] - modes) < width, axis=1)


@pytest.mark.parametrize("noisy", ["force", "response"])
def test_the_interval_from_h1_to_h2_holds_whichever_channel_is_noisy(noisy, monkeypatch):
    """A third of the power at the peaks is noise: one end is far off, the interval holds the truth."""
    inside, ends, named = [], [], 0
    for seed in range(4):
        rng = np.random.default_rng([5600, seed, noisy == "force"])
        test = bench.shaken(rng, shaker=10.0)
        if noisy == "response":
            monkeypatch.setattr(bench, "RESPONSE_NOISE", 1.4)
        frfs, wanted, near = peaks_and_band(
            shaker(bench.recorded(rng, test, 0.2 if noisy == "force" else 0.0), **WELCH), test.case
        )
        low, high = h1_h2_bounds(frfs)
        inside.append(((low <= wanted) & (wanted <= high))[near].mean())
        h1, h2 = np.abs(frfs.values), np.abs(frfs.values) / frfs.coherence
        ends.append([np.median((h1 / wanted)[near]), np.median((h2 / wanted)[near])])
        named += "force-or-response-noise" in {one.code for one in quality(frfs)}
    h1, h2 = np.mean(ends, axis=0)
    assert np.mean(inside) > 0.93
    assert h1 < 0.8 if noisy == "force" else h2 > 1.2
    assert named >= 3 or noisy == "response"


def test_clean_tests_and_those_whose_noise_is_known_have_no_interval():
    for seed in range(20):
        rng = np.random.default_rng([5700, seed])
        test = bench.shaken(rng, shaker=10.0 * (seed % 2))
        frfs = shaker(bench.recorded(rng, test, samples=2**15), method="welch", block=2**12)
        assert "force-or-response-noise" not in {one.code for one in quality(frfs.band(bench.LOW, bench.HIGH))}
    rng = np.random.default_rng(5800)
    run = run_at_rest(rng, bench.shaken(rng, shaker=10.0), 0.3)
    frfs = shaker(run, **WELCH)
    assert "force-or-response-noise" not in {one.code for one in quality(frfs.band(bench.LOW, bench.HIGH))}
    with pytest.raises(InputError, match="not bounded by their coherence"):
        h1_h2_bounds(frfs)
    with pytest.raises(InputError, match="no coherence"):
        h1_h2_bounds(replace(frfs, coherence=None))
