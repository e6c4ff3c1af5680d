"""Faults of signals that leave plausible FRFs: late channels, forces of another kind, spikes, bent sensors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal

from ema.cli.checking import checked
from ema.data import Condition, Excitation, Finding, FrfSet, Run
from ema.estimate import hammer, quality, shaker, sweep
from ema.estimate.breaks import about_breaks, breaks
from ema.estimate.stated_excitation import kind_of
from ema.fit import modes, stabilise
from ema.progress import silent
from ema.study.recipe import EstimateTable
from tests.unit import measured_signals as drawn

ESTIMATES: dict[str, Callable[[Run], FrfSet]] = {"hammer": hammer, "random": shaker, "sweep": sweep}
PHASES = {"channel-delay", "channel-high-pass"}
KINDS = ("hammer", "random", "sweep")
Fault = Callable[[np.ndarray], np.ndarray]


def estimated(run: Run) -> FrfSet:
    """The FRFs in the band of the modes."""
    rate = run.recordings[0].sampling_rate
    return ESTIMATES[run.condition.excitation.kind](run).band(0.002 * rate, 0.4 * rate)


def said(frfs: FrfSet, codes: set[str]) -> list[Finding]:
    return [one for one in (*frfs.findings, *quality(frfs)) if one.code in codes]


def turned(frfs: FrfSet) -> list[Finding]:
    """What the phases of the modes say of the channels."""
    return [one for one in modes(frfs, stabilise(frfs)).findings if one.code in PHASES]


def run_of(seed: int, kind: str, fault: Fault | None = None, points: int = 4, heavy: bool = False) -> Run:
    """``heavy``: damping ratios of 1 to 8 %."""
    rng = np.random.default_rng(seed)
    beam = drawn.beam(rng, points=points, lightest=0.01 if heavy else 0.002, heaviest=0.08 if heavy else 0.02)
    noise = 10 ** rng.uniform(-3, -2)
    if kind == "hammer":
        return drawn.hammer_run(rng, beam, noise, fault=fault)
    return drawn.shaker_run(rng, beam, noise, kind=kind, fault=fault)


def late(row: int, samples: int = 1) -> Fault:
    def fault(signals: np.ndarray) -> np.ndarray:
        result = signals.copy()
        result[row, samples:], result[row, :samples] = signals[row, :-samples], signals[row, 0]
        return result

    return fault


@pytest.mark.parametrize("heavy", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_channel_one_sample_late_is_named_with_its_delay(seed: int, kind: str, heavy: bool) -> None:
    (found,) = turned(estimated(run_of(seed, kind, late(2), heavy=heavy)))
    assert found.code == "channel-delay" and "2:+Z" in found.where
    assert found.value == pytest.approx(1 / 2048, abs=0.05 / 2048)
    assert found.limit is not None and abs(found.value - 1 / 2048) < 3 * found.limit


@pytest.mark.parametrize("kind", KINDS)
def test_a_check_names_late_channels_too(kind: str) -> None:
    """It had fitted nothing, and said nothing of them."""
    for fault, expected in ((late(2), ["2:+Z"]), (None, [])):
        one = checked(run_of(7300041, kind, fault), EstimateTable(), silent)
        assert [each.where.rpartition(" ")[2] for each in one.findings if each.code in PHASES] == expected


@pytest.mark.parametrize("heavy", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_force_one_sample_late_is_told_of_the_force(kind: str, heavy: bool) -> None:
    (found,) = turned(estimated(run_of(21, kind, late(0), heavy=heavy)))
    assert found.value == pytest.approx(1 / 2048, abs=0.05 / 2048)
    assert "responses" in found.message


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(31, 37))
def test_channels_in_time_are_not_called_late(seed: int, kind: str) -> None:
    frfs = estimated(run_of(seed, kind, points=1 + seed % 5, heavy=seed % 2 == 0))
    assert not turned(frfs) and not said(frfs, {"excitation-not-as-stated"})


@pytest.mark.parametrize(("seed", "kind"), [(41, "random"), (42, "hammer"), (43, "sweep")])
def test_a_channel_behind_a_high_pass_filter_is_named_with_its_corner(seed: int, kind: str) -> None:
    def coupled(signals: np.ndarray) -> np.ndarray:
        b, a = scipy.signal.butter(1, 40.0, "high", fs=2048.0)
        return np.vstack([signals[:3], scipy.signal.lfilter(b, a, signals[3:4]), signals[4:]])

    (found,) = turned(estimated(run_of(seed, kind, coupled)))
    assert found.code == "channel-high-pass" and "3:+Z" in found.where
    assert found.value == pytest.approx(40.0, rel=0.15)


@pytest.mark.parametrize(
    ("true", "stated"), [("sweep", "random"), ("random", "sweep"), ("hammer", "sweep"), ("hammer", "random")]
)
def test_a_force_of_another_kind_than_stated_is_named(true: str, stated: str) -> None:
    run = replace(run_of(51, true), condition=Condition(Excitation(stated)))  # type: ignore[arg-type]
    (found,) = said(estimated(run), {"excitation-not-as-stated"})
    assert found.severity == ("warning" if true == "sweep" else "error")


def test_steps_in_one_record_stated_as_random_are_named() -> None:
    rng = np.random.default_rng(61)
    step = np.minimum(np.arange(16384 * drawn.FINER) * 30 // (16384 * drawn.FINER), 29)
    force = 10 * np.sin(2 * np.pi * np.cumsum(np.linspace(0.02, 0.38, 30)[step]) / drawn.FINER)
    (found,) = said(estimated(drawn.shaker_run(rng, drawn.beam(rng), force=force)), {"excitation-not-as-stated"})
    assert "steps" in found.message


def forces(rng: np.random.Generator, samples: int) -> dict[str, np.ndarray]:
    """Forces in closed form or filtered noise, by what they are."""
    time, noise = np.arange(samples), rng.standard_normal(samples)
    low, high = 0.01, 0.4
    rising = np.sin(2 * np.pi * (low * time + 0.5 * (high - low) * time**2 / samples))
    growth = np.log(high / low)
    period = samples // 4
    burst = np.where(np.arange(samples) % period < rng.uniform(0.3, 0.8) * period, noise, 0.0)
    return {
        "random": noise,
        "random, coloured": scipy.signal.lfilter(*scipy.signal.butter(2, rng.uniform(0.05, 0.2), fs=1), noise),
        "random, bursts": burst,
        "random, with a tone": noise + 0.7 * np.sin(0.3 * time),
        "sweep": rising + 0.05 * noise,
        "sweep, logarithmic": np.sin(2 * np.pi * low * samples / growth * (np.exp(time / samples * growth) - 1)),
        "sweep, with a pause": np.where(time < 0.7 * samples, rising, 0.0),
        "sweep, with harmonics": rising + 0.2 * rising**3 + 0.1 * rising**2,
    }


@pytest.mark.parametrize("seed", range(5))
def test_the_kind_of_a_force_is_never_another_one(seed: int) -> None:
    for name, force in forces(np.random.default_rng(seed), 8192 * 2 ** (seed % 3)).items():
        assert kind_of(force) in (name.split(",")[0], None), name


@pytest.mark.parametrize("seed", [71, 72, 73])
def test_a_spike_in_a_response_to_an_impact_is_a_break(seed: int) -> None:
    def spiked(signals: np.ndarray) -> np.ndarray:
        result = signals.copy()
        result[2, 700] += 0.5 * np.abs(result[2]).max()
        return result

    (found,) = said(estimated(run_of(seed, "hammer", spiked)), {"signals-break"})
    assert "a2" in found.message
    assert not said(estimated(run_of(seed, "hammer")), {"signals-break"})


@pytest.mark.parametrize("seed", [200, 201, 202, 203, 205])
def test_a_force_sensor_that_bends_is_not_called_a_break(seed: int) -> None:
    def bent(signals: np.ndarray) -> np.ndarray:
        return np.vstack([signals[:1] + 0.2 * signals[:1] ** 2 / np.abs(signals[0]).max(), signals[1:]])

    run = run_of(seed, "random", bent)
    assert breaks(run.recordings[0]), "a linear prediction alone takes it for one"
    assert [one.code for one in about_breaks(run)] == ["static-nonlinearity"]


@pytest.mark.parametrize("seed", [201, 211])
def test_samples_lost_beside_a_bent_sensor_are_a_break(seed: int) -> None:
    def cut(signals: np.ndarray) -> np.ndarray:
        signals = np.vstack([signals[:1] + 0.2 * signals[:1] ** 2 / np.abs(signals[0]).max(), signals[1:]])
        return np.delete(signals, np.s_[7000:7040], axis=1)

    assert [one.code for one in about_breaks(run_of(seed, "random", cut))] == ["signals-break"]
