"""The generator as reference, against FRFs in closed form of structures on a shaker that they pull down.

Records are those of `tests.bench.disturbances_shaker`, exact at all samples. A value is covered where its squared error
is below 3.0 of its stated variance: 95 % of the complex normal distribution.
"""

from dataclasses import replace

import numpy as np
import pytest

from acquisition import open_campaign
from ema.data import Channel
from ema.errors import InputError
from ema.estimate import shaker
from ema.store import save
from tests.bench import disturbances_shaker as bench

COVERED = 3.0


def with_generator(run, row=-1):
    """The run with the generator's channel in its role."""
    (record,) = run.recordings
    channels = list(record.channels)
    channels[row] = Channel("generator", quantity="voltage", role="generator", unit="V")
    return replace(run, recordings=(replace(record, channels=tuple(channels)),))


def coverage(frfs, case):
    """Share of covered values at the peaks and beside them."""
    frfs = frfs.band(bench.LOW, bench.HIGH)
    wanted = bench._responses(case, frfs.frequencies, [case.truth.dofs.index(case.truth.inputs[0])])
    covered = np.abs(frfs.values - wanted) ** 2 < COVERED * frfs.variance
    modes, width = case.truth.natural_frequencies, case.truth.natural_frequencies * case.truth.damping_ratios
    near = np.any(np.abs(frfs.frequencies[:, None] - modes) < width, axis=1)
    return float(covered[near].mean()), float(covered[~near].mean())


@pytest.mark.parametrize(
    ("disturbance", "force_noise", "bias"),
    [(0.0, 0.0, False), (0.0, 0.03, None), (0.0, 0.1, True), (0.0, 0.3, True), (0.1, 0.0, True), (0.1, 0.1, True)],
)
def test_the_stated_variance_covers_and_that_of_h1_does_not(disturbance, force_noise, bias):
    """20 dB of drop-out at the resonances; noise of the force channel, an unmeasured force, 0.2 % response noise.

    With 3 % noise of the force the bias of H1 is about as large as its standard deviation: coverage shows it or not.
    With 30 % the force is lost at the resonances of some draws, which is named there.
    """
    by_generator, by_force = [], []
    for seed in range(4):
        rng = np.random.default_rng([4100, seed, round(100 * force_noise)])
        test = bench.shaken(rng, shaker=10.0, disturbance=disturbance)
        run = bench.recorded(rng, test, force_noise)
        options = {"method": "welch", "block": bench.BLOCK}
        frfs = shaker(with_generator(run), **options)
        named = "generator-coherence" in {finding.code for finding in frfs.findings}
        assert not named or force_noise > 0.2
        assert frfs.estimator == "Hc"
        by_generator.append(coverage(frfs, test.case))
        by_force.append(coverage(shaker(run, **options), test.case))
    at_peaks, beside = np.mean(by_generator, axis=0)
    assert at_peaks > 0.90 and beside > 0.93
    if bias is not None:
        assert (np.mean(by_force, axis=0)[0] < 0.90) == bias


def test_the_local_model_with_a_generator_covers():
    rng = np.random.default_rng(4201)
    test = bench.shaken(rng, shaker=10.0, disturbance=0.05)
    run = bench.recorded(rng, test, 0.1, samples=2**14)
    frfs = shaker(with_generator(run), block=2**12)
    at_peaks, beside = coverage(frfs, test.case)
    assert frfs.estimator == "Hc (local model)"
    assert at_peaks > 0.85 and beside > 0.92
    assert coverage(shaker(run, block=2**12), test.case)[0] < 0.75


def test_two_generators_of_two_shakers():
    """Forces x = B r with interaction between the shakers and noise, responses y = H x; no leakage: periodic blocks."""
    rng = np.random.default_rng(4300)
    length, count = 1024, 60
    r = rng.normal(size=(2, count, length // 2 + 1)) + 1j * rng.normal(size=(2, count, length // 2 + 1))
    mixing, wanted = np.array([[1.0, 0.3j], [0.2, 0.7]]), np.array([[1.0, -2.0j], [0.5, 1.5]])
    x = np.einsum("ij,jbf->ibf", mixing, r)
    signals = np.concatenate([x, np.einsum("ij,jbf->ibf", wanted, x), r])
    signals = np.repeat(np.fft.irfft(signals, length)[:, :, None], 2, axis=2).reshape(6, -1)
    signals[:2] += 0.5 * signals[:2].std() * rng.normal(size=signals[:2].shape)
    template = bench.recorded(rng, bench.shaken(rng)).recordings[0]
    forces = [Channel(f"F{n}", None, quantity="force", role="reference", unit="N") for n in range(2)]
    answers = [Channel(f"a{n}", None, quantity="acceleration", unit="m/s^2") for n in range(2)]
    drives = [Channel(f"u{n}", quantity="voltage", role="generator", unit="V") for n in range(2)]
    record = replace(template, signals=signals, channels=(*forces, *answers, *drives), overloads=None)
    run = replace(bench.recorded(rng, bench.shaken(rng)), recordings=(record,))
    frfs = shaker(run, method="welch", block=length, overlap=0.5)
    inner = slice(20, -20)
    errors = np.abs(frfs.values - wanted)[inner] ** 2
    assert np.abs(frfs.values[inner].mean(axis=0) - wanted).max() < 0.05
    assert np.mean(errors < COVERED * frfs.variance[inner]) > 0.93
    part = replace(run, recordings=(replace(record, signals=signals[[0, 1, 2, 3, 5, 4], : 8 * length]),))
    frfs = shaker(part, block=length)
    assert frfs.estimator == "Hc (local model)" and "generator-coherence" not in {one.code for one in frfs.findings}
    assert np.abs(frfs.values[inner].mean(axis=0) - wanted).max() < 0.05
    assert np.mean(np.abs(frfs.values - wanted)[inner] ** 2 < COVERED * frfs.variance[inner]) > 0.90
    one = replace(record, signals=signals[:5], channels=record.channels[:5])
    with pytest.raises(InputError, match="not one generator for each force"):
        shaker(replace(run, recordings=(one,)))


def test_a_generator_that_does_not_drive_the_shaker_is_refused():
    rng = np.random.default_rng(4400)
    run = with_generator(bench.recorded(rng, bench.shaken(rng)))
    signals = run.recordings[0].signals.copy()
    signals[-1] = rng.normal(size=signals.shape[1])
    with pytest.raises(InputError, match="does not follow the signal of the generator"):
        shaker(replace(run, recordings=(replace(run.recordings[0], signals=signals),)), method="welch", block=1024)


def test_bands_that_the_generator_does_not_drive_are_named_with_a_large_variance():
    """From 200 to 300 Hz the force is what another source gives, and half of its power is noise of the channel."""
    rng = np.random.default_rng(4500)
    test = bench.shaken(rng)
    run = with_generator(bench.recorded(rng, test, 1.0))
    signals = run.recordings[0].signals.copy()
    lines = np.fft.rfft(signals[-1])
    frequencies = np.fft.rfftfreq(signals.shape[1], 1 / bench.RATE)
    silent = (frequencies > 200) & (frequencies < 300)
    lines[silent] = np.sqrt(np.mean(np.abs(lines) ** 2) / 2) * (rng.normal(size=(2, silent.sum())).T @ [1, 1j])
    signals[-1] = np.fft.irfft(lines, signals.shape[1])
    frfs = shaker(replace(run, recordings=(replace(run.recordings[0], signals=signals),)), method="welch", block=4096)
    (finding,) = [one for one in frfs.findings if one.code == "generator-coherence"]
    assert finding.value == pytest.approx(100 / (frfs.frequencies[-1] - frfs.frequencies[0]), rel=0.25)
    inside = frfs.band(205, 295)
    wanted = bench._responses(test.case, inside.frequencies, [test.case.truth.dofs.index(test.case.truth.inputs[0])])
    assert np.mean(np.abs(inside.values - wanted) ** 2 < COVERED * inside.variance) > 0.95
    assert np.median(np.sqrt(inside.variance) / np.abs(inside.values)) > 1.0


def test_a_campaign_names_the_generator(tmp_path):
    rng = np.random.default_rng(4600)
    run = bench.recorded(rng, bench.shaken(rng), samples=2**13)
    save(tmp_path / "shaker.h5", run.recordings[0])
    dofs = "".join(
        f'[[channels]]\nname = "{one.name}"\nunit = "{one.unit}"\nrole = "{one.role}"\ndof = "{one.dof}"\n\n'
        for one in run.recordings[0].channels[:2]
    )
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\nname = "Shaker with its generator"\n\n' + dofs + '[[channels]]\nname = "generator"\n'
        'role = "generator"\nunit = "V"\n\n[[runs]]\nid = "bare"\nkind = "random"\nfiles = "shaker.h5"\n'
    )
    (opened,) = open_campaign(tmp_path).runs
    assert opened.recordings[0].with_role("generator") == (2,)
    assert shaker(opened, method="welch", block=1024).estimator == "Hc"
