"""Swept sine, integration, known-mass calibration and the quality of FRFs."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Channel, FrfSet, HitGallery
from ema.dof import Dof
from ema.errors import InputError
from ema.estimate import integrated, known_mass, quality, sweep, to_quantity
from tests.unit.estimate_rig import DOFS, error, recording, run_of, structure, sweep_rig, truth


def codes(findings):
    return {finding.code for finding in findings}


def test_sweep_gives_the_true_frfs():
    frfs = sweep(run_of(sweep_rig(noise=0.01).takes()))
    assert frfs.frequencies[0] < 25
    assert 470 < frfs.frequencies[-1] < 500
    band = frfs.band(30, 470)
    assert error(band.values, truth(structure(), band.frequencies, [0, 1], [0])) < 1e-2
    assert np.median(band.coherence) > 0.999
    assert frfs.averages[0, 0] == 3
    squares = np.abs(band.values - truth(structure(), band.frequencies, [0, 1], [0])) ** 2
    assert np.mean(squares / band.variance) == pytest.approx(1.0, abs=0.35)


def test_sweep_refuses_what_it_cannot_use():
    take = sweep_rig().take(0)
    dead = take.signals.copy()
    dead[0] = 1.0
    with pytest.raises(InputError, match="zero or constant"):
        sweep(run_of([replace(take, signals=dead)]))
    with pytest.raises(InputError, match="no frequency line"):
        sweep(run_of([take]), band=(5000.0, 6000.0))
    with pytest.raises(InputError, match="shorter than a block"):
        sweep(run_of([take]), block=10**6)


def test_cut_sweep_is_reported_as_leakage():
    take = sweep_rig().take(0)
    cut = replace(take, signals=take.signals[:, : int(2.0 * take.sampling_rate)])
    assert "leakage" in codes(sweep(run_of([cut]), band=(30.0, 200.0)).findings)


@pytest.mark.parametrize("times", [1, 2])
def test_integration_of_a_decaying_sine(times):
    rate, f, sigma = 2000.0, 60.0, 5.0
    t = np.arange(int(4 * rate)) / rate
    late = np.maximum(t - 0.5, 0)
    displacement = np.where(t > 0.5, np.exp(-sigma * late) * late**3, 0) * np.sin(2 * np.pi * f * late)
    derivative = displacement
    spectrum = np.fft.rfft(derivative) * (2j * np.pi * np.fft.rfftfreq(len(t), 1 / rate)) ** times
    signal = np.fft.irfft(spectrum, len(t)) + 0.7
    found = integrated(signal, rate, times, high_pass=2.0, rest=900)
    assert error(found, displacement) < 2e-3


def test_integrating_a_record_changes_its_channels():
    acceleration = recording(np.random.default_rng(0).normal(size=(2, 2048)))
    velocity = to_quantity(acceleration, "velocity")
    assert [c.quantity for c in velocity.channels] == ["force", "velocity"]
    assert velocity.channels[1].unit == "m/s"
    np.testing.assert_array_equal(velocity.signals[0], acceleration.signals[0])
    with pytest.raises(InputError, match="differentiated"):
        to_quantity(velocity, "acceleration")
    with pytest.raises(InputError, match="not a motion"):
        to_quantity(velocity, "force")
    with pytest.raises(InputError, match="must be positive"):
        integrated(acceleration.signals, 100.0, high_pass=0.0)


def accelerance(values, frequencies=None, outputs=DOFS[:1], inputs=DOFS[:1], **more):
    f = np.linspace(10, 200, len(values)) if frequencies is None else frequencies
    return FrfSet(f, np.asarray(values, complex), outputs, inputs, "accelerance", "(m/s^2)/N", name="x", **more)


def test_known_mass():
    rng = np.random.default_rng(0)
    values = (1.05 / 8.0) * (1 + 0.01 * rng.standard_normal((400, 1, 1)))
    found = known_mass(accelerance(values), 8.0, (20.0, 180.0))
    assert found.factor == pytest.approx(1 / 1.05, rel=2e-3)
    assert found.std == pytest.approx(0.01, rel=0.3)
    assert not found.findings
    assert codes(known_mass(accelerance(-values), 8.0, (20.0, 180.0)).findings) == {"reversed-sensor"}
    with pytest.raises(InputError, match="needs accelerance"):
        known_mass(replace(accelerance(values), quantity="mobility"), 8.0, (20.0, 180.0))


F = np.linspace(20, 600, 1161)


def true_frfs(**more):
    return accelerance(truth(structure(), F, [0, 1], [0, 1, 2, 3]), F, DOFS[:2], DOFS, **more)


def test_good_frfs_have_no_findings():
    shape = (len(F), 2, 4)
    good = true_frfs(coherence=np.full(shape, 0.99), averages=np.full((2, 4), 5.0), variance=np.full(shape, 1e-9))
    assert quality(good) == ()


def test_reversed_sensor_shows_at_its_drive_point_and_in_reciprocity():
    values = truth(structure(), F, [0, 1], [0, 1, 2, 3])
    values[:, 1] *= -1
    findings = quality(accelerance(values, F, DOFS[:2], DOFS))
    assert codes(findings) == {"drive-point-sign", "reciprocity"}
    assert [f.where for f in findings if f.code == "drive-point-sign"] == ["run x, 2:+Z/2:+Z"]
    turned = (DOFS[0], Dof(2, "-Z"))
    assert quality(accelerance(values, F, turned, DOFS)) == ()


@pytest.mark.parametrize("averages", [2, 10])
def test_noise_is_no_lack_of_reciprocity(averages):
    """Noise of 30 % of an FRF, its variance from the averages; one of the two that is 1.6 times too large is found."""
    exact, gauss = truth(structure(), F, [0, 1], [0, 1, 2, 3]), np.random.default_rng(61)
    size = 0.3 * np.sqrt(np.mean(np.abs(exact) ** 2, axis=0) / 2)
    noise = gauss.standard_normal((averages, *exact.shape)) + 1j * gauss.standard_normal((averages, *exact.shape))
    each = exact + np.sqrt(averages) * size * noise
    known = {"variance": np.var(each, axis=0, ddof=1) / averages, "averages": np.full((2, 4), float(averages))}
    values = each.mean(axis=0)
    assert "reciprocity" not in codes(quality(accelerance(values, F, DOFS[:2], DOFS, **known)))
    assert "reciprocity" in codes(quality(accelerance(values, F, DOFS[:2], DOFS)))
    values[:, 1, 0] *= 1.6
    assert "reciprocity" in codes(quality(accelerance(values, F, DOFS[:2], DOFS, **known)))


def test_low_coherence_is_named_where_it_is():
    shape = (len(F), 2, 4)
    coherence = np.full(shape, 0.99)
    coherence[np.abs(F - 160) < 3] = 0.4
    findings = quality(true_frfs(coherence=coherence, averages=np.full((2, 4), 5.0)))
    assert codes(findings) == {"low-coherence"}
    assert all("160" in f.where for f in findings)
    poor = quality(true_frfs(coherence=np.full(shape, 0.4), averages=np.full((2, 4), 5.0)))
    assert any(f.value == pytest.approx(0.4) and "median" in f.message for f in poor)


def test_noise_single_averages_dead_and_broken_channels():
    shape = (len(F), 2, 4)
    values = truth(structure(), F, [0, 1], [0, 1, 2, 3])
    noisy = quality(true_frfs(variance=np.abs(values) ** 2 * 0.09))
    assert codes(noisy) == {"noisy-frfs"}
    single = quality(true_frfs(coherence=np.ones(shape), averages=np.ones((2, 4))))
    assert codes(single) == {"one-average"}
    values[:, 1] = 0
    dead = quality(accelerance(values, F, DOFS[:2], DOFS))
    assert codes(dead) == {"dead-channel"}
    values[:, 1] = np.nan
    assert codes(quality(accelerance(values, F, DOFS[:2], DOFS))) == {"not-a-number"}


def test_resonances_beyond_the_force():
    """They are named once; that their coherence is low as well is no news."""
    gallery = HitGallery((), F, np.ones(len(F)), (200.0, 300.0))
    coherence = np.full((len(F), 2, 4), 0.99)
    coherence[np.abs(F - 431) < 5] = 0.3
    noisy = true_frfs(coherence=coherence, averages=np.full((2, 4), 5.0))
    assert "low-coherence" in codes(quality(noisy))
    findings = quality(noisy, hits=gallery)
    assert codes(findings) == {"usable-band"}
    assert findings[0].value == pytest.approx(431, abs=3)


def test_channels_of_another_kind_as_reference_are_refused():
    reference = Channel("hammer", DOFS[0], quantity="acceleration", role="reference", unit="m/s^2")
    take = recording(np.random.default_rng(0).normal(size=(2, 4000)))
    with pytest.raises(InputError, match="is no force"):
        sweep(run_of([replace(take, channels=(reference, take.channels[1]))]))
