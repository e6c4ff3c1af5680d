"""Stepped sines, periodic sweeps and their rates on signals made from a known oscillator."""

from dataclasses import replace

import numpy as np
import pytest

from ema import estimate
from ema.data import Channel, Condition, Excitation, Recording, Run
from ema.dof import Dof
from ema.errors import InputError

RATE, NATURAL, ZETA = 4096.0, 500.0, 0.0064
LINES = np.arange(480.0, 520.0, 2.0)
FORCE = Channel("force", Dof(1, "+Z"), "force", "reference", "N")
ACC = Channel("acc", Dof(1, "+Z"), "acceleration", unit="m/s^2")


def accelerance(frequencies):
    w, r = 2 * np.pi * np.asarray(frequencies), 2 * np.pi * NATURAL
    return -(w**2) / (r**2 - w**2 + 2j * ZETA * r * w)


def stay(frequency, level=5.0, samples=400, third=0.0, noise=0.0, seed=0):
    t = np.arange(samples) / RATE
    angle = 2 * np.pi * frequency * t + 0.3
    response = level * accelerance(frequency)
    rng = np.random.default_rng(seed)
    signals = np.array([level * np.cos(angle), np.real(response * np.exp(1j * angle))])
    signals[1] += third * abs(response) * np.cos(3 * angle)
    return Recording(signals + noise * rng.normal(size=signals.shape), RATE, (FORCE, ACC), name=f"{frequency:g} Hz")


def run_of(*records, **excitation):
    return Run("steps", Condition(Excitation("stepped sine", **excitation)), records)


def test_every_record_is_a_line_with_its_force_and_harmonics():
    frfs, steps = estimate.stepped_test(run_of(*(stay(f, level=4 + 0.01 * f, third=0.02) for f in LINES[::-1])))
    assert frfs.frequencies == pytest.approx(LINES, abs=1e-6)
    assert frfs.values[:, 0, 0] == pytest.approx(accelerance(LINES), rel=1e-6)
    assert frfs.quantity == "accelerance" and frfs.estimator == "sine fit"
    assert steps.force == pytest.approx(4 + 0.01 * LINES, rel=1e-6)
    assert steps.force_at(491.0) == pytest.approx(8.91, rel=1e-6)
    assert steps.distortion[:, 0] == pytest.approx(0.02, rel=1e-3)
    assert not frfs.findings


def test_one_record_with_all_frequencies_where_the_campaign_states_the_stay():
    signals = np.hstack([stay(f).signals for f in LINES])
    whole = Recording(signals, RATE, (FORCE, ACC))
    frfs = estimate.stepped(run_of(whole, period=400 / RATE))
    assert frfs.frequencies == pytest.approx(LINES, abs=1e-6)
    assert frfs.values[:, 0, 0] == pytest.approx(accelerance(LINES), rel=1e-6)


def test_the_variance_is_that_of_the_noise():
    errors, told = [], []
    for seed in range(120):
        frfs = estimate.stepped(run_of(stay(496.0, noise=0.5, seed=seed)))
        errors.append(abs(frfs.values[0, 0, 0] - accelerance(496.0)) ** 2)
        told.append(frfs.variance[0, 0, 0])
    assert np.mean(told) == pytest.approx(np.mean(errors), rel=0.3)


def test_a_response_that_has_not_settled_is_a_finding_and_can_be_discarded():
    growing = stay(500.0, samples=1200)
    t = np.arange(1200) / RATE
    signals = np.array(growing.signals)
    signals[1] *= 1 - 0.5 * np.exp(-t / 0.02)
    unsettled = replace(growing, signals=signals)
    assert [f.code for f in estimate.stepped(run_of(unsettled)).findings] == ["unsteady"]
    settled = estimate.stepped(run_of(unsettled), discard=0.2)
    assert not settled.findings
    assert abs(settled.values[0, 0, 0]) == pytest.approx(abs(accelerance(500.0)), rel=1e-3)


def test_bad_records_are_told_in_a_sentence():
    with pytest.raises(InputError, match="zero or constant"):
        estimate.stepped(run_of(replace(stay(500.0), signals=np.zeros((2, 400)))))
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="no sine"):
        estimate.stepped(run_of(replace(stay(500.0), signals=rng.normal(size=(2, 400)))))
    with pytest.raises(InputError, match="nothing is left"):
        estimate.stepped(run_of(stay(500.0)), discard=0.2)
    with pytest.raises(InputError, match="differ in their channels"):
        estimate.stepped(run_of(stay(500.0), replace(stay(501.0), channels=(FORCE, replace(ACC, dof=Dof(2, "+Z"))))))
    with pytest.raises(InputError, match="shorter than the stay"):
        estimate.stepped(run_of(stay(500.0), period=1.0))


def chirp(period, count, rate=RATE):
    """A periodic sweep from 400 to 600 Hz and the response of the oscillator, from rest."""
    t = np.arange(round(period * count * rate)) / rate
    inside = np.mod(t, period)
    force = np.sin(2 * np.pi * (400 * inside + 100 / period * inside**2))
    size = 2 * len(t)
    lines = np.fft.rfftfreq(size, 1 / rate)
    answer = np.fft.irfft(np.fft.rfft(force, size) * accelerance(lines), size)[: len(t)]
    return Recording(np.array([force, answer]), rate, (FORCE, ACC))


def test_of_a_periodic_sweep_the_first_period_is_dropped():
    run = Run("chirp", Condition(Excitation("sweep", period=1.0)), (chirp(1.0, 3),))
    frfs = estimate.sweep(run, band=(470, 530))
    # a linear structure has no bias by the rate: the transient of the first period alone would spoil it
    assert frfs.values[:, 0, 0] == pytest.approx(accelerance(frfs.frequencies), rel=5e-3)
    assert frfs.averages[0, 0] == 2
    with pytest.raises(InputError, match="two periods"):
        estimate.sweep(replace(run, recordings=(chirp(1.0, 1),)))
    odd = Run("chirp", Condition(Excitation("sweep", period=1.0001)), (chirp(1.0, 3),))
    with pytest.raises(InputError, match="not a period"):
        estimate.sweep(odd)


@pytest.mark.parametrize(("period", "fast"), [(1.0, True), (8.0, False)])
def test_the_rate_of_a_sweep_is_held_against_its_limit(period, fast):
    record = chirp(period, 2)
    rate, limit, findings = estimate.sweep_rate(record, NATURAL, ZETA, friction=True, periodic=True)
    assert rate == pytest.approx(200 / period, rel=0.05)
    assert limit == pytest.approx(216 * (NATURAL * ZETA) ** 2 / 60)
    assert bool(findings) == fast
    if fast:
        assert findings[0].severity == "warning" and "sign of the error" in findings[0].message
        (linear,) = estimate.sweep_rate(record, NATURAL, ZETA, friction=False, periodic=True)[2]
        assert linear.severity == "info" and "no error" in linear.message


def test_phase_resonance_lies_at_the_natural_frequency():
    lines = np.arange(490.0, 510.5, 0.7)
    found = estimate.phase_resonance(lines, accelerance(lines), np.full(len(lines), 3.0))
    assert found.frequency == pytest.approx(NATURAL, abs=0.02)
    assert found.ratio == pytest.approx(1 / (2 * ZETA), rel=0.01)
    assert found.force == pytest.approx(3.0) and not found.findings
    with pytest.raises(InputError, match="no phase resonance"):
        estimate.phase_resonance(lines[:5], accelerance(lines[:5]))
