"""Joint parameters from a damping map with noise, and a model that is measured as a machine was.

The search runs by the command in a process of its own, as users run it, which spares it the shape checker.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema import compare, store
from ema.compare import fitting
from ema.compare.fitting import sound_slopes
from ema.data import Channel, Condition, Damping, Excitation, JointForce, Run
from ema.dof import Dof
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import FrictionRig, Iwan, Masing, RovingHammer, damping_map, double_beam, maps
from tests.bench.joint_maps import ON as DRIVEN
from tests.bench.joint_maps import Host, Springs, closed_form_map
from tests.bench.joint_maps import case as joint_case
from tests.bench.joint_maps import described as resonances_described
from tests.bench.joint_maps import noisy as noisier

AT, OUT = Dof(2, "+Z", "beam 2"), Dof(2, "+Z", "beam 1")
LAW = Masing(0.3, 2e7, stiffness_exponent=0.4)
LEVELS, FORCES = [0.5, 1.0, 2.0], [30.0, 60.0, 120.0, 240.0, 480.0]
BAND = (14.0, 60.0)
FREE = ("friction_coefficient", "contact_stiffness", "stiffness_exponent")


def model(law=LAW, force=300.0):
    return double_beam(law, force, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(ratio=0.006))


def noisy(chart, rng):
    """3 % of damping and 0.05 % of frequency."""
    draws = rng.standard_normal((2, *chart.damping.shape))
    damping, frequency = chart.damping * np.exp(0.03 * draws[0]), chart.frequency * (1 + 5e-4 * draws[1])
    return replace(
        chart, damping=damping, frequency=frequency, damping_std=0.03 * damping, frequency_std=5e-4 * frequency
    )


@pytest.fixture(scope="module")
def exact():
    return damping_map(model(), LEVELS, FORCES, AT, OUT, BAND)


MODEL = """
[model]
name = "double beam"
[structure]
kind = "double beam"
elements = 2
[[joints]]
normal_force = "300 N"
[law]
name = "masing"
friction_coefficient = {mu}
contact_stiffness = "{stiffness} N/m"
stiffness_exponent = {exponent}
[damping]
ratio = "0.6 %"
[map]
force = "1 N"
normal_force = "100 N"
at = "beam 2:2:+Z"
output = "beam 1:2:+Z"
band = ["14 Hz", "60 Hz"]
"""


def updated(chart, folder, start, *options):
    """What `ema compare --update` stores, from a start given as mu, k_T and exponent."""
    mu, stiffness, exponent = start
    (folder / "model.toml").write_text(MODEL.format(mu=mu, stiffness=stiffness, exponent=exponent))
    store.save(folder / "map.h5", chart)
    command = [Path(sys.executable).with_name("ema"), "compare", folder / "map.h5", folder / "model.toml", *options]
    done = subprocess.run([*command, "--output", folder / "out"], capture_output=True, text=True, timeout=500)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return store.load(folder / "out" / "comparison.h5")["update"]


@pytest.fixture(scope="module")
def update(exact, tmp_path_factory):
    chart = noisy(exact, np.random.default_rng(89))
    return updated(chart, tmp_path_factory.mktemp("update"), (0.1, 8e7, 0.0), "--update", ",".join(FREE))


@pytest.mark.slow
def test_joint_parameters_from_a_map_with_noise(update):
    """Bounds of the reference study: mu 10 %, k_T 15 %, exponent 0.1 at 3 % noise."""
    mu, stiffness, exponent = update.values
    assert mu == pytest.approx(0.3, rel=0.10)
    assert stiffness == pytest.approx(2e7, rel=0.15)
    assert exponent == pytest.approx(0.4, abs=0.1)
    assert all(update.identifiable)
    assert update.misfit < 2
    assert update.frequency_ratio == pytest.approx(1, abs=1e-3)
    assert update.model.joints[0].law.contact_stiffness == pytest.approx(stiffness)
    assert update.model.joints[0].law.reference_force == 1000.0


@pytest.mark.slow
def test_the_intervals_hold_the_truth_and_are_of_use(update):
    truth = np.array([0.3, 2e7, 0.4])
    std = (update.intervals[:, 1] - update.intervals[:, 0]) / 3.92
    # of 3 intervals one may miss by chance; none may miss by 5 standard uncertainties
    assert np.all(np.abs(update.values - truth) < 5 * std)
    assert np.all(update.intervals[:2, 1] / update.intervals[:2, 0] < 1.5)


@pytest.mark.slow
def test_with_levels_known_only_relative_to_each_other_mu_is_told_over_the_force_alone(tmp_path):
    chart = noisy(damping_map(model(), LEVELS, FORCES[::2], AT, OUT, BAND), np.random.default_rng(115))
    found = updated(chart, tmp_path, (0.2, 2e7, 0.4), "--update", "friction_coefficient", "--relative-levels")
    assert found.names == ("friction_coefficient", "force_scale")
    assert found.identifiable == (False, False)
    (finding,) = (one for one in found.findings if one.code == "not-identifiable")
    assert "only the ratio of friction_coefficient and force_scale" in finding.message
    assert found.values[0] / found.values[1] == pytest.approx(0.3, rel=0.05)


@pytest.mark.slow
def test_the_updated_model_agrees_and_another_one_does_not(exact, update):
    chart = noisy(exact, np.random.default_rng(125))
    again = compare.measure(update.model, chart, AT, OUT, BAND)
    assert again.method == "frozen"
    assert compare.maps(chart, again).verdict.agrees
    other = compare.measure(model(Masing(0.1, 2e7)), chart, AT, OUT, BAND)
    assert not compare.maps(chart, other).verdict.agrees


def test_a_map_of_fits_is_met_by_fits_of_the_model(exact):
    chart = replace(exact, method="measured")
    fitted = compare.measure(model(), chart, AT, OUT, BAND)
    # a linear fit of a friction peak reads another damping than the energy balance, and a frequency within its width
    ratio = fitted.damping / exact.damping
    assert np.nanmax(np.abs(ratio - 1)) > 0.02
    assert np.all(np.abs(fitted.frequency / exact.frequency - 1) < exact.damping)


def test_a_run_is_replayed_with_its_own_forces():
    """Simulated with another seed and noise, the replay of its forces gives the response without the noise."""
    channel = Channel("tip", OUT, "acceleration", unit="m/s^2")
    truth = model(force=500.0)
    rig = FrictionRig(
        truth,
        RovingHammer((AT,), hits=1, spacing=1.0, contact_time=8e-3),
        (channel,),
        1024.0,
        noise={"acceleration": 1e-3},
    )
    joints = (JointForce("interface", 500.0),)
    run = Run("hit", Condition(Excitation("hammer", 100.0), joints), tuple(rig.takes()))
    again = compare.measure(truth, run)
    (first,) = again.recordings
    measured = run.recordings[0]
    assert first.channels == measured.channels
    assert first.sampling_rate == measured.sampling_rate
    spectra = [np.fft.rfft(one.signals[1])[: int(0.35 * one.signals.shape[1])] for one in (first, measured)]
    # below the second pass of the anti-alias filter: the time solver's tolerance and the front end's noise
    assert np.linalg.norm(spectra[0] - spectra[1]) / np.linalg.norm(spectra[1]) < 0.02
    with pytest.raises(InputError, match="joints of the run and of the model differ"):
        compare.measure(truth, replace(run, condition=Condition(run.condition.excitation)))
    unknown = (JointForce("interface", float("nan")),)
    with pytest.raises(InputError, match="unknown normal force"):
        compare.measure(truth, replace(run, condition=replace(run.condition, joints=unknown)))
    with pytest.raises(InputError, match="without records"):
        compare.measure(truth, replace(run, recordings=()))


def test_bad_input_is_told_in_a_sentence(exact):
    for free, said in (
        (["stiffness"], "unknown parameter"),
        (["exponent"], "the law has no exponent"),
        ([], "not a list of free parameters"),
    ):
        with pytest.raises(InputError, match=said):
            compare.update(model(), exact, free, AT, OUT, BAND)
    with pytest.raises(InputError, match="two DOFs"):
        compare.measure(model(), exact)
    holes = replace(exact, damping=np.full_like(exact.damping, np.nan))
    with pytest.raises(InputError, match="too few points"):
        compare.update(model(), holes, ["friction_coefficient"], AT, OUT, BAND)
    negative = replace(exact, damping=-exact.damping)
    with pytest.raises(InputError, match="not positive"):
        compare.update(model(), negative, ["friction_coefficient"], AT, OUT, BAND)
    twice = replace(exact, joints=("J1", "J2"), joint_forces=np.ones((*exact.damping.shape, 2)))
    with pytest.raises(InputError, match="joints of the map and of the model differ"):
        compare.measure(model(), twice, AT, OUT, BAND)
    lost = replace(exact, normal_forces=np.full(len(FORCES), np.nan), joint_forces=None, joints=())
    with pytest.raises(InputError, match="without normal force"):
        compare.measure(model(), lost, AT, OUT, BAND)


def test_a_peak_that_jumps_within_the_step_is_no_knowledge():
    above, below = np.array([[30.0, 400.0, -5.0, 0.0]]), np.array([[34.0, 20.0, 160.0, 167.0]])
    assert sound_slopes(above, below).tolist() == [[32.0, 20.0, -5.0, 0.0]]


@pytest.fixture
def described(monkeypatch):
    """Resonances of ``Host`` from describing functions in place of the simulator: updates in a second, not a minute.

    Where the band does not hold the resonance its nearer end is returned, as by the simulator. ``tests/bench/updates.py``
    has the simulator itself do the same.
    """
    monkeypatch.setattr(maps, "resonances", resonances_described)


CUT = Host(100.0, 0.005)
CUT_TRUTH = 0.3, 0.2 * CUT.omega**2, 0.0
ONE = Springs(np.ones(1), np.ones(1))


def cut_map():
    """Frequencies 100.07 Hz (slipping) to 109.54 Hz (stuck)."""
    exact = closed_form_map(CUT, ONE, CUT_TRUTH, [1.0, 10.0], [10.0, 30.0, 100.0])
    return noisier(exact, np.random.default_rng(2), 0.02, 2e-4)


def cut_off(found, band):
    """Points whose frequency lies outside the band, by the describing function with the parameters that were found."""
    law = found.model.joints[0].law
    stated = law.friction_coefficient, law.contact_stiffness * (1000 / law.reference_force) ** 0.0, 0.0
    exact = closed_form_map(CUT, ONE, stated, [1.0, 10.0], [10.0, 30.0, 100.0]).frequency
    return int(np.sum((exact < band[0]) | (exact > band[1])))


def check_cut(band):
    start = Masing(0.2, CUT_TRUTH[1])
    found = compare.update(CUT.model(start), cut_map(), FREE[:1], DRIVEN, DRIVEN, band=band)
    count = cut_off(found, band)
    assert 1 <= count < 6
    assert found.identifiable == (False,)
    (finding,) = (one for one in found.findings if one.code == "not-identifiable")
    assert f"the model has no resonance at {count} of 6 points" in finding.message
    # two data of every lost point, five standard deviations each; 12 data, one parameter and the common ratio
    assert found.misfit > np.sqrt(2 * count * 25 / 10)


def test_a_measured_model_has_holes_where_the_band_cuts_off_its_resonance():
    """By the describing function the frequencies are 108.2, 109.4, 109.5 Hz (1 N) and 100.1, 102.3, 108.2 Hz (10 N)."""
    chart = cut_map()
    model = CUT.model(Masing(CUT_TRUTH[0], CUT_TRUTH[1]))
    again = compare.measure(model, chart, DRIVEN, DRIVEN, (99.0, 109.0))
    assert np.isnan(again.damping).tolist() == np.isnan(again.frequency).tolist() == [[False, True, True], [False] * 3]
    (finding,) = again.findings
    assert finding.code == "no-resonance" and "at 2 of 6 points" in finding.message
    assert "no resonance at 2" in str(compare.maps(chart, again).verdict)


def test_points_at_which_the_model_has_no_resonance_are_counted(described):
    """The stuck points lie at 109.4 and 109.5 Hz, those between near 108.2 Hz."""
    check_cut((96.0, 109.0))
    check_cut((101.0, 114.0))
    whole = compare.update(CUT.model(Masing(0.2, CUT_TRUTH[1])), cut_map(), FREE[:1], DRIVEN, DRIVEN)
    assert whole.identifiable == (True,) and whole.misfit < 2


def test_a_search_that_has_not_settled_is_named(described, monkeypatch):
    """One step from a place that is several standard deviations away, where the next one may lead anywhere."""
    monkeypatch.setattr(fitting.MapProblem, "optimum", lambda problem, values, bias: values + 0.3)
    monkeypatch.setattr(fitting, "_REFINED", 1)
    found = compare.update(CUT.model(Masing(0.2, CUT_TRUTH[1])), cut_map(), FREE[:1], DRIVEN, DRIVEN)
    assert found.identifiable == (False,)
    (finding,) = (one for one in found.findings if one.code == "not-identifiable")
    assert "the search has not settled" in finding.message


def test_joint_parameters_from_a_closed_form_map_with_noise(described):
    """The map is that of a describing function, of which the model that is fitted knows nothing; bounds as above."""
    host = Host(499.0, 0.00638)
    truth = 0.3, 0.05 * host.omega**2, 0.4
    forces = [12.0, 30.0, 75.0, 180.0, 450.0]
    exact = closed_form_map(host, Springs(np.ones(1), np.ones(1)), truth, [10.0, 40.0], forces)
    found = compare.update(
        host.model(Masing(0.1, 4 * truth[1])), noisy(exact, np.random.default_rng(1)), FREE, DRIVEN, DRIVEN
    )
    assert found.values[0] == pytest.approx(truth[0], rel=0.10)
    assert found.values[1] == pytest.approx(truth[1], rel=0.15)
    assert found.values[2] == pytest.approx(truth[2], abs=0.1)
    assert all(found.identifiable)


@pytest.mark.parametrize("number", [0, 1, 3])
def test_other_forces_are_predicted_from_a_map(described, number):
    """A joint of one spring, one of many, and one whose mu falls with the normal force, all fitted with the law of one
    spring, at forces up to twice those of the map.

    Bands of one joint lie to the same side of the truth at all conditions: of 24, a right one misses some now and then.
    ``tests/bench/joint_maps.py`` counts over many joints.
    """
    one = joint_case(12, number)
    found = one.updated()
    rows = one.predicted(found)
    assert len(rows) == 36
    for name, widest in (("damping", 0.3), ("frequency", 0.01)):
        assert np.mean([row[name] for row in rows]) >= 0.8
        assert np.median([row[f"{name} half"] for row in rows]) < widest
        assert np.median(np.abs([row[f"{name} error"] for row in rows])) < widest / 3


def test_a_prediction_says_how_far_outside_the_map_it_is(described):
    found = compare.update(CUT.model(Masing(0.2, CUT_TRUTH[1])), cut_map(), FREE[:1], DRIVEN, DRIVEN, (90.0, 120.0))
    wide = {"at": DRIVEN, "output": DRIVEN, "band": (90.0, 120.0)}
    inside = compare.predict_map(found, cut_map(), [2.0, 5.0], [20.0], **wide)
    assert inside.statement == "All conditions lie within the range of the map."
    assert inside.findings == found.findings
    far = compare.predict_map(found, cut_map(), [0.1, 10.0], [300.0], **wide)
    assert far.statement == (
        "The lowest force level is the lowest measured one over 10; "
        "the highest normal force is 3 times the highest measured one."
    )
    assert [one.code for one in far.findings[len(found.findings) :]] == ["far-outside-the-data"] * 2
    cut = compare.predict_map(found, cut_map(), [1.0], [10.0, 100.0], at=DRIVEN, output=DRIVEN, band=(99.0, 109.0))
    assert np.isfinite(cut.damping).tolist() == np.isfinite(cut.frequency_low).tolist() == [[True, False]]
    assert "no-resonance" in {one.code for one in cut.findings}
    with pytest.raises(InputError, match="not a normal force to predict at"):
        compare.predict_map(found, cut_map(), [1.0], [0.0], **wide)


@pytest.mark.parametrize("chi", [0.4, 0.0])
def test_low_levels_of_one_normal_force_are_not_taken_for_knowledge_of_the_joint(described, chi):
    """Four levels of a power-law joint in microslip, noise 1 %, fitted with another power (the default of `iwan`).

    The law fits these levels within some per cent and misses the damping of the next but one by 30 to 50 %: what it says
    of mu and k_T has to contain that.
    """
    host, phi = Host(169.0, 0.0015), (np.arange(60) + 0.5) / 60
    slip = phi ** (2 + chi)
    springs = Springs(phi ** (1 + chi) / np.sum(phi ** (1 + chi)), slip / slip.sum())
    truth = 0.4, 0.25 * host.omega**2, 0.0
    levels = []
    for ratio in np.geomspace(0.05, 0.4, 6)[:4]:  # amplitude over that at which a spring of k_T slips
        amplitude = ratio * truth[0] * 1000.0 / truth[1]
        elastic, lost = springs.describing(truth[1], truth[0] * 1000.0, amplitude)
        background = 2 * host.ratio * np.sqrt(host.omega**2 + truth[1]) * np.sqrt(host.omega**2 + elastic)
        levels.append(amplitude * (lost + background))
    chart = noisier(closed_form_map(host, springs, truth, levels, [1000.0]), np.random.default_rng(3), 0.01, 2e-5)
    found = compare.update(host.model(Iwan(0.2, 2 * truth[1])), chart, FREE[:2], DRIVEN, DRIVEN)
    assert found.identifiable == (False, False)
    assert np.all((found.intervals[:, 0] <= truth[:2]) & (truth[:2] <= found.intervals[:, 1]))
    assert "not-identifiable" in {finding.code for finding in found.findings}


@pytest.mark.parametrize(("number", "determined"), [(1, True), (2, False)])
def test_the_law_of_a_model_is_not_taken_for_that_of_the_joint(described, number, determined):
    """Joints of many and of three springs, in closed form, fitted with the law of one spring.

    mu is the slip force of all springs over F_N and k_T their stiffness. The first map reaches from sticking to slip and
    determines both whatever the law; taken as exact, the law of one spring misses k_T by seven standard uncertainties.
    The second one it does not explain, and misses mu by a factor of three.
    """
    one = joint_case(11, number)
    found = compare.update(one.model, one.chart, FREE, DRIVEN, DRIVEN)
    held = (found.intervals[:, 0] <= one.truth) & (one.truth <= found.intervals[:, 1])
    assert held.all()
    assert found.identifiable == (determined,) * 3
    assert ("law-form" in {finding.code for finding in found.findings}) != determined
    assert "model-misfit" in {finding.code for finding in found.findings}


@pytest.mark.parametrize(("soft", "late"), [(0.06, 0.45), (0.1, 0.6)])
def test_what_a_soft_spring_carries_that_slips_at_no_load_is_not_taken_for_known(described, soft, late):
    """A stiff spring beside a soft one that sticks at all points: the map says nothing of what the soft one may carry.

    The law of one spring explains the map, and finds the mu of the stiff spring alone.
    """
    host, springs = Host(100.0, 0.003), Springs(np.array([1 - soft, soft]), np.array([1 - late, late]))
    truth, levels, forces = (0.4, 0.1 * host.omega**2, 0.3), [0.7, 2.0, 5.0], [10.0, 25.0, 60.0]
    exact = closed_form_map(host, springs, truth, levels, forces)
    stiffness = truth[1] * (np.array(forces) / 1000) ** truth[2]
    amplitude = exact.force_levels[:, None] / (2 * exact.damping * (2 * np.pi * exact.frequency) ** 2)
    assert np.all(amplitude * soft * stiffness < late * truth[0] * np.array(forces))  # the soft one sticks
    assert np.any(amplitude * (1 - soft) * stiffness > 3 * (1 - late) * truth[0] * np.array(forces))
    chart = noisier(exact, np.random.default_rng(7), 0.02, 3e-4)
    found = compare.update(host.model(Masing(0.2, 2 * truth[1])), chart, FREE, DRIVEN, DRIVEN)
    low, high = found.intervals[0]
    assert low < (1 - late) * truth[0] * 1.1
    assert high > truth[0]
