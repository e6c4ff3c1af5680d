"""Fig. 3, Fig. 4 and "just before sticking" as recipes: Gaul, Roseira and Becker, Shock and Vibration 15 (2008), sec. 1.

Bounds and verdicts stand in ``reports/double_beam_*.toml``. The numbers behind them are here from closed forms, from the
exact event-driven solution, or read from the raw records without the estimators of the recipes.
"""

from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

import acquisition
from ema.cli.app import app
from ema.compare import map_features as features
from ema.data import Damping
from ema.datasets import double_beam_release
from ema.simulate import Masing, assemble, controlled_snapback, double_beam
from ema.simulate.control import Actuator, constant
from ema.simulate.events import snapback_reference
from ema.simulate.reduction import modal_base
from ema.study import Study
from tests.validation.recipes import run_recipe

E, RHO, L, B, H, MU, LOAD = 210e9, 7850.0, 0.5, 0.04, 0.005, 0.3, 20.0
INERTIA = B * H**3 / 12
SINGLE = 1.8751040687**2 / (2 * np.pi * L**2) * np.sqrt(E * INERTIA / (RHO * B * H))
RATE, REST = double_beam_release.SAMPLING_RATE, round(double_beam_release.REST * double_beam_release.SAMPLING_RATE)


@pytest.fixture(scope="module")
def results(root, tmp_path_factory):
    """What the recipes give, each run once, by the last part of its name."""

    @cache
    def run(name):
        return run_recipe(root / "reports" / f"double_beam_{name}.toml", tmp_path_factory.mktemp(name))

    return run


@pytest.fixture(scope="module")
def figure_3(results):
    return results("figure_3")


@pytest.fixture(scope="module")
def campaign(root, figure_3):
    return Study.load(root / "reports" / "double_beam_figure_3.toml").open()


def motion(campaign, run):
    return np.asarray(campaign[run].recordings[0].signals[-1], dtype=float)


def of(result, quantity, run=""):
    return next(one for one in result.statements if one.quantity.startswith(quantity) and run in one.quantity)


@pytest.mark.parametrize(
    ("name", "quoted", "own", "missed"), [("figure_3", 14, 4, 4), ("figure_4", 3, 1, 0), ("before_sticking", 2, 0, 2)]
)
def test_every_statement_gets_the_verdict_that_the_recipe_states(results, name, quoted, own, missed):
    statements = results(name).statements
    assert [f"{one.text}: {one.verdict}, {one.value:.4g}" for one in statements if not one.met] == []
    theirs = [one for one in statements if one.quoted]
    assert (len(theirs), len(statements) - len(theirs)) == (quoted, own)
    assert [one.verdict for one in theirs].count("not matched") == missed
    assert all("p. 29" in one.source for one in theirs)
    assert all(np.isfinite([one.lower, one.upper]).all() for one in statements if "not testable" not in one.verdict)


def test_sliding_beams_are_twice_as_stiff_as_one():
    """The sentence says that the stiffness of the sliding phase is that of one beam; the limits of its statement are those
    of one beam by beam theory, F L^3 / (3 E I), and two beams that share the load are deflected by half of it."""
    one = LOAD * L**3 / (3 * E * INERTIA)
    assert 1e3 * one == pytest.approx(9.524, abs=0.001)
    assert 9.05 < 1e3 * one < 10.0 and 1e3 * one / 2 == pytest.approx(4.762, abs=0.001)


def test_the_recipes_are_computed_from_the_documented_double_beam(root):
    """The model beside the records is that of ``datasets/double_beam``, and that of the tests here."""
    models = [acquisition.open_model(root / "datasets" / name) for name in ("double_beam", "double_beam_release")]
    models.append(double_beam(Masing(MU, 1e9), 1000.0, damping=Damping(0.001)))
    one, two, three = (modal_base(assemble(model)) for model in models)
    for other in (two, three):
        np.testing.assert_allclose(other.frequencies, one.frequencies, rtol=1e-6)
        np.testing.assert_allclose(other.decay, one.decay, rtol=1e-6)


@pytest.fixture(scope="module")
def exact():
    """The release at 1 kN, exactly between the events of stick and slip."""
    return snapback_reference(double_beam(Masing(MU, 1e9), 1000.0), LOAD, "beam 2:20:+Z", 0.1, sampling_rate=20_000.0)


def test_where_along_the_beams_they_slip(figure_3, exact):
    """Slip and dissipation at the clamp over that at the tip, whose contact has half the area, by the exact solution; of the
    energy that friction takes most goes in the first tenth of a second."""
    slip, energy = of(figure_3, "slip of first"), of(figure_3, "dissipation of first")
    largest = np.abs(exact.slips).max(axis=1)
    assert slip.value == pytest.approx(largest[0] / largest[-1], rel=0.01)
    assert energy.value == pytest.approx(exact.dissipated[0] / exact.dissipated[-1] / 2, rel=0.02)
    assert of(figure_3, "loop areas").value == pytest.approx(1.0, abs=0.002)


def test_the_hysteresis_of_fig_3_is_that_of_the_contact_law(figure_3):
    """Clamp and tip at 1 and 8 kN: never above mu F_N of the contact; a line of slope k_T, without area, at 8 kN."""
    loops = {one.name: one for one in figure_3.loops}
    for force in (1000.0, 8000.0):
        for contact, share in ((1, 1 / 19.5), (20, 0.5 / 19.5)):
            loop = loops[f"{force / 1000:.0f} kN, contact {contact}"]
            top = MU * force * share
            assert np.abs(loop.forces).max() <= top * (1 + 1e-9) and loop.normal_force == force
            if force == 8000.0:
                np.testing.assert_allclose(loop.forces, 1e9 * share * loop.displacements, atol=1e-6 * top)
                assert loop.area < 1e-9 * top * loop.amplitude
            else:
                assert np.abs(loop.forces).max() == pytest.approx(top, rel=1e-9) and loop.area > top * loop.amplitude


@pytest.mark.parametrize(("force", "start", "text"), [(1000.0, 0, "1 kN, rising"), (4000.0, 1, "4 kN, rising")])
def test_pressure_at_the_tip_by_the_solver_for_control(figure_3, force, start, text):
    """The energy integral over one second against a solver with fixed steps and a controller that holds the force."""
    areas = np.append(np.ones(19), 0.5)
    integrals = []
    for shares in (areas * np.arange(1, 21), areas):
        model = double_beam(Masing(MU, 1e9), force, force_shares=shares / shares.sum(), damping=Damping(0.001))
        run = controlled_snapback(
            model,
            constant(force),
            LOAD,
            "beam 2:20:+Z",
            1.0,
            Actuator(5e-4),
            step=2.5e-5,
            start_force=100.0,
            check=False,
        )
        share = run.energy.total / run.energy.total[0]
        integrals.append(np.sum(0.5 * (share[1:] + share[:-1])) * run.times[1])
    statement = of(figure_3, "energy integral", text)
    assert statement.value == pytest.approx(integrals[0] / integrals[1], rel=0.05)
    assert statement.verdict.startswith(("matched", "not matched")[start])


def test_just_before_sticking_a_release_keeps_most_of_its_energy(results):
    """3 P L / (4 mu h) is 5 kN: at 4.5 kN the joint still slips under the load, and what is left after it stays."""
    assert pytest.approx(5000.0) == 3 * LOAD * L / (4 * MU * H)
    statement = of(results("before_sticking"), "energy integral")
    assert statement.lower > 3 and statement.verdict == "not matched"


def test_deflections_are_those_of_beam_theory(campaign, figure_3):
    """4.762 mm less 0.714 mm/kN while all contacts slide; 8 kN over 1 kN from the samples before the release."""
    slope = MU * H * L**2 / (6 * E * INERTIA)
    free = LOAD * L**3 / (6 * E * INERTIA)
    assert 1e3 * free == pytest.approx(4.762, abs=1e-3) and 1e6 * slope == pytest.approx(0.714, abs=1e-3)
    statement = of(figure_3, "release deflection", "computed_100N")
    assert statement.value == pytest.approx(1e3 * (free - 100 * slope), abs=3e-3)
    still = {run: motion(campaign, run)[: REST - 200].mean() for run in ("computed_1kN", "computed_8kN")}
    over = of(figure_3, "release deflection over run", "computed_8kN")
    assert over.value == pytest.approx(still["computed_8kN"] / still["computed_1kN"], rel=1e-4)


def zero_crossings(x, first, last):
    """Mean frequency in Hz between two times in s, by the crossings of what lies below 60 Hz."""
    spectrum = np.fft.rfft(np.concatenate([x, x[::-1]]))
    spectrum /= 1 + (np.fft.rfftfreq(2 * len(x), 1 / RATE) / 60) ** 12
    y = np.fft.irfft(spectrum)[round(first * RATE) : round(last * RATE)]
    k = np.flatnonzero(np.diff(np.sign(y)))
    at = k + y[k] / (y[k] - y[k + 1])
    return 0.5 * RATE * (len(at) - 1) / (at[-1] - at[0])


def test_frequencies_of_the_phases(campaign, figure_3):
    """One beam while they slide, 16.71 Hz; the eigenproblem of the sticking beams, 31.58 Hz: 1.89 times that, not twice."""
    stuck = modal_base(assemble(double_beam(Masing(MU, 1e9), 0.0))).frequencies[0] / (2 * np.pi)
    assert pytest.approx(16.710, abs=1e-3) == SINGLE
    sliding = of(figure_3, "sliding frequency", "computed_100N")
    assert sliding.value == pytest.approx(SINGLE, rel=0.01)
    assert sliding.value == pytest.approx(zero_crossings(motion(campaign, "computed_100N"), 0.35, 1.1), rel=0.005)
    sticking = of(figure_3, "sticking frequency", "computed_1kN")
    assert sticking.value == pytest.approx(stuck, rel=2e-3)
    assert sticking.value == pytest.approx(zero_crossings(motion(campaign, "computed_1kN"), 0.6, 1.5), rel=2e-3)
    assert stuck / SINGLE == pytest.approx(1.89, abs=0.01)


def test_the_exponential_term_by_the_amplitudes_alone(campaign, results):
    """Velocity as the running sum of the acceleration about its mean, amplitudes of the sticking mode from its Fourier
    coefficient over ten periods, early and late: no envelope, no filter of the estimator."""
    acceleration = motion(campaign, "measured_6kN")
    velocity = np.cumsum(acceleration - acceleration[: REST - 200].mean()) / RATE
    both = [velocity, motion(campaign, "computed_6kN")]
    span = round(10 / double_beam_release.STICKING * RATE)
    window = np.hanning(span)
    heights = []
    for start in (0.5, 1.1):
        part = slice(round(start * RATE), round(start * RATE) + span)
        wave = np.exp(-2j * np.pi * double_beam_release.STICKING * np.arange(span) / RATE) * window
        heights.append([abs((one[part] - one[part].mean()) @ wave) for one in both])
    (a0, b0), (a1, b1) = heights
    missing = -np.log(a1 / b1 * b0 / a0) / (0.6 * 2 * np.pi * double_beam_release.STICKING)
    assert missing == pytest.approx(double_beam_release.MATERIAL, abs=1e-4)
    (decay,) = results("figure_4").decays
    assert np.median(decay.damping_ratios) == pytest.approx(double_beam_release.MATERIAL, rel=0.01)
    told = of(results("figure_4"), "missing damping", "measured_6kN")
    assert told.value == pytest.approx(100 * missing, abs=0.005)


def test_most_is_dissipated_far_below_sticking(results):
    """Steady states of the double beam: most damping at a hundredth of the normal force from which on it sticks."""
    result = results("before_sticking")
    chart = result.maps[0].chart
    for row in range(len(chart.force_levels)):
        best = chart.normal_forces[int(np.nanargmax(chart.damping[row]))]
        twentieth = chart.damping[row, list(chart.normal_forces).index(best) + 4 :]
        assert np.all(np.diff(twentieth) < 1e-4) and twentieth[0] > 2 * twentieth[-1]
        assert chart.damping[row, -1] == pytest.approx(0.001, rel=0.02), "what the beams themselves have"
    assert of(result, "ridge over sticking").upper < 0.1


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.5])
def test_the_rule_for_sticking_on_one_masing_spring_of_given_amplitude(ratio):
    """Damping 4 y (1 - y) with y = F_N / F_stick: highest at one half, none from F_stick on, wherever the grid lies. A
    rigid contact, whose damping grows in proportion up to F_stick, has its highest just before."""
    stick = 100.0 / ratio
    forces = np.geomspace(5.0, 20 * stick, 60)
    y = np.minimum(forces / stick, 1.0)
    elastic = features.line(forces, 0.6 + 4 * y * (1 - y), np.full(60, 1e-6))
    found = features.settled(elastic)
    assert found.lower < stick * 1.005 and found.upper >= stick * 0.99
    part = features.ratio(features.ridge(elastic), found)
    assert part.lower < 0.5 < part.upper < 0.8
    rigid = features.line(forces, 0.6 + np.where(forces < stick, forces / stick, 0.0), np.full(60, 1e-6))
    part = features.ratio(features.ridge(rigid), features.settled(rigid))
    assert part.lower < 1.0 and part.upper >= 1.0 and part.lower > 0.7


def test_a_line_that_does_not_settle_has_no_sticking_force():
    forces = np.geomspace(10, 1000, 10)
    found = features.settled(features.line(forces, 2 - np.log10(forces) / 3, np.zeros(10)))
    assert found.upper == np.inf


def test_the_numbers_of_both_figures_from_the_command_line(root, tmp_path, campaign):
    """`ema simulate snapback` for Fig. 3; `ema compare` of two records for Fig. 4, accelerations integrated."""
    runner, data = CliRunner(), root / "datasets"
    model = str(data / "double_beam")
    forces = ["--normal-force", "1000", "--normal-force", "8000"]
    done = runner.invoke(app, ["simulate", "snapback", model, *forces, "--output", str(tmp_path / "s"), "--json"])
    assert done.exit_code == 0, done.output
    import json

    low, high = json.loads(done.output)["rows"]
    assert low["x0 [mm]"] / high["x0 [mm]"] == pytest.approx(3.1, abs=0.1)
    assert high["x0 [mm]"] == pytest.approx(1.29, rel=0.02)
    assert low["f stuck [Hz]"] == pytest.approx(31.58, rel=0.01)
    records = [str(data / "double_beam_release" / "raw" / f"{name}_6kN.h5") for name in ("measured", "computed")]
    told = ["--band", "8", "60", "--start", "0.3", "--output", str(tmp_path / "c"), "--json"]
    done = runner.invoke(app, ["compare", *records, *told])
    assert done.exit_code == 0, done.output
    said = " ".join(json.loads(done.output)["verdict"])
    assert "31.58 and 31.58 Hz" in said and "lacks an exponential decay with a damping ratio of 0.097 %" in said
    refused = runner.invoke(app, ["compare", *records])
    assert refused.exit_code != 0 and "--band 8 60" in refused.output
