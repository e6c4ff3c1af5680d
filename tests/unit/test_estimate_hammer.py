"""Hammer tests of a structure with known FRFs: values, variances, verdicts on impacts, windows, bad input."""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Channel
from ema.errors import InputError
from ema.estimate import HammerSettings, hammer, hammer_test, level_bins
from ema.simulate import Fault
from tests.unit.estimate_rig import DOFS, error, hammer_rig, recording, run_of, structure, truth


def codes(frfs):
    return {finding.code for finding in frfs.findings}


@pytest.fixture(scope="module")
def faulty():
    faults = (Fault(1, 1, "double hit"), Fault(2, 3, "overload", 9.0))
    rig = replace(hammer_rig(noise=1.0, faults=faults), force_range=5000.0)
    return hammer_test(run_of(rig.takes()))


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_frfs_are_the_true_ones(estimator):
    frfs = hammer(run_of(hammer_rig().takes()), HammerSettings(estimator=estimator)).band(20, 1200)
    assert frfs.values.shape[1:] == (2, 4)
    assert frfs.inputs == DOFS
    assert frfs.unit == "(m/s^2)/N"
    assert error(frfs.values, truth(structure(), frfs.frequencies, [0, 1], [0, 1, 2, 3])) < 2e-3
    assert np.median(frfs.coherence) > 0.99999


def test_variance_is_that_of_the_error():
    frfs = hammer(run_of(hammer_rig(noise=3.0).takes())).band(20, 1200)
    squares = np.abs(frfs.values - truth(structure(), frfs.frequencies, [0, 1], [0, 1, 2, 3])) ** 2
    assert np.mean(squares / frfs.variance) == pytest.approx(1.0, abs=0.25)


def test_faulty_impacts_are_rejected_and_no_others(faulty):
    frfs, gallery = faulty
    rejected = {(str(hit.dof), hit.index): hit.reason for hit in gallery.hits if not hit.accepted}
    assert set(rejected) == {("2:+Z", 1), ("3:+Z", 3)}
    assert "second contact of 30 %, +25" in rejected["2:+Z", 1]
    assert "overloaded" in rejected["3:+Z", 3]
    assert {"double-hit", "overload"} <= codes(frfs)
    np.testing.assert_array_equal(frfs.averages, [[5, 4, 4, 5]] * 2)


def test_gallery_holds_what_the_hammer_did(faulty):
    _, gallery = faulty
    hits = [hit for hit in gallery.hits if hit.accepted]
    for hit in hits:
        assert hit.pulse.max() == pytest.approx(hit.peak)
        assert hit.impulse == pytest.approx(2 / np.pi * hit.peak * 0.6e-3, rel=0.35)
        assert 0.4e-3 < hit.contact_time < 1.6e-3
    assert gallery.usable_band[0] < gallery.usable_band[1]
    # A half sine of 0.6 ms: |cos(x)/(1 - (2x/pi)^2)| with x = pi f T has fallen by 10 dB at f T = 1.08.
    assert gallery.usable_band[0] == pytest.approx(1.08 / 0.6e-3, rel=0.2)


def test_one_record_per_impact_gives_the_same_as_one_with_all():
    rig = hammer_rig(points=DOFS[:1], hits=4, spacing=1.2)
    long = rig.take(0)
    step = int(1.2 * long.sampling_rate)
    parts = [replace(long, signals=long.signals[:, k * step : (k + 1) * step], name=f"blow {k}") for k in range(4)]
    together = hammer(run_of([long]), HammerSettings(block=4096))
    apart = hammer(run_of(parts), HammerSettings(block=4096))
    assert apart.averages[0, 0] == together.averages[0, 0] == 4
    assert error(apart.band(20, 1200).values, together.band(20, 1200).values) < 1e-4


def test_a_reference_sensor_of_several_set_ups_is_averaged():
    rig = hammer_rig(points=DOFS[:1])
    other = replace(rig, responses=(rig.responses[0], replace(rig.responses[1], name="acc 3", dof=DOFS[2])), seed=5)
    frfs = hammer(run_of([rig.take(0), other.take(0)]))
    assert frfs.outputs == DOFS[:3]
    np.testing.assert_array_equal(frfs.averages[:, 0], [10, 5, 5])
    band = frfs.band(20, 1200)
    assert error(band.values, truth(structure(), band.frequencies, [0, 1, 2], [0])) < 2e-3


def test_a_short_last_impact_does_not_shorten_all_blocks():
    takes = [replace(take, signals=take.signals[:, : int(4.9 * 5120)]) for take in hammer_rig().takes()]
    frfs = hammer(run_of(takes))
    assert frfs.frequency_step < 1.1
    np.testing.assert_array_equal(frfs.averages, 4)
    assert "next-impact" in codes(frfs)


def test_single_precision_records_cost_no_accuracy():
    rig = hammer_rig(points=DOFS[:1])
    single = [replace(take, signals=take.signals.astype(np.float32)) for take in rig.takes()]
    found, wanted = hammer(run_of(single)).band(20, 1200), hammer(run_of(rig.takes())).band(20, 1200)
    assert error(found.values, wanted.values) < 1e-5


def test_exponential_window_is_carried_exactly():
    model = structure(damping=(0.002, 0.002, 0.001, 0.001))
    frfs = hammer(run_of(hammer_rig(model, spacing=1.1, hits=1, points=DOFS * 2).takes()))
    assert frfs.added_decay > 0
    assert "exponential-window" in codes(frfs)
    band = frfs.band(20, 1200)
    wanted = truth(model, band.frequencies, [0, 1], [0, 1, 2, 3], band.added_decay)
    without = hammer(
        run_of(hammer_rig(model, spacing=1.1, hits=1, points=DOFS * 2).takes()), HammerSettings(decay=0.0)
    ).band(20, 1200)
    plain = truth(model, without.frequencies, [0, 1], [0, 1, 2, 3])
    assert error(band.values, wanted) < 0.02
    assert error(without.values, plain) > 3 * error(band.values, wanted)
    assert "leakage" in codes(without)


def test_a_decayed_response_gets_no_window():
    frfs = hammer(run_of(hammer_rig().takes()))
    assert frfs.added_decay == 0.0
    assert not codes(frfs) & {"leakage", "exponential-window"}


def test_too_strong_a_window_is_flagged():
    model = structure(damping=(0.002, 0.002, 0.001, 0.001))
    frfs = hammer(run_of(hammer_rig(model, hits=3).takes()), HammerSettings(decay=40.0))
    assert any(f.code == "exponential-window" and f.severity == "warning" for f in frfs.findings)


def test_noise_on_the_force_biases_h1_down_and_h2_not():
    rig = hammer_rig(hits=24, points=DOFS[:1], noise=1.0, peak=60.0, scatter=0.0)
    rig = replace(rig, noise={"force": 2.0})
    line = structure().poles.imag[2] / (2 * np.pi)
    sizes = {}
    for estimator in ("H1", "H2", "Hv"):
        settings = HammerSettings(estimator=estimator, window_force=False, less_noise=False)
        frfs = hammer(run_of(rig.takes()), settings).band(line - 8, line + 8)
        wanted = truth(structure(), frfs.frequencies, [0, 1], [0])
        sizes[estimator] = np.sum(np.abs(frfs.values)) / np.sum(np.abs(wanted))
    assert sizes["H1"] < 0.9
    assert sizes["H2"] == pytest.approx(1.0, abs=0.1)
    assert sizes["Hv"] == pytest.approx(np.sqrt(sizes["H1"] * sizes["H2"]), rel=0.02)


def test_excluded_hits_are_not_used():
    take = replace(hammer_rig(points=DOFS[:1]).take(0), excluded_hits=((1, "chair moved"),))
    frfs, gallery = hammer_test(run_of([take]))
    assert [hit.index for hit in gallery.hits if not hit.accepted] == [1]
    assert gallery.hits[1].reason == "excluded: chair moved"
    assert frfs.averages[0, 0] == 4


def test_levels_select_and_bin():
    run = run_of(hammer_rig(points=DOFS[:1], hits=12, scatter=0.4).takes())
    _, gallery = hammer_test(run)
    bins = level_bins(gallery)
    assert all(high <= 1.5 * low * (1 + 1e-9) for low, high in bins)
    counts = [hammer(run, HammerSettings(level=one)).averages[0, 0] for one in bins]
    assert sum(counts) == len(gallery.accepted)


def with_level_dependence(strength):
    """Blows of three levels on an oscillator whose response grows with the level."""
    rate, step = 2048.0, 2048
    t = np.arange(step) / rate
    force, response = np.zeros(6 * step), np.zeros(6 * step)
    rng = np.random.default_rng(1)
    for k, peak in enumerate((50, 100, 150, 60, 110, 160)):
        at = k * step + 120
        force[at : at + 6] = peak * np.sin(np.pi * np.arange(6) / 6)
        decay = np.exp(-12 * (1 + strength * peak / 100) * t) * np.sin(2 * np.pi * 120 * t)
        full = np.convolve(force[k * step : (k + 1) * step], decay)[:step]
        response[k * step : (k + 1) * step] = full
    response += 1e-3 * response.std() * rng.standard_normal(len(response))
    return run_of([recording([force, response], rate)])


def test_level_dependence_is_a_finding():
    assert "level-dependence" in codes(hammer(with_level_dependence(0.6)))
    assert "level-dependence" not in codes(hammer(with_level_dependence(0.0)))


def test_unstated_units_stay_unstated():
    take = hammer_rig(points=DOFS[:1]).take(0)
    channels = (replace(take.channels[0], unit="unstated"), *take.channels[1:])
    frfs = hammer(run_of([replace(take, channels=channels)]))
    assert frfs.unit == "unstated"
    assert frfs.quantity == "accelerance"
    assert "unit-unstated" in codes(frfs)


def test_negative_pulses_are_used_and_reported():
    take = hammer_rig(points=DOFS[:1]).take(0)
    wrong = replace(take, signals=take.signals * np.array([[-1.0], [1.0], [1.0]]))
    frfs = hammer(run_of([wrong]))
    assert "force-sign" in codes(frfs)
    assert error(frfs.values, -hammer(run_of([take])).values) < 1e-9


def test_clipping_is_seen_without_a_stated_range():
    take = hammer_rig(points=DOFS[:1], scatter=0.2, noise=1.0).take(0)
    signals = take.signals.copy()
    limit = 0.15 * np.abs(signals[1]).max()
    hit = int(np.argmax(np.abs(signals[1])))
    signals[1] = np.clip(signals[1], -limit, limit)
    _, gallery = hammer_test(run_of([replace(take, signals=signals)]))
    clipped = [h for h in gallery.hits if "acc 1 is overloaded" in h.reason]
    assert any(abs(h.time * take.sampling_rate - hit) < 400 for h in clipped)


def test_a_record_with_a_reported_overload_is_the_last_resort():
    """Its FRFs are stated with an error where the point has nothing else, and not used where it has."""
    rig = hammer_rig(points=DOFS[:1])
    take = replace(rig.take(0), overloads=np.array([False, True, False]), name="overloaded")
    frfs = hammer(run_of([take]))
    assert ("best-effort", "error") in {(one.code, one.severity) for one in frfs.findings}
    assert frfs.averages[0, 0] == 5
    _, gallery = hammer_test(run_of([take, replace(rig, seed=1).take(0)]))
    assert all(hit.accepted == (hit.recording != "overloaded") for hit in gallery.hits)
    assert all("overloaded" in hit.reason for hit in gallery.hits if not hit.accepted)


def test_under_range_is_reported_not_rejected():
    rig = replace(hammer_rig(points=DOFS[:1]), force_range=50_000.0)
    frfs = hammer(run_of(rig.takes()))
    assert "under-range" in codes(frfs)
    assert frfs.averages[0, 0] == 5


def test_shifted_mean_of_a_response_is_reported():
    take = hammer_rig(points=DOFS[:1], noise=1.0).take(0)
    signals = take.signals.copy()
    signals[2, int(2.3 * take.sampling_rate) :] += 0.05 * np.abs(signals[2]).max()
    found = [f for f in hammer(run_of([replace(take, signals=signals)])).findings if f.code == "dc-shift"]
    assert len(found) == 1
    assert "acc 2" in found[0].where


def test_a_point_without_impacts_is_missing_and_named():
    takes = list(hammer_rig().takes())
    takes[2] = replace(takes[2], excluded_hits=tuple((number, "chair moved") for number in range(5)))
    frfs = hammer(run_of(takes))
    assert frfs.inputs == (DOFS[0], DOFS[1], DOFS[3])
    assert any(f.code == "lost-point" and "3:+Z" in f.message for f in frfs.findings)


def test_a_point_with_double_impacts_only_is_estimated_and_named():
    """Second contacts that are measured do not bias: the FRFs are the true ones, and the finding says what happened."""
    rig = hammer_rig(
        faults=tuple(Fault(2, k, "double hit", strength=0.3 + 0.1 * k, delay=0.02 * (k + 1)) for k in range(5))
    )
    frfs = hammer(run_of(list(rig.takes())))
    assert frfs.inputs == DOFS
    (finding,) = [one for one in frfs.findings if one.code == "best-effort"]
    assert finding.severity == "warning" and "3:+Z" in finding.message
    band = frfs.band(20, 1200)
    assert error(band.values, truth(structure(), band.frequencies, [0, 1], [0, 1, 2, 3])) < 2e-3


def with_secondary_forces(ratios, delays, rng, contact=0.5e-3):
    """Impacts on a linear structure, each with a further contact that the sensor measures; one record each."""
    rate, samples = 12800.0, 12800
    model = structure()
    records = []
    for ratio, delay in zip(ratios, delays, strict=True):
        t = np.arange(samples) / rate - 0.05

        def pulse(at, t=t, contact=contact):
            return np.where((t > at) & (t < at + contact), np.sin(np.pi * (t - at) / contact), 0)

        force = 80 * rng.uniform(0.9, 1.1) * (pulse(0.0) + ratio * pulse(delay))
        spectrum = np.fft.rfft(force, 2 * samples)
        frequencies = np.fft.rfftfreq(2 * samples, 1 / rate)
        response = np.fft.irfft(truth(model, frequencies, [0, 1], [0])[:, :, 0].T * spectrum, axis=1)[:, :samples]
        signals = np.vstack([force, response])
        noise = np.array([[0.02], [1e-3 * response[0].std()], [1e-3 * response[1].std()]])
        records.append(recording(signals + noise * rng.standard_normal(signals.shape), rate))
    return records, model


def test_small_secondary_forces_in_every_impact_bias_nothing():
    rng = np.random.default_rng(4)
    records, model = with_secondary_forces(rng.uniform(0.013, 0.04, 5), rng.uniform(1.1e-3, 2.5e-3, 5), rng)
    frfs, gallery = hammer_test(run_of(records))
    assert [hit.accepted for hit in gallery.hits] == [True] * 5
    assert all("second contact" in hit.reason for hit in gallery.hits)
    assert {one.severity for one in frfs.findings if one.code == "double-hit"} == {"info"}
    band = frfs.band(20, 1200)
    assert error(band.values, truth(model, band.frequencies, [0, 1], [0])) < 2e-3, "cut off they would cost 2 %"


def test_a_second_contact_at_any_delay_stays_in_the_force():
    rng = np.random.default_rng(5)
    for delay in (0.01, 0.06, 0.2, 0.45):
        records, model = with_secondary_forces([0.2] * 5, [delay] * 5, rng)
        frfs, gallery = hammer_test(run_of(records))
        assert all("second contact of 20 %" in hit.reason for hit in gallery.hits), delay
        band = frfs.band(20, 1200)
        assert error(band.values, truth(model, band.frequencies, [0, 1], [0])) < 3e-3, delay


def test_contacts_behind_the_block_do_not_count():
    records, _ = with_secondary_forces([0.5] * 3, [0.3] * 3, np.random.default_rng(6))
    signals = [record.signals.copy() for record in records]
    for one in signals:
        one[:, 256:] += 0.08 * one[:, :-256].copy()  # and one of 8 % after 20 ms, with its response
    run = run_of([replace(record, signals=one) for record, one in zip(records, signals, strict=True)])
    _, whole = hammer_test(run)
    assert all("second contact of 50 %" in hit.reason for hit in whole.hits)
    _, short = hammer_test(run, HammerSettings(block=2560))
    assert all("second contact of 8" in hit.reason and hit.accepted for hit in short.hits)


@pytest.mark.parametrize(("phase", "used"), [(0.05, True), (0.5, False)])
def test_a_record_that_begins_within_the_impact_is_used_where_little_is_lost(phase, used):
    """A half sine cut off at the phase p of its contact has lost (1 - cos(pi p)) / 2 of its impulse: 0.6 and 50 %."""
    contact = 1.6e-3
    records, model = with_secondary_forces([0.0] * 4, [0.1] * 4, np.random.default_rng(7), contact)
    start = round((0.05 + phase * contact) * 12800)
    cut = [replace(one, signals=one.signals[:, start:]) for one in records[:2]]
    frfs, gallery = hammer_test(run_of([*cut, *records[2:]]), HammerSettings(block=11000))
    assert [hit.accepted for hit in gallery.hits] == [used, used, True, True]
    band = frfs.band(20, 500)
    assert error(band.values, truth(model, band.frequencies, [0, 1], [0])) < 0.02


def test_settings_overrule_the_choice():
    rig = hammer_rig(faults=(Fault(1, 1, "double hit"),))
    run = run_of([replace(take, name=f"take {number}") for number, take in enumerate(rig.takes())])

    def used(**more):
        frfs, gallery = hammer_test(run, HammerSettings(**more))
        return [(str(hit.dof), hit.index) for hit in gallery.hits if not hit.accepted], codes(frfs)

    assert used()[0] == [("2:+Z", 1)]
    for name in ("all", "double-hit", "2:+Z", "2:+Z#1", "take 1", "take 1#1"):
        assert used(keep=[name])[0] == [], name
    assert used(keep=["2:+Z#2"])[0] == [("2:+Z", 1)]
    assert used(reject=["1:+Z#0", "take 3#4"])[0] == [("1:+Z", 0), ("2:+Z", 1), ("4:+Z", 4)]
    assert used(keep=["all"], reject=["double-hit"])[0] == [("2:+Z", 1)]
    assert "selection" in used(keep=["9:+Z"])[1] and "selection" not in used(keep=["overload"])[1]


def test_what_the_campaign_excludes_is_not_kept():
    take = replace(hammer_rig(points=DOFS[:1]).take(0), excluded_hits=((1, "chair moved"),))
    assert hammer(run_of([take]), HammerSettings(keep=["all"])).averages[0, 0] == 4


def test_exchanged_channels_are_named():
    takes = list(hammer_rig(points=DOFS[:2], noise=1.0).takes())
    wrong = [replace(one, signals=one.signals[[1, 0, 2]]) for one in takes]
    (finding,) = [one for one in hammer(run_of(wrong)).findings if one.code == "swapped-channels"]
    assert finding.severity == "error" and "hammer" in finding.message and "acc 1" in finding.message
    assert "swapped-channels" not in codes(hammer(run_of(takes)))


def test_one_impact_says_nothing_about_noise():
    frfs = hammer(run_of(hammer_rig(hits=1).takes()))
    assert np.isnan(frfs.variance).all()
    assert "one-average" in codes(frfs)


def test_a_record_that_never_triggers_is_left_out():
    takes = list(hammer_rig(points=DOFS[:2], noise=1.0).takes())
    quiet = replace(takes[1], signals=np.random.default_rng(0).normal(size=takes[1].signals.shape))
    frfs = hammer(run_of([takes[0], quiet]))
    assert frfs.inputs == DOFS[:1]
    assert "no-trigger" in codes(frfs)


def nothing(shape=(2, 5000)):
    return np.zeros(shape)


def blow():
    signals = np.random.default_rng(0).normal(size=(2, 5000)) * 1e-3
    signals[0, 500:510] += np.sin(np.pi * np.arange(10) / 10)
    return signals


def not_a_number():
    signals = blow()
    signals[1, 77] = np.nan
    return signals


HAMMER = Channel("hammer", DOFS[0], quantity="force", role="reference", unit="N")


@pytest.mark.parametrize(
    ("records", "sentence"),
    [
        ([], "no raw records"),
        ([recording(nothing())], "never triggers"),
        ([recording(nothing() + 3.0)], "never triggers"),
        ([recording(np.random.default_rng(0).normal(size=(2, 5000)))], "never triggers"),
        ([recording(not_a_number())], r"acc 1: .*not numbers.*first at sample 77"),
        ([recording(nothing((2, 1)))], "too short; got 1 samples"),
        ([recording(blow(), channels=(HAMMER, replace(HAMMER, name="b")))], "no response channel"),
        ([recording(blow(), channels=(replace(HAMMER, role="other"), HAMMER))], "no response channel"),
        (
            [recording(blow(), channels=(replace(HAMMER, role="response"), replace(HAMMER, role="response")))],
            "no reference",
        ),
        ([recording(blow(), channels=(HAMMER,))], "channel table does not fit"),
        ([recording(blow()), recording(blow(), rate=1000.0)], "differ in sampling rate"),
        ([recording(blow(), excluded_hits=((0, "bad"),))], "no impact is left; got excluded: bad"),
    ],
    ids=lambda value: value.replace(" ", "-")[:30] if isinstance(value, str) else None,
)
def test_bad_input_gets_one_sentence(records, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        hammer(run_of(records))
    assert "run test" in str(caught.value)


def test_mixed_responses_are_refused():
    mixed = recording(np.vstack([blow(), blow()[1]]))
    channels = (*mixed.channels[:2], replace(mixed.channels[2], quantity="velocity", unit="m/s"))
    with pytest.raises(InputError, match="different kinds"):
        hammer(run_of([replace(mixed, channels=channels)]))
