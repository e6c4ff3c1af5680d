"""The work table with its shaker: from raw signals to Figs. 8 and 9 of Gaul, Roseira and Becker (2008).

Statements and verdicts are those of ``reports/work_table_*.toml``; the numbers asserted here are regressions of an
assumed model, for the paper gives neither dimensions nor contact parameters.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import acquisition
from ema import estimate, fit
from ema.data import Condition, Run
from ema.datasets import work_table, work_table_shaker
from ema.dof import Dof
from ema.simulate import FrictionRig, SteppedSine, SweptShaker, damping_map, frf
from ema.simulate.reduction import modal_base
from ema.simulate.structure import assemble
from ema.study import Study, recipe
from ema.study.measured import frfs_of
from tests.validation.recipes import run_recipe

pytestmark = pytest.mark.timeout(1200)  # recipes are run within tests

SETTINGS = {
    "hammer": work_table.CENTRE,
    "absorber": work_table.ABSORBER,
    "bending": work_table.BENDING,
    "rough": work_table.ROUGH,
}


@pytest.fixture(scope="module")
def mapped(root, demonstration, tmp_path_factory):
    """Campaign, settings and result of a recipe by its name, run once; of three reports with maps one is drawn."""

    @cache
    def run(name):
        path = root / "reports" / f"work_table_{name}.toml"
        demonstration(f"work_table_{name}")
        result = run_recipe(path, tmp_path_factory.mktemp(name), drawn=name == "absorber")
        study = Study.load(path)
        return study.open(), study.recipe, result

    return run


@pytest.fixture(scope="module")
def absorber(mapped):
    return mapped("absorber")


@pytest.fixture(scope="module")
def bending(mapped):
    return mapped("bending")


@pytest.fixture(scope="module")
def rough(mapped):
    return mapped("rough")


@pytest.mark.parametrize("name", SETTINGS)
def test_the_model_file_is_the_truth_behind_the_signals(root, name):
    setting = SETTINGS[name]
    points = work_table.grid() if name == "hammer" else work_table.shaker_points(setting)
    written, truth = (
        modal_base(assemble(model))
        for model in (
            acquisition.open_model(root / "datasets" / f"work_table_{name}").with_normal_force(777.0),
            work_table.with_beam(setting, 777.0, points),
        )
    )
    assert written.frequencies[:12] == pytest.approx(truth.frequencies[:12], rel=1e-5)
    assert written.decay[:12] == pytest.approx(truth.decay[:12], rel=1e-5)


@pytest.mark.parametrize("name", ["absorber", "bending", "rough"])
def test_the_campaign_file_names_every_run_of_the_plan(root, name):
    from acquisition import campaign_file

    described = {run.id: run for run in campaign_file.load(root / "datasets" / f"work_table_{name}").runs}
    for one in work_table_shaker.plan((3,) if name == "rough" else (1, 3)):
        run = described.pop(one.run)
        assert run.level == f"{one.level:g} N"
        assert [joint.nominal for joint in run.normal_force] == [f"{one.force:g} N"] * 2
        assert {joint.sequence for joint in run.normal_force} == {one.sequence}
    assert set(described) <= {"bare", "dead_mass", "chirp_1s", "chirp_16s"}


@pytest.mark.parametrize("name", ["absorber", "bending", "rough"])
def test_every_statement_gets_the_verdict_that_the_recipe_states(mapped, name):
    judged = mapped(name)[2].statements
    assert len(judged) == len(mapped(name)[1].statements) >= 5
    assert [
        f"{one.text}: {one.verdict}, {one.value:.4g} ({one.lower:.4g} to {one.upper:.4g})"
        for one in judged
        if not one.met
    ] == []
    assert {one.quoted for one in judged} == {True, False}


def test_the_paper_sentences_that_the_sliding_beam_does_not_show(absorber):
    """The points themselves, without the rules for ridges and dips.

    "The eigenfrequency drops when the modal damping rises": at 6, 10 and 15 N the frequency at the normal force of most
    damping is the highest of its row. "As in the mode 1 case, the eigenfrequency decreases in the high modal damping
    interval": that of mode 3 is higher at 600 N, where the damping is highest, than at 300 and 1000 N, but no other
    point shows that peak. "The modal
    damping increases until F_E = 30 N": it is highest at 25 N, at 100 N and of all normal forces, and 30 N lies within two
    standard deviations. The
    ridge of mode 1 moves from 60 to 100 N, from one normal force to the next: whether it rises the grid cannot tell.
    At 25 N of normal force the damping reaches 0.78 %, and two standard deviations more than 0.80 %; at 100 N and 30 N
    it is 1.72 %, and two standard deviations less are below 1.7 %.
    """
    one, three = (one.chart for one in absorber[2].maps)
    forces, levels = list(one.normal_forces), list(one.force_levels)
    best = one.damping.argmax(axis=1)
    assert [int(row.argmax()) == top for row, top in zip(one.frequency, best, strict=True)][:3] == [True] * 3
    assert sorted({forces[top] for top in best}) == [60, 100]
    assert levels[int(one.damping.max(axis=1).argmax())] == 25
    k = list(three.normal_forces).index(600)
    assert np.all(three.damping.argmax(axis=1) == k)
    assert np.all(three.frequency[:, k] > three.frequency[:, [k - 1, k + 1]].max(axis=1) + 3)
    at_100, std = one.damping[:, forces.index(100)], one.damping_std[:, forces.index(100)]
    row = levels.index(30)
    assert levels[int(at_100.argmax())] == 25
    assert at_100.max() - at_100[row] < 2 * np.hypot(std[row], std[levels.index(25)])
    assert at_100[row] - 2 * std[row] < 0.017 < at_100[row]
    low, low_std = one.damping[:, forces.index(25)], one.damping_std[:, forces.index(25)]
    assert low.max() < 0.008 < np.max(low + 2.7 * low_std)


def test_the_peak_of_mode_3_with_the_sliding_beam_lies_between_two_normal_forces(absorber):
    """By steady states of the model, without points or rules: between 600 and 1000 N, where the joints stick and a mode of
    the beam on its contacts crosses mode 3, the larger of two peaks of the response has 1.09 % at 660 N and 0.91 % at
    700 N, at 975 and 985 Hz, below the 994 Hz at 300 N and the 1013 Hz at 12 kN. That at most 0.78 % can lie between the
    points, that 1 % is not reached and that the frequency does not dip, which the verdicts once were, is wrong."""
    forces = [300.0, 600.0, 660.0, 700.0, 1000.0, 12000.0]
    steady = damping_map(work_table.with_beam(work_table.ABSORBER, 100.0), [6.0], forces, AT, AT, (940, 1060), 5e-3)
    damping, frequency = 100 * steady.damping[0], steady.frequency[0]
    chart = absorber[2].maps[1].chart
    rows = [list(chart.normal_forces).index(force) for force in (300, 600, 1000, 12000)]
    assert damping[[0, 1, 4, 5]] == pytest.approx(100 * chart.damping[0, rows], rel=0.01)
    assert damping[2] > 1.0 and damping[3] > 0.85
    assert np.all(frequency[[2, 3]] < min(frequency[0], frequency[-1]) - 5)
    judged = {one.text: one for one in absorber[2].statements}
    reached = judged["the damping of mode 3 reaches 1 %"]
    dips = judged["at every level the frequency of mode 3 at its ridge lies below both sides of it, Hz"]
    assert reached.verdict == dips.verdict == "undecided"
    assert reached.lower < damping[2] < reached.upper


def test_what_the_grids_of_bending_slip_and_rough_joints_leave_open(bending, rough):
    """The points themselves: 30 and 35 N are within two standard deviations of each other at 100 N of normal force; mode 3
    has its most damping at 100 N, the lowest normal force of its map, so its ridge may lie below; with rough joints it
    has it at 2 kN, and the next normal forces are 1.5 and 4 kN, beyond 2.5 kN."""
    one, three = (one.chart for one in bending[2].maps)
    column, levels = list(one.normal_forces).index(100), list(one.force_levels)
    a, b = levels.index(30), levels.index(35)
    std = np.hypot(one.damping_std[a, column], one.damping_std[b, column])
    assert abs(one.damping[a, column] - one.damping[b, column]) < 2 * std
    assert np.all(three.damping.argmax(axis=1) == 0)
    rough_forces = list(rough[2].maps[0].chart.normal_forces)
    assert np.all(rough[2].maps[0].chart.damping.argmax(axis=1) == rough_forces.index(2000))
    assert rough_forces[rough_forces.index(2000) + 1] == 4000


def along(axis, values):
    """The axis at the vertex of the parabola through the highest point and its neighbours."""
    k = int(np.clip(np.argmax(values), 1, len(axis) - 2))
    curve = np.polyfit(axis[k - 1 : k + 2], values[k - 1 : k + 2], 2)
    return -curve[1] / curve[0] / 2


AT = f"{work_table.DRIVE_NODE}:+Z"


def test_at_100_n_the_damping_of_the_sliding_beam_is_highest_at_30_n_and_falls_after_it(absorber):
    """At 30 N within 5 N, 1.9 % within 0.2 %, at 40 N a tenth lower or more: by steady states of the model at a constant
    force, every newton, and by the points measured, whose steps of 5 N reach the lower end of it."""
    levels = np.arange(20.0, 41.0)
    model = work_table.with_beam(work_table.ABSORBER, 100.0)
    damping = 100 * damping_map(model, levels, [100.0], AT, AT, (450, 530), 5e-3).damping[:, 0]
    assert 25 < along(levels, damping) < 35
    assert damping.max() == pytest.approx(1.9, abs=0.2)
    assert damping[-1] < 0.9 * damping.max()
    chart = absorber[2].maps[0].chart
    at_100, tested = 100 * chart.damping[:, list(chart.normal_forces).index(100)], list(chart.force_levels)
    assert tested[int(at_100.argmax())] == pytest.approx(30, abs=5)
    assert at_100.max() == pytest.approx(1.9, abs=0.2)
    assert at_100[tested.index(40)] < 0.9 * at_100.max()


def test_low_and_high_normal_forces_leave_the_damping_of_the_sliding_beam_low(absorber):
    chart = absorber[2].maps[0].chart
    damping, forces = 100 * chart.damping, list(chart.normal_forces)
    assert damping[:, : forces.index(25) + 1].max() <= 0.80
    assert damping[:, forces.index(300)].max() <= 0.66
    best = [forces[int(row.argmax())] for row in damping]
    assert np.all(np.diff(best) >= 0) and best[-1] > best[0]


@pytest.mark.parametrize("name", ["absorber", "bending"])
def test_both_hypotheses_end_at_495_hz(mapped, name):
    assert mapped(name)[2].maps[0].chart.frequency[:, -1] == pytest.approx(495, abs=1)


def test_the_frequency_on_the_ridge_of_the_sliding_beam_is_lowest_at_25_n(absorber):
    """Asked was a lowest frequency on the ridge of 486 to 491 Hz, 4 Hz or more below that with sticking joints (494.3 Hz).
    The ridge, the normal force of most damping at each level, is at 60 N for 6 to 15 N and at 100 N for 20 to 40 N. Its
    lowest frequency is 488.1 Hz, by 6 Hz below. As a statement on the ridge of every level it is wrong: steady states of
    the model, which share no step with the measured map, give 499.5 to 502.0 Hz on the ridge at 10 and 15 N and 493 to
    495 Hz at 30 to 40 N, so that the frequency lies above that of sticking joints at low levels, and within 2 Hz of it
    at high ones."""
    chart = absorber[2].maps[0].chart
    rows, best = np.arange(len(chart.force_levels)), chart.damping.argmax(axis=1)
    assert chart.normal_forces[best].tolist() == [60, 60, 60, 100, 100, 100, 100, 100]
    ridge, stuck = chart.frequency[rows, best], chart.frequency[:, -1]
    assert 486 < ridge.min() < 491 and stuck.min() - ridge.min() >= 4
    assert np.all(ridge[:3] > stuck[:3] + 4), "it rises where the beam slides as an absorber"
    levels, forces = np.array([10.0, 15.0, 30.0, 35.0, 40.0]), np.array([40.0, 60.0, 80.0, 100.0, 120.0, 150.0])
    steady = damping_map(work_table.with_beam(work_table.ABSORBER, 100.0), levels, forces, AT, AT, (450, 530), 5e-3)
    there = steady.frequency[np.arange(5), np.nanargmax(steady.damping, axis=1)]
    assert np.all((there[:2] > 499) & (there[:2] < 503))
    assert np.all((there[2:] > 492.5) & (there[2:] < 495.5))


def test_mode_3_with_rough_joints(rough):
    """The ridge at 1.5 to 2.5 kN, at least ten times that of mode 1 with the same joints (100 N, by steady states: the
    campaign has no map of it); the frequency ends at 1004 to 1018 Hz; it dips by 1 Hz or more; the level changes the
    damping by less than 5 % at every normal force, and by steady states not at all: the joints stick."""
    chart = rough[2].maps[0].chart
    forces = list(chart.normal_forces)
    best = forces[int(np.nanmax(chart.damping, axis=0).argmax())]
    assert 1500 <= best <= 2500
    model, levels = work_table.with_beam(work_table.ROUGH, 100.0), [6.0, 20.0, 40.0]
    one = damping_map(model, levels, [10.0, 30.0, 60.0, 100.0, 200.0, 400.0, 1000.0], AT, AT, (450, 530), 5e-3)
    assert set(one.normal_forces[np.nanargmax(one.damping, axis=1)]) == {100.0}
    assert best >= 10 * 100.0
    assert np.all((chart.frequency[:, -1] > 1004) & (chart.frequency[:, -1] < 1018))
    before, after = forces.index(1500), forces.index(4000)
    assert chart.frequency[0, before] - chart.frequency[0, after] >= 1
    assert np.max(np.ptp(chart.damping, axis=0) / chart.damping.mean(axis=0)) < 0.05
    three = damping_map(model, levels, [1500.0, 2000.0, 2500.0, 4000.0], AT, AT, (940, 1060), 5e-3)
    assert np.max(np.ptp(three.damping, axis=0) / three.damping.mean(axis=0)) < 1e-3
    assert three.normal_forces[three.damping[0].argmax()] == 2000.0


def test_every_point_has_its_force_at_resonance_amplitude_and_interval(absorber):
    result = absorber[2].maps[0]
    chart = result.chart
    assert chart.damping.shape == (8, 7) and np.isfinite(chart.damping).all()
    assert np.all(chart.damping_std > 0) and np.all(chart.frequency_std > 0)
    # the coil keeps its force; what reaches the table drops where the damping is low, and hardly where it is high
    assert result.dropout[:, -1] == pytest.approx(0.945, abs=0.015)
    assert result.dropout[5, 3] > 0.97
    stuck = chart.modal_amplitude[:, -1] / chart.force_at_resonance[:, -1]
    assert stuck == pytest.approx(stuck[0], rel=2e-3), "a stuck joint is linear"
    assert chart.quadrature_damping[5, 3] == pytest.approx(chart.damping[5, 3], rel=0.15)
    assert chart.misfit[5, 3] > 0.10 > 0.02 > chart.misfit[:, -1].max()


def test_the_gate_tells_the_side_of_the_most_damping(absorber):
    result = absorber[2].maps[0]
    at = {force: result.pairs[:, 0] == force for force in result.chart.normal_forces}
    assert result.homogeneity[at[1200.0]].max() < 0.01
    assert result.homogeneity[at[100.0]].max() > 0.3
    assert np.all(result.peak_ratio[at[150.0]][-2:] < 0.98), "sticks at the lower level"
    assert result.peak_ratio[at[60.0]][-1] > 1.02, "slips"
    codes = {finding.code for finding in result.findings}
    assert {"not-homogeneous", "misfit", "sequence", "normal-force-drift"} <= codes


def test_ring_cells_keep_every_joint_and_their_drift(absorber):
    campaign = absorber[0]
    for one in work_table_shaker.plan((1,)):
        middle = 0.5 * (one.begins + one.ends)
        truth = work_table_shaker.pressed(one, middle)[:, 0]
        joints = campaign[one.run].condition.joints
        assert [joint.joint for joint in joints] == ["J1", "J2"]
        assert [joint.mean for joint in joints] == pytest.approx(list(truth), rel=0.01)
        assert joints[0].sequence == one.sequence
    drifting = [run.id for run in campaign.runs if any(f.code == "normal-force-drift" for f in run.findings)]
    assert drifting == ["mode1_FE06_FN00005"]


def test_the_mass_below_the_load_cell_is_taken_off(absorber):
    campaign = absorber[0]
    found = [
        fit.local_fit(frfs_of(campaign["bare"], recipe.EstimateTable(mount_mass=mass))[0], 499.0)
        for mass in (work_table_shaker.SHAKER.mount_mass, 0.0)
    ]
    assert found[0].natural_frequency == pytest.approx(499.0, abs=0.02)
    assert 100 * found[0].damping_ratio == pytest.approx(0.638, abs=0.003)
    assert found[1].natural_frequency < 498.8


def test_the_dead_mass_lowers_the_frequency_as_the_sliding_beam_does(absorber):
    campaign = absorber[0]
    settings = recipe.EstimateTable(mount_mass=work_table_shaker.SHAKER.mount_mass)
    mass_only = fit.local_fit(frfs_of(campaign["dead_mass"], settings)[0], 493.0)
    place = work_table.bare(dict(enumerate(work_table.ABSORBER.places, 1)))
    shapes = np.real(place.shapes[:, 3])
    assert place.natural_frequencies[3] == pytest.approx(499.0)
    predicted = 499.0 * (1 - 0.5 * work_table.ABSORBER.mass / 2 * np.sum(shapes**2))
    assert mass_only.natural_frequency - 499 == pytest.approx(predicted - 499, rel=0.3)
    assert absorber[2].maps[0].chart.frequency[-1, 0] == pytest.approx(mass_only.natural_frequency, abs=3)


def test_a_fast_sweep_says_that_it_is_too_fast(absorber):
    campaign, told, _ = absorber
    slow, fast = campaign["chirp_16s"], campaign["chirp_1s"]
    frfs = [frfs_of(run, told.estimate)[0] for run in (slow, fast)]
    assert len(frfs[0].frequencies) > 10 * len(frfs[1].frequencies)
    found = fit.local_fit(frfs[0].band(440, 540), 491.0)
    for run, held in zip((slow, fast), (found, found), strict=True):
        rate, limit, findings = estimate.sweep_rate(
            run.recordings[0], held.natural_frequency, held.damping_ratio, friction=True, periodic=True
        )
        assert rate == pytest.approx(650 / run.condition.excitation.period, rel=0.1)
        assert bool(findings) == (rate > limit)
    assert findings[0].code == "sweep-rate" and "sign of the error" in findings[0].message


def damping_of_steady_states(model, like, forces):
    """What the fit of the recipe reads from steady states under the force amplitudes ``forces`` N of every line."""
    at = f"{work_table.DRIVE_NODE}:+Z"
    outputs = [at, f"{work_table.SENSOR_NODE}:+Z"]
    values = []
    for frequency, force in zip(like.frequencies, forces, strict=True):
        moved = frf(model, np.array([frequency]), float(force), at, outputs).values[0, :, 0]
        values.append(-((2 * np.pi * frequency) ** 2) * moved / force)
    return fit.local_fit(replace(like, values=np.array(values)[:, :, None]), 491.0).damping_ratio


def swept(rate):
    """Damping read from the second period of a sweep from 440 to 560 Hz with ``rate`` Hz/s."""
    period = 120.0 / rate
    level, at = work_table_shaker.CHIRP_LEVEL, Dof(work_table.DRIVE_NODE, "+Z")
    drive = SweptShaker(at, level, (440.0, 560.0), period, 2 * period, sweeps=2)
    model = work_table.with_beam(work_table.ABSORBER, work_table_shaker.CHIRP_FORCE)
    record = FrictionRig(model, drive, work_table_shaker._sensors(), work_table_shaker.SAMPLING_RATE).take(0)
    run = Run("sweep", Condition(replace(drive.excitation, period=period)), (record,))
    return fit.local_fit(estimate.sweep(run).band(462, 526), 491.0).damping_ratio


def test_a_sweep_reads_the_damping_of_the_steady_states_as_its_rate_falls(absorber):
    """A sweep of 16 s, 40 Hz/s, was to read what steady states at the same force do, within 2 %, as it does for one
    oscillator. It reads 5 % more: integrated in time with 40, 20 and 10 Hz/s the excess is 5.1, 2.9 and 1.7 %, so it is
    the rate. The limit for linear sweeps, 216 f^2 zeta^2 Hz/min, allows 250 Hz/s at this damping."""
    campaign, told, result = absorber
    found = fit.local_fit(frfs_of(campaign["chirp_16s"], told.estimate)[0].band(440, 540), 491.0)
    stepped = frfs_of(campaign["mode1_FE30_FN00100"], told.estimate)[0]
    model = work_table.with_beam(work_table.ABSORBER, work_table_shaker.CHIRP_FORCE)
    levels = np.full(len(stepped.frequencies), work_table_shaker.CHIRP_LEVEL)
    steady = damping_of_steady_states(model, stepped, levels)
    excess = np.array([swept(rate) / steady - 1 for rate in (40.0, 20.0, 10.0)])
    assert np.all(np.diff(excess) < 0) and 0 < excess[-1] < 0.02
    assert excess[0] == pytest.approx(0.05, abs=0.01)
    assert found.damping_ratio / steady - 1 == pytest.approx(excess[0], abs=0.01)
    # the stepped sine keeps the force of its coil: what reaches the table changes along the resonance, and the fit
    # of one mode then reads less
    assert result.maps[0].chart.damping[5, 3] < 0.92 * steady
    reached = forces_on_the_table(campaign["mode1_FE30_FN00100"].recordings[0], stepped.frequencies)
    assert np.ptp(reached) > 3
    explained = damping_of_steady_states(model, stepped, reached)
    assert explained == pytest.approx(result.maps[0].chart.damping[5, 3], rel=0.03)


def forces_on_the_table(record, frequencies):
    """Amplitudes in N: the load cell without what the mass below it takes, at every stay of a stepped sine."""
    force = record.signals[0] - work_table_shaker.SHAKER.mount_mass * record.signals[1]
    stays = force.reshape(len(frequencies), -1)
    times = np.arange(stays.shape[1]) / record.sampling_rate
    waves = [np.exp(2j * np.pi * frequency * times) for frequency in frequencies]
    return [
        float(np.hypot(*np.linalg.lstsq(np.column_stack([wave.real, wave.imag]), stay, rcond=None)[0]))
        for wave, stay in zip(waves, stays, strict=True)
    ]


def test_twice_the_excitation_moves_the_ridge_of_bending_slip():
    """Asked was twice the normal force at 30 as at 15 N, within 0.4. With a contact stiffness that does not depend on the
    normal force it is twice, exactly: every motion under (c F_E, c F_N) is c times that under (F_E, F_N). Here it grows
    with F_N^0.3, and the damping has two maxima over F_N, one for each joint: either moves by 2.0, but which of them is
    higher changes, and the highest point of all moves by about four. It never falls with the level."""
    forces = np.geomspace(15, 160, 21)
    model = work_table.with_beam(work_table.BENDING, 100.0)
    levels = np.array([15.0, 20.0, 25.0, 30.0])
    damping = damping_map(model, levels, forces, AT, AT, (465, 525), 5e-3).damping

    def summits(row):
        inner = np.flatnonzero((row[1:-1] > row[:-2]) & (row[1:-1] > row[2:])) + 1
        return np.exp([along(np.log(forces[k - 1 : k + 2]), row[k - 1 : k + 2]) for k in inner])

    lower, higher = summits(damping[0]), summits(damping[-1])
    assert len(lower) == len(higher) == 2
    assert higher / lower == pytest.approx(2.0, abs=0.4)
    ridge = np.exp([along(np.log(forces), row) for row in damping])
    assert np.all(np.diff(ridge) > 0)
    assert ridge[-1] / ridge[0] == pytest.approx(4.0, abs=0.4)
    law = replace(work_table.BENDING.law, stiffness_exponent=0.0, contact_stiffness=2e8)
    constant = work_table.with_beam(replace(work_table.BENDING, law=law, normal_exponent=0.0), 100.0)
    steps = 18.0 * 2.0 ** (np.arange(13) / 4)
    rows = damping_map(constant, np.array([15.0, 30.0]), steps, AT, AT, (465, 525), 5e-3).damping
    assert rows[1, 4:] == pytest.approx(rows[0, :-4], rel=1e-3)
    assert steps[rows[1].argmax()] == pytest.approx(2 * steps[rows[0].argmax()])


def stepped_at(normal_force, command, seed):
    """Frequencies and force in N on the table of a stepped sine whose coil is given ``command`` N, and its resonance."""
    drive = SteppedSine(
        Dof(work_table.DRIVE_NODE, "+Z"),
        command,
        work_table_shaker.MODE_1,
        work_table_shaker.STAY,
        shaker=work_table_shaker.SHAKER,
    )
    rig = FrictionRig(
        work_table.with_beam(work_table.ABSORBER, normal_force),
        drive,
        work_table_shaker._sensors(),
        work_table_shaker.SAMPLING_RATE,
        noise={"acceleration": 0.02, "force": 0.02},
        seed=seed,
    )
    takes = list(rig.takes())
    whole = replace(takes[0], signals=np.hstack([take.signals for take in takes]))
    lines = np.array(work_table_shaker.MODE_1)
    reached = np.array(forces_on_the_table(whole, lines))
    run = Run("level", Condition(replace(drive.excitation, period=work_table_shaker.STAY)), (whole,))
    frfs, _ = estimate.stepped_test(run)
    frfs = estimate.without_mount_mass(frfs, work_table_shaker.SHAKER.mount_mass, frfs.inputs[0])
    return lines, reached, float(lines[np.abs(frfs.values[:, 0, 0]).argmax()])


@pytest.mark.parametrize("normal_force", [25.0, 60.0, 100.0, 150.0, 1200.0])
@pytest.mark.parametrize("target", [10.0, 30.0])
def test_the_force_level_at_resonance_is_reached_where_joints_slip(normal_force, target):
    """Within 5 % in six measurements or fewer, with the shaker, the friction and the noise of the campaign; a measurement
    of its own, with other noise, confirms it. One command for all lines cannot hold the force around the resonance:
    within three half-power widths to either side, 10 Hz, it is off by up to a quarter, as without control: the shaker gives less
    where the table moves more. That would take a command for every line."""
    count = iter(range(1, 99))

    def level(command):
        lines, reached, top = stepped_at(normal_force, command, next(count))
        return float(np.interp(top, lines, reached))

    command, levels = estimate.control_level(level, target)
    assert len(levels) <= 6
    lines, reached, top = stepped_at(normal_force, command, next(count))
    assert np.interp(top, lines, reached) == pytest.approx(target, rel=0.05)
    around = reached[np.abs(lines - top) <= 10.0]
    assert np.abs(around / target - 1).max() < 0.3
