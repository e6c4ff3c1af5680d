"""Hammer tests with faults that laboratories have, on a structure known in closed form: right, or named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import store
from ema.cli import main
from ema.data import Condition, Excitation, FrfSet, ModalModel, Run
from ema.errors import InputError
from ema.estimate import HammerSettings, hammer_test
from ema.estimate.impact_decays import free_decays, impact_decays, late_part
from ema.fit import modes, stabilise
from ema.study.chain import analyse
from ema.study.measured import frfs_of
from ema.study.recipe import EstimateTable, FitTable
from tests.unit.closed_form_impacts import DAMPING, FREQUENCIES, RATE, hammer_run, impact

BAND = (10.0, 200.0)


def fitted(run: Run) -> ModalModel:
    frfs, _ = hammer_test(run)
    inside = frfs.band(*BAND)
    return modes(inside, stabilise(inside))


def codes(frfs: FrfSet, *severities: str) -> set[str]:
    return {finding.code for finding in frfs.findings if finding.severity in severities}


def test_the_closed_form_is_found_within_its_intervals() -> None:
    model = fitted(hammer_run())
    errors = model.natural_frequencies - FREQUENCIES, model.damping_ratios - DAMPING
    assert np.all(np.abs(errors[0]) < 3 * np.sqrt(model.covariance[:, 0, 0]))
    assert np.all(np.abs(errors[1]) < 3 * np.sqrt(model.covariance[:, 1, 1]))


@pytest.mark.parametrize("phase", [None, 0.3])
@pytest.mark.parametrize("mains", [50.0, 60.0])
def test_one_line_of_the_mains_is_no_mode(mains: float, phase: float | None) -> None:
    """A tone does not decay: the exponential window gives it a damping that is taken off again, down to 0 or below."""

    def humming(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        peaks = np.abs(signals).max(axis=1, keepdims=True) * np.array([[0.0], [0.05], [0.05]])
        turn = np.random.default_rng(10 * point + number).uniform(0, 2 * np.pi) if phase is None else phase
        return signals + peaks * np.sin(2 * np.pi * mains * times + turn)

    model = fitted(hammer_run(humming))
    assert len(model.poles) == 4, model.natural_frequencies
    assert np.all(np.abs(model.natural_frequencies - FREQUENCIES) < 0.001 * FREQUENCIES)
    assert np.all(model.damping_ratios > 0)


def test_a_force_that_is_cut_off_at_one_value_is_an_overload() -> None:
    """At 1024 Hz a pulse of 4 ms has two samples on the ceiling: no flat top tells, and the FRFs are too large."""

    def cut(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        return np.vstack([np.minimum(signals[0], 85.0), signals[1:]])

    frfs, hits = hammer_test(hammer_run(cut))
    sound, _ = hammer_test(hammer_run())
    assert codes(frfs, "warning") & {"overload"} and not codes(sound, "error", "warning")
    assert all(abs(hit.peak) < 84 for hit in hits.accepted), "those of 80 N are sound"
    gain = np.abs(frfs.values[40:130, 0, 0] / sound.values[40:130, 0, 0])
    assert np.median(gain) == pytest.approx(1, abs=0.01)


def test_signals_of_another_point_are_not_a_measurement_of_this_one() -> None:
    run = hammer_run()
    records = list(run.recordings)
    for number in range(3):
        records[6 + number] = replace(records[6 + number], signals=records[3 + number].signals)
    frfs, _ = hammer_test(replace(run, recordings=tuple(records)))
    (finding,) = [finding for finding in frfs.findings if finding.code == "copied-impact"]
    assert finding.severity == "error" and finding.value == 3 and "p2_0" in finding.message


def test_fit_tells_what_is_wrong_with_the_measurement(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A sensor turned round: the sign of the drive point is an error of the FRFs, not of the fit."""
    text = '[campaign]\nname = "A"\n[[runs]]\nid = "bare"\nkind = "hammer"\nfiles = "p*.h5"\n'
    (tmp_path / "campaign.toml").write_text(text)
    for record in hammer_run(lambda point, number, times, signals: signals * [[1], [-1], [-1]]).recordings:
        store.save(tmp_path / f"{record.name}.h5", record)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as ended:
        patch.setattr("sys.argv", ["ema", "fit", str(tmp_path), "--band", "10", "200"])
        main()
    told = capsys.readouterr().out
    assert ended.value.code == 0 and "error: run bare, 1:+Z/1:+Z: the drive point has the wrong sign" in told


@pytest.mark.parametrize("length", [100_000_000, 10_000])
def test_blocks_far_longer_than_the_records_are_refused(length: int) -> None:
    with pytest.raises(InputError, match="the block is longer than the records"):
        hammer_test(hammer_run(points=(1,)), HammerSettings(block=length))
    frfs, _ = hammer_test(hammer_run(points=(1,)), HammerSettings(block=4096))
    assert frfs.frequency_step == 0.25


@pytest.mark.parametrize("band", [(2000.0, 3000.0), (512.0, 600.0), (200.0, 100.0)])
def test_bands_beyond_the_sampling_rate_are_a_sentence(band: tuple[float, float]) -> None:
    run = hammer_run(points=(1, 2))
    with pytest.raises(InputError, match="no band within half the sampling rate"):
        impact_decays(run, band)
    with pytest.raises(InputError):
        analyse(run, EstimateTable(), FitTable.model_construct(band=band))


def test_a_band_from_zero_is_one() -> None:
    assert analyse(hammer_run(points=(1, 2)), EstimateTable(), FitTable(band=(0.0, 200.0))).modes.poles.size == 4


def roving(*durations: float) -> Run:
    """One set-up for each duration: the hammer stays at point 1, an accelerometer goes from point to point."""
    records = [
        replace(record, setup=f"S{place}")
        for place, duration in enumerate(durations)
        for record in hammer_run(outputs=(1, 2 + place), points=(1,), duration=duration, seed=place).recordings
    ]
    return Run("roving", Condition(Excitation("hammer")), tuple(records))


def test_set_ups_that_need_different_windows_get_one() -> None:
    frfs, _ = frfs_of(roving(0.8, 0.7, 0.8), EstimateTable())
    assert frfs.added_decay > 0 and len(frfs.outputs) == 4
    inside = frfs.band(*BAND)
    model = modes(inside, stabilise(inside))
    np.testing.assert_allclose(model.natural_frequencies, FREQUENCIES, rtol=1e-3)
    np.testing.assert_allclose(model.damping_ratios, DAMPING, rtol=0.05)


def test_noise_beyond_the_force_is_no_shift_between_set_ups() -> None:
    """From 325 Hz on the force has fallen by 20 dB; no mode is there, and the FRFs are those of the noise."""
    frfs, _ = frfs_of(roving(2.0, 2.0, 2.0), EstimateTable())
    shifts = [finding for finding in frfs.findings if finding.code == "setup-shift"]
    assert len(shifts) == 2 and all(abs(finding.value) < 2e-4 for finding in shifts), [f.value for f in shifts]


@pytest.mark.parametrize("decay", [0.0, 0.3, 1.0, 4.0])
def test_a_window_of_the_front_end_shows_in_the_noise(decay: float) -> None:
    """Records of 2 s: windows from 1 1/s on leave an eighth of the noise, one of 0.3 1/s more than half."""

    def windowed(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        return signals * np.exp(-decay * np.clip(times - 0.05, 0, None))

    frfs, _ = hammer_test(hammer_run(windowed, points=(1, 2)))
    found = [finding for finding in frfs.findings if finding.code == "window-unstated"]
    assert [finding.severity for finding in found] == (["error"] if decay >= 1 else [])
    if found and decay == 1:
        assert found[0].value == pytest.approx(np.exp(-decay * 1.9), rel=0.15)


@pytest.mark.parametrize("noise", [0.002, 0.0001])
@pytest.mark.parametrize("share", [0.01, 0.1, 1.0])
def test_a_structure_that_still_moves_has_no_window(noise: float, share: float) -> None:
    """It was struck half a second before, and is at rest at the end of the record."""

    def moving(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        return signals + share * np.vstack([0 * times, impact(times + 0.5, 90.0, 0.05, [1, 4], point)[1:]])

    frfs, _ = hammer_test(hammer_run(moving, points=(1, 2), noise=noise))
    assert "window-unstated" not in {finding.code for finding in frfs.findings}


@pytest.mark.parametrize("outputs", [(4,), (1, 4), (1, 2, 4)])
def test_a_sensor_that_is_turned_at_one_impact_is_named(outputs: tuple[int, ...]) -> None:
    """One of three impacts with the other sign left a third of every FRF of the channel, without a word."""

    def turned(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        signals[-1] *= -1 if (point, number) == (2, 1) else 1
        return signals

    (finding,) = [
        one for one in hammer_test(hammer_run(turned, outputs=outputs))[0].findings if one.code == "records-disagree"
    ]
    assert finding.severity == "error" and "point 2:+Z" in finding.where and "opposite sign" in finding.message
    assert len(outputs) == 1 or "channel 4:+Z" in finding.where
    assert "impact 0" in finding.message


def test_a_range_that_is_changed_at_one_impact_is_named() -> None:
    def amplified(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        signals[2] *= 10 if (point, number) == (3, 2) else 1
        return signals

    (finding,) = [
        one
        for one in hammer_test(hammer_run(amplified, outputs=(1, 2, 4)))[0].findings
        if one.code == "records-disagree"
    ]
    assert "channel 2:+Z" in finding.where and "10 times as large" in finding.message


@pytest.mark.parametrize("noise", [0.002, 0.02])
def test_impacts_of_many_levels_and_points_near_nodes_do_not_disagree(noise: float) -> None:
    """A second impact twice as hard, and a sensor that shows next to nothing but noise."""

    def uneven(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        quiet = noise * np.random.default_rng(10 * point + number).standard_normal(signals.shape[1])
        level = 1.0 + number
        signals *= level
        signals[-1] = 0.01 * signals[-1] + np.abs(signals[-1]).max() * quiet
        return signals

    for seed in range(5):
        frfs, _ = hammer_test(hammer_run(uneven, outputs=(1, 2, 4), noise=noise, seed=seed))
        assert "records-disagree" not in codes(frfs, "error", "warning", "info")


def test_records_that_end_with_a_contact_have_no_decay() -> None:
    """Where the force rings to the end of the record nothing is left behind it; the analysis had ended in a fault."""
    free = free_decays(hammer_run(points=(1,)), BAND)
    assert free.rate == RATE / free.step and late_part(free.blocks, free.rate, 0.5) is not None
    assert late_part([replace(one, decay=one.decay[:, :0]) for one in free.blocks], free.rate, 0.5) is None


@pytest.mark.parametrize("factor", [1.0, -0.37])
@pytest.mark.parametrize("source", [0, 2])
def test_channels_that_show_one_signal_are_named(source: int, factor: float) -> None:
    """A plug or column taken twice, in its own unit or sign, had given shapes with small intervals."""

    def twice(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        signals[3] = factor * signals[source].astype(np.float32)
        return signals

    (finding,) = [
        one for one in hammer_test(hammer_run(twice, outputs=(1, 2, 4)))[0].findings if one.code == "equal-channels"
    ]
    assert finding.severity == "error"
    assert f"channels {'hammer' if source == 0 else 'a2'} and a4 show one signal" in finding.message


@pytest.mark.parametrize("noise", [1e-4, 0.01])
def test_sensors_side_by_side_are_two(noise: float) -> None:
    """Three sensors at one place, and one elsewhere: what they have in common is the vibration, not the noise."""

    def together(point: int, number: int, times: np.ndarray, signals: np.ndarray) -> np.ndarray:
        rng = np.random.default_rng(10 * point + number)
        same = impact(times, 80.0 + 11 * number, 0.05, [2], point)[1]
        signals[1:3] = same + noise * np.abs(same).max() * rng.standard_normal((2, len(same)))
        return signals

    assert "equal-channels" not in codes(hammer_test(hammer_run(together, outputs=(1, 2, 4)))[0], "error")
