"""Random excitation by two shakers, with known FRFs."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import poles_from
from ema.errors import InputError
from ema.estimate import quality, shaker
from tests.unit.estimate_rig import error, run_of, shaker_rig, structure, truth

LIGHT = {"frequencies": (62.5, 154.5, 156.5, 400.0), "damping": (0.001, 0.001, 0.0012, 0.0008)}


@pytest.fixture(scope="module")
def light():
    return run_of(shaker_rig(structure(**LIGHT), noise=0.05).takes())


def test_local_model_does_not_smear_light_modes(light):
    frfs = shaker(light).band(15, 480)
    wanted = truth(structure(**LIGHT), frfs.frequencies, [0, 1, 2, 3], [0, 1])
    assert error(frfs.values, wanted) < 0.01
    classical = shaker(light, method="welch").band(15, 480)
    smeared = truth(structure(**LIGHT), classical.frequencies, [0, 1, 2, 3], [0, 1])
    assert error(classical.values, smeared) > 10 * error(frfs.values, wanted)


def test_local_model_keeps_damping(light):
    """Damping from the half-power width of the resonance at 62.5 Hz: FRF against truth on the same lines."""
    frfs = shaker(light).band(62, 63)
    wanted = truth(structure(**LIGHT), frfs.frequencies, [0], [0])[:, 0, 0]
    found = frfs.values[:, 0, 0]
    pole = poles_from(np.array([62.5]), np.array([0.001]))[0]
    s = 2j * np.pi * frfs.frequencies

    def fitted(values):  # one pole and a constant: values (s - p) = a + b s
        columns = np.stack([values, np.ones_like(s), s], axis=1)
        return np.linalg.lstsq(columns, values * s, rcond=None)[0][0]

    assert fitted(wanted).real == pytest.approx(pole.real, rel=0.02)
    assert fitted(found).real == pytest.approx(pole.real, rel=0.02)


def test_variance_of_the_local_model_is_that_of_its_error():
    run = run_of(shaker_rig(noise=0.5).takes())
    frfs = shaker(run).band(15, 480)
    squares = np.abs(frfs.values - truth(structure(), frfs.frequencies, [0, 1, 2, 3], [0, 1])) ** 2
    assert np.mean(squares / frfs.variance) == pytest.approx(1.0, abs=0.25)
    assert np.median(frfs.coherence) < 0.9999


@pytest.mark.parametrize("estimator", ["H1", "Hv"])
def test_welch_is_right_where_damping_is_not_light(estimator):
    model = structure(damping=(0.05, 0.05, 0.04, 0.04))
    run = run_of(shaker_rig(model, seconds=120.0).takes())
    frfs = shaker(run, estimator, method="welch", block=2048).band(15, 480)
    assert error(frfs.values, truth(model, frfs.frequencies, [0, 1, 2, 3], [0, 1])) < 0.05
    assert np.median(frfs.coherence) > 0.999
    assert frfs.averages[0, 0] == pytest.approx(120 * 1024 / 2048 * 2.0, rel=0.1)  # 75 % overlap of Hann: twice


def test_records_are_averaged():
    take = shaker_rig(noise=0.5).take(0)
    half = take.signals.shape[1] // 2
    parts = [replace(take, signals=take.signals[:, :half]), replace(take, signals=take.signals[:, half:])]
    both = shaker(run_of(parts), method="welch", block=1024)
    one = shaker(run_of([take]), method="welch", block=1024)
    assert both.averages[0, 0] == pytest.approx(one.averages[0, 0], rel=0.1)
    assert error(both.values[10:480], one.values[10:480]) < 0.1


def test_equal_inputs_cannot_be_told_apart():
    take = shaker_rig().take(0)
    signals = take.signals.copy()
    signals[1] = 2 * signals[0]
    with pytest.raises(InputError, match="cannot be told apart"):
        shaker(run_of([replace(take, signals=signals)]))


def test_correlated_inputs_are_a_finding():
    take = shaker_rig(noise=0.01).take(0)
    quiet = [f for f in shaker(run_of([take])).findings if f.code == "input-correlation"]
    assert quiet[0].severity == "info"
    assert quiet[0].value < 0.4
    signals = take.signals.copy()
    signals[1] = signals[0] + 0.3 * signals[1]
    loud = [f for f in shaker(run_of([replace(take, signals=signals)])).findings if f.code == "input-correlation"]
    assert loud[0].severity == "warning"
    assert loud[0].value > 0.8


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"method": "welch", "block": 10**6}, "shorter than a block"),
        ({"estimator": "H2", "method": "welch"}, "H2 is defined for one input"),
        ({"estimator": "H2"}, "local model is an H1 estimate"),
        ({"method": "welch", "overlap": 1.0}, "not an overlap"),
    ],
)
def test_wrong_use_gets_one_sentence(options, sentence):
    with pytest.raises(InputError, match=sentence):
        shaker(run_of(shaker_rig().takes()), **options)


def test_records_that_do_not_fit_are_refused():
    take = shaker_rig().take(0)
    with pytest.raises(InputError, match="differ in sampling rate"):
        shaker(run_of([take, replace(take, sampling_rate=2048.0)]))
    fewer = replace(take, signals=take.signals[:-1], channels=take.channels[:-1], overloads=None)
    with pytest.raises(InputError, match="differ in their channels"):
        shaker(run_of([take, fewer]))
    signals = take.signals.copy()
    signals[3, 5] = np.inf
    with pytest.raises(InputError, match="not numbers"):
        shaker(run_of([replace(take, signals=signals)]))


def test_dead_channels():
    take = shaker_rig(noise=0.01).take(0)
    signals = take.signals.copy()
    signals[4] = 0.0
    frfs = shaker(run_of([replace(take, signals=signals)]))
    assert not frfs.values[:, 2].any()
    assert "dead-channel" in {finding.code for finding in quality(frfs.band(20, 480))}
    signals[1] = 3.0
    with pytest.raises(InputError, match="force is zero or constant"):
        shaker(run_of([replace(take, signals=signals)]))
