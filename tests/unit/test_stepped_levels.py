"""Stepped levels of an oscillator whose stiffness and damping are given functions of its amplitude, with a second mode."""

import json

import numpy as np
import pytest

from acquisition import open_campaign
from acquisition.stepped_levels import LevelLayout, read_levels
from ema import estimate, store
from ema.cli.app import app
from ema.data import AmplitudeDependentMode, Band, SteppedLevel
from ema.errors import InputError
from ema.estimate.amplitude_mode import _jumps

MASS, F0, ZETA0 = 2.0, 80.0, 0.001
AMPLITUDES = (5.0, 10.0, 20.0, 40.0)  # m/s^2


def mode_at(amplitude):
    """Frequency [Hz] and damping ratio at an acceleration amplitude [m/s^2]."""
    return F0 * (1 - 2e-4 * amplitude**0.8), ZETA0 + 2e-5 * amplitude**1.4


def force_for(frequencies, amplitude, residual=0.0):
    """Force [N] that holds an acceleration of constant amplitude and phase 0, beside a compliance ``residual`` [m/N]."""
    f, zeta = mode_at(amplitude)
    w, wr = 2 * np.pi * frequencies, 2 * np.pi * f
    modal = MASS * (wr**2 - w**2 + 2j * zeta * wr * w)
    return -amplitude / w**2 * modal / (1 + residual * modal)


def level(amplitude, residual=0.0, noise=0.0, rng=None):
    f, zeta = mode_at(amplitude)
    frequencies = np.linspace(f * (1 - 6 * zeta), f * (1 + 7 * zeta), 41)
    force = force_for(frequencies, amplitude, residual)
    if noise:
        force = force * (1 + noise * (rng.standard_normal(41) + 1j * rng.standard_normal(41)))
    return SteppedLevel(
        frequencies=frequencies,
        force=np.abs(force),
        response=amplitude * np.exp(-1j * np.angle(force)),
        quantity="acceleration",
        control="response",
        name=f"{amplitude:g} m/s^2",
    )


def table(one, header, unit=1.0):
    rows = zip(one.frequencies, one.force, np.abs(one.response) / unit, np.degrees(np.angle(one.response)), strict=True)
    return header + "\n" + "\n".join(",".join(repr(float(value)) for value in row) for row in rows) + "\n"


def test_the_mode_over_its_amplitude_is_that_of_the_oscillator():
    mode = estimate.amplitude_dependent_mode([level(a, residual=2e-8) for a in AMPLITUDES])
    truth = np.array([mode_at(a) for a in AMPLITUDES])
    assert mode.amplitude == pytest.approx(AMPLITUDES, rel=1e-9)
    assert mode.frequency.value == pytest.approx(truth[:, 0], rel=2e-6)
    assert mode.damping.value == pytest.approx(truth[:, 1], rel=0.005)
    assert mode.modal_mass == pytest.approx(MASS, rel=0.005)


def test_intervals_hold_the_truth_under_noise():
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(60):
        mode = estimate.amplitude_dependent_mode([level(a, noise=0.02, rng=rng) for a in AMPLITUDES])
        for n, a in enumerate(AMPLITUDES):
            f, zeta = mode_at(a)
            inside.append(
                (
                    mode.frequency.low[n] <= f <= mode.frequency.high[n],
                    mode.damping.low[n] <= zeta <= mode.damping.high[n],
                )
            )
    assert np.all(np.mean(inside, axis=0) > 0.9)


def test_levels_at_constant_force_need_the_modal_mass_from_elsewhere():
    """Response and force of the same oscillator where the force is held: solved line by line for the amplitude."""
    from scipy.optimize import brentq

    levels = []
    for held in (0.05, 0.1):
        f, zeta = F0, 0.002
        frequencies = np.linspace(f * (1 - 8 * zeta), f * (1 + 5 * zeta), 81)
        amplitudes = [
            brentq(lambda a, w=w, held=held: abs(force_for(np.array([w]), a)[0]) - held, 1e-3, 500) for w in frequencies
        ]
        force = np.array([force_for(np.array([w]), a)[0] for w, a in zip(frequencies, amplitudes, strict=True)])
        levels.append(
            SteppedLevel(
                frequencies=frequencies,
                force=np.full(81, held),
                response=np.array(amplitudes) * np.exp(-1j * np.angle(force)),
                quantity="acceleration",
                control="force",
            )
        )
    mode = estimate.amplitude_dependent_mode(levels, modal_mass=MASS)
    for n, amplitude in enumerate(mode.amplitude):
        f, zeta = mode_at(amplitude)
        assert mode.frequency.value[n] == pytest.approx(f, rel=2e-5)
        assert mode.damping.value[n] == pytest.approx(zeta, rel=0.01)


def test_a_level_without_its_resonance_is_left_out_and_named():
    beside = level(20.0)
    beside = SteppedLevel(
        frequencies=beside.frequencies[25:],
        force=beside.force[25:],
        response=beside.response[25:],
        quantity="acceleration",
        control="response",
        name="beside",
    )
    mode = estimate.amplitude_dependent_mode([level(5.0), beside])
    assert len(mode.amplitude) == 1
    assert {finding.code for finding in mode.findings} >= {"no-single-resonance", "one-level"}
    with pytest.raises(InputError, match="no level holds a resonance"):
        estimate.amplitude_dependent_mode([beside])


def test_a_table_in_other_units_reads_the_same(tmp_path):
    path = tmp_path / "level.csv"
    path.write_text(table(level(20.0), "frequency [Hz],force [N],acceleration [g],phase [deg]", unit=9.80665))
    (read,) = read_levels(path, LevelLayout(response="acceleration", control="response"))
    assert read.quantity == "acceleration"
    assert np.abs(read.response) == pytest.approx(20.0)
    assert read.displacement == pytest.approx(level(20.0).displacement)


@pytest.mark.parametrize(
    ("header", "units", "message"),
    [
        ("frequency [Hz],force [N],response,phase [deg]", {}, "the response of the level has no unit"),
        ("frequency [Hz],force [N],response [m/s^2],phase", {}, "the phase of the level has no unit"),
        ("frequency [Hz],force [mm],response [m/s^2],phase [deg]", {}, "'mm' is no unit of a force"),
        ("frequency [Hz],force [N],answer [m/s^2],phase [deg]", {}, "no column 'response'"),
        (
            "frequency [Hz],force [N],response [m/s^2],phase [deg]",
            {"response": "g"},
            "state different units of the resp",
        ),
        ("frequency [kHz],force [N],response [g],phase [deg]", {"frequency": "Hz"}, "different units of the frequency"),
        ("frequency [Hz],force [N],response [g],phase [deg]", {"phase": "rad"}, "different units of the phase"),
        ("frequency [Hz],force [N],response [V],phase [deg]", {}, "'V' is no unit of a response"),
    ],
)
def test_what_a_table_does_not_say_is_asked_for_in_one_sentence(tmp_path, header, units, message):
    path = tmp_path / "level.csv"
    path.write_text(table(level(20.0), header))
    with pytest.raises(InputError, match=message) as caught:
        read_levels(path, LevelLayout(units=units))
    assert str(caught.value).count("\n") <= 4


def test_an_interval_holds_its_value():
    with pytest.raises(InputError, match="does not hold its value"):
        Band(low=np.array([1.0]), value=np.array([0.5]), high=np.array([2.0]))


@pytest.fixture
def campaign(tmp_path):
    """Levels at constant response, one set of FRFs, and a ring-down without force, in one campaign."""
    for a in AMPLITUDES:
        (tmp_path / f"level_{a:02g}.csv").write_text(
            table(level(a), "frequency [Hz],force [N],acceleration [m/s^2],phase [deg]")
        )
    f = np.arange(60.0, 100.0, 0.05)
    w, wr = 2 * np.pi * f, 2 * np.pi * F0
    frf = -(w**2) / (MASS * (wr**2 - w**2 + 2j * 0.004 * wr * w))
    rows = "\n".join(f"{x!r},{h.real!r},{h.imag!r}" for x, h in zip(f.tolist(), frf.tolist(), strict=True))
    (tmp_path / "frf.csv").write_text("frequency [Hz],real [(m/s^2)/N],imag [(m/s^2)/N]\n" + rows + "\n")
    t = np.arange(0, 2, 1 / 1024)
    decay = np.exp(-0.002 * wr * t) * np.sin(wr * t)
    rows = "\n".join(f"{x!r},{y!r}" for x, y in zip(t.tolist(), decay.tolist(), strict=True))
    (tmp_path / "decay.csv").write_text("time [s],a [m/s^2]\n" + rows + "\n")
    (tmp_path / "campaign.toml").write_text(
        """
[campaign]
name = "levels, FRFs and a ring-down"

[[runs]]
id = "levels"
kind = "stepped sine"
files = "level_*.csv"
[runs.levels]
control = "response"
response = "acceleration"

[[runs]]
id = "frfs"
kind = "sweep"
files = "frf.csv"
reader = { frequency = "frequency", real = "real", imaginary = "imag", unit = "(m/s^2)/N" }
channels = [{ name = "output", role = "response", dof = "1:+Z" }, { name = "input", role = "reference", dof = "1:+Z" }]

[[runs]]
id = "decay"
kind = "snap-back"
files = "decay.csv"
channels = [{ name = "a", dof = "1:+Z" }]
"""
    )
    return tmp_path


def command(*words):
    from typer.testing import CliRunner

    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_a_campaign_of_levels_frfs_and_ring_downs_is_checked_mapped_and_run(campaign, unfitted, undrawn, tmp_path):
    opened = open_campaign(campaign)
    assert [len(run.levels) for run in opened.runs] == [len(AMPLITUDES), 0, 0]
    checked = {run["run"]: run for run in json.loads(command("check", campaign, "--json"))["runs"]}
    points = checked["levels"]["levels"]["points"]
    assert [point["amplitude"] for point in points] == pytest.approx(AMPLITUDES)
    assert [finding["code"] for finding in checked["decay"]["findings"]] == ["ring-down-without-band"]
    command("map", campaign, "--output", tmp_path / "maps")
    stored = store.load(tmp_path / "maps" / "levels.h5")
    assert isinstance(stored, AmplitudeDependentMode)
    assert stored.damping.value == pytest.approx([mode_at(a)[1] for a in AMPLITUDES], rel=0.005)
    command("run", campaign, "--output", tmp_path / "out")
    result = store.load(next((tmp_path / "out").glob("*.h5")))
    assert [mode.name for mode in result.amplitude_modes] == ["levels"]
    assert [run.run.id for run in result.runs] == ["frfs"]
    report = next((tmp_path / "out").glob("*.html")).read_text()
    assert "Levels of levels" in report
    assert "ring-down-without-band" in [finding.code for finding in result.findings]


def test_one_level_twice_is_refused(campaign):
    (campaign / "level_41.csv").write_text((campaign / "level_40.csv").read_text())
    with pytest.raises(InputError, match="two levels of one amplitude"):
        open_campaign(campaign)


def few_lines(count, levels, draws, seed):
    """Share of frequencies and damping ratios inside their intervals, of levels with few lines about the resonance."""
    rng = np.random.default_rng(seed)
    inside = []
    for _ in range(draws):
        measured = []
        for amplitude in AMPLITUDES[:levels]:
            f, zeta = mode_at(amplitude)
            frequencies = np.linspace(f * (1 - 0.7 * zeta), f * (1 + 0.8 * zeta), count)
            force = force_for(frequencies, amplitude)
            force = force * (1 + 0.02 * (rng.standard_normal(count) + 1j * rng.standard_normal(count)))
            response = amplitude * np.exp(-1j * np.angle(force))
            measured.append(SteppedLevel(frequencies, np.abs(force), response, "acceleration", "response"))
        mode = estimate.amplitude_dependent_mode(measured)
        if len(mode.amplitude) == levels:
            truth = np.array([mode_at(a) for a in AMPLITUDES[:levels]]).T
            bands = zip((mode.frequency, mode.damping), truth, strict=True)
            inside.append([np.mean((band.low <= t) & (t <= band.high)) for band, t in bands])
    return np.mean(inside, axis=0)


@pytest.mark.parametrize("count", [6, 9, 15])
@pytest.mark.parametrize("levels", [1, 2])
def test_intervals_of_few_lines_and_few_levels_hold_the_truth(count, levels):
    # 0.95 of 400 draws: below 0.9 once in 10,000.
    assert np.all(few_lines(count, levels, draws=400, seed=[count, levels]) > 0.9)


def test_a_level_of_three_lines_states_no_interval_of_zero_width():
    f, zeta = mode_at(5.0)
    frequencies = np.array([f * (1 - zeta), f, f * (1 + zeta)])
    force = force_for(frequencies, 5.0)
    sparse = SteppedLevel(frequencies, np.abs(force), 5.0 * np.exp(-1j * np.angle(force)), "acceleration", "response")
    with pytest.raises(InputError, match="3 lines"):
        estimate.amplitude_dependent_mode([sparse])


def test_a_response_counted_against_the_force_is_turned_and_said():
    from dataclasses import replace

    right = [level(a) for a in AMPLITUDES]
    turned = [replace(one, response=-one.response) for one in right]
    mode = estimate.amplitude_dependent_mode(turned)
    assert mode.frequency.value == pytest.approx(estimate.amplitude_dependent_mode(right).frequency.value, rel=1e-12)
    assert {finding.code for finding in mode.findings} == {"response-against-force"}
    assert not estimate.amplitude_dependent_mode(right).findings


def test_a_phase_that_is_no_number_is_refused(tmp_path):
    path = tmp_path / "level.csv"
    path.write_text(table(level(5.0), "frequency [Hz],force [N],response [m/s^2],phase [deg]"))
    lines = path.read_text().splitlines()
    lines[7] = lines[7].rpartition(",")[0] + ",nan"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError):
        read_levels(path)


def swept(force, frequencies, mode, noise=0.0, rng=None):
    """A level at constant force [N], stepped in the order of the frequencies: of several states the one nearest to that
    before. ``mode`` gives frequency [Hz] and damping ratio at an amplitude [m/s^2]."""
    amplitudes = np.geomspace(1e-2, 2e2, 6000)
    f, zeta = mode(amplitudes)
    state, states = None, []
    for w in 2 * np.pi * frequencies:
        wr = 2 * np.pi * f
        over = np.abs(MASS * (wr**2 - w**2 + 2j * zeta * wr * w)) * amplitudes / w**2 - force
        roots = amplitudes[:-1][over[:-1] * over[1:] <= 0]
        # the middle one of three states is unstable
        roots = roots[[0, -1]] if len(roots) >= 3 else roots[:1]
        state = roots[np.argmin(np.abs(np.log(roots / (state or roots[0]))))]
        states.append(state)
    order = np.argsort(frequencies)
    a, w = np.array(states)[order], 2 * np.pi * frequencies[order]
    f, zeta = mode(a)
    stiffness = (2 * np.pi * f) ** 2 - w**2 + 4j * np.pi * zeta * f * w
    size, phase = 1 + np.zeros(len(a)), np.zeros(len(a))
    if noise:
        size, phase = size + noise * rng.standard_normal(len(a)), noise * rng.standard_normal(len(a))
    response = -a * size * np.exp(1j * (phase - np.angle(stiffness)))
    return SteppedLevel(
        frequencies[order], np.full(len(a), force), response, "acceleration", "force", name=f"{force:.3g} N"
    )


def softening(share):
    """A mode at 100 Hz that falls by a share of itself over the amplitude."""
    return lambda a: (100 * (1 - share * a / (a + 10)), 0.003 + 0.004 * a / (a + 10))


@pytest.mark.parametrize("way", ["up", "down"])
def test_a_level_whose_response_jumps_at_the_resonance_is_left_out_and_others_hold(way):
    mode, levels, rng = softening(0.06), [], np.random.default_rng([7, len(way)])
    for amplitude in (1.0, 2.0, 4.0, 8.0, 14.0):
        f, zeta = mode(amplitude)
        frequencies = np.linspace(f * (1 - 3 * zeta), f * (1 + 3 * zeta) + 1, 51)[:: 1 if way == "up" else -1]
        levels.append(swept(2 * MASS * zeta * amplitude, frequencies, mode, 0.002, rng))
    read = estimate.amplitude_dependent_mode(levels)
    jumping = {finding.where for finding in read.findings if finding.code == "jump-at-resonance"}
    # upwards a mode that softens is passed in a jump wherever its curve folds
    assert jumping >= ({one.name for one in levels[2:]} if way == "up" else set())
    assert len(jumping) + len(read.amplitude) == 5 and len(read.amplitude) >= 2
    f, zeta = mode(read.amplitude)
    assert np.all((read.frequency.low <= f) & (f <= read.frequency.high))
    assert np.all((read.damping.low <= zeta) & (zeta <= read.damping.high))
    assert read.modal_mass == pytest.approx(MASS, rel=0.07)


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.02])
def test_levels_of_one_amplitude_that_contradict_each_other_are_named(noise):
    """Every level once more, in another assembly: half a bandwidth lower, and with half as much damping again."""
    rng, mode, levels = np.random.default_rng(41), softening(0.01), []
    for amplitude in (1.0, 2.0, 4.0, 8.0):
        for low, more in ((0.0, 1.0), (0.4, 1.5)):
            f, zeta = mode(amplitude)

            def state(a, low=low, more=more):
                return mode(a)[0] - low, more * mode(a)[1]

            frequencies = np.linspace((f - low) * (1 - 3 * more * zeta), (f - low) * (1 + 3 * more * zeta), 41)
            force = 2 * MASS * more * zeta * amplitude
            levels.append(swept(force, frequencies, state, noise, rng))
    read = estimate.amplitude_dependent_mode(levels)
    named = [finding for finding in read.findings if finding.code == "levels-disagree"]
    assert len(named) == 4
    assert all(0.2 < finding.value < 0.6 for finding in named)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.02])
def test_levels_repeated_within_a_few_percent_do_not_contradict(share, noise):
    rng, mode = np.random.default_rng([43, int(1000 * noise)]), softening(share)
    for _ in range(5):
        levels = []
        for amplitude in (1.0, 1.03, 2.0, 2.1, 4.0, 4.2, 8.0, 8.02):
            f, zeta = mode(amplitude)
            frequencies = np.linspace(f * (1 - 3 * zeta), f * (1 + 3 * zeta), 41)
            levels.append(swept(2 * MASS * zeta * amplitude, frequencies, mode, noise, rng))
        read = estimate.amplitude_dependent_mode(levels)
        assert "levels-disagree" not in {finding.code for finding in read.findings}


def test_no_level_of_a_linear_mode_jumps_however_few_its_lines_and_noisy():
    rng, linear = np.random.default_rng(11), softening(0.0)
    for lines in (9, 15, 41):
        for noise in (0.0, 0.01, 0.1):
            for _ in range(10):
                level = swept(0.01, np.linspace(98.5, 101.5, lines), linear, noise, rng)
                read = estimate.amplitude_dependent_mode([level], modal_mass=MASS) if noise < 0.1 else None
                assert read is None or "jump-at-resonance" not in {finding.code for finding in read.findings}
                assert not len(_jumps((2 * np.pi * level.frequencies) ** 2, level.force / level.displacement))


@pytest.mark.parametrize(("share", "noise"), [(0.005, 0.002), (0.01, 0.002), (0.01, 0.01), (0.03, 0.01)])
def test_intervals_of_levels_at_constant_force_hold_a_mode_that_softens(share, noise):
    """The modal mass is the slope of F / x over w^2 at one amplitude; along a level at constant force that falls by a
    fifth on both sides of the resonance, and the frequency with it."""
    rng, mode, inside, mass = np.random.default_rng([int(1e4 * share), int(1e4 * noise)]), softening(share), [], []
    for _ in range(12):
        levels = []
        for amplitude in (2.0, 4.0, 8.0, 14.0, 22.0):
            f, zeta = mode(amplitude)
            frequencies = f * (1 + 3 * zeta * np.linspace(1, -1, 31))
            levels.append(swept(2 * MASS * zeta * amplitude, frequencies, mode, noise, rng))
        read = estimate.amplitude_dependent_mode(levels)
        f, zeta = mode(read.amplitude)
        inside.append((read.frequency.low <= f) & (f <= read.frequency.high))
        inside.append((read.damping.low <= zeta) & (zeta <= read.damping.high))
        mass.append(read.modal_mass)
    # of 120 that hold 95 % fewer than 101 are inside once in a million
    assert np.sum([np.sum(row) for row in inside]) >= 0.84 * np.sum([len(row) for row in inside])
    assert np.mean(mass) == pytest.approx(MASS, rel=0.005)


def test_an_uncertain_amplitude_is_in_the_interval_of_a_mode_that_follows_it():
    """One reading of a controlled amplitude is off by the noise; where the frequency falls steeply, so is the mode."""
    rng, inside = np.random.default_rng(5), []

    def mode(a):
        return 100 * (1 - 0.02 * np.log(a)), 0.002 + 0 * a

    for _ in range(60):
        levels = []
        for amplitude in (2.0, 4.0, 8.0):
            f, zeta = mode(amplitude)
            frequencies = f * (1 + 3 * zeta * np.linspace(-1, 1, 31))
            w, wr = 2 * np.pi * frequencies, 2 * np.pi * f
            force = MASS * (wr**2 - w**2 + 2j * zeta * wr * w) * amplitude / w**2
            read = amplitude * (1 + 0.02 * rng.standard_normal(31)) * np.exp(1j * (np.pi - np.angle(force)))
            levels.append(SteppedLevel(frequencies, np.abs(force), read, "acceleration", "response"))
        found = estimate.amplitude_dependent_mode(levels)
        truth = mode(np.array(found.amplitude))[0]
        inside.append((found.frequency.low <= truth) & (truth <= found.frequency.high))
    # frequencies at the amplitudes read; of 180 that hold 95 % fewer than 155 are inside once in a million
    assert np.sum(inside) >= 155
