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
from ema.compare.fitting import sound_slopes
from ema.data import (
    BeamModel,
    Channel,
    Condition,
    Damping,
    Excitation,
    Joint,
    JointForce,
    Matrices,
    ModalMap,
    Run,
)
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import FrictionRig, Masing, RovingHammer, damping_map, double_beam

AT, OUT = Dof(2, "+Z", "beam 2"), Dof(2, "+Z", "beam 1")
LAW = Masing(0.3, 2e7, stiffness_exponent=0.4)
LEVELS, FORCES = [0.5, 1.0, 2.0], [30.0, 60.0, 120.0, 240.0, 480.0]
BAND = (14.0, 60.0)
FREE = ("friction_coefficient", "contact_stiffness", "stiffness_exponent")


def model(law=LAW, force=300.0):
    return double_beam(law, force, elements=2, damping=Damping(ratio=0.006))


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
    done = subprocess.run([*command, "--out", folder / "out"], capture_output=True, text=True, timeout=500)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return store.load(folder / "out" / "comparison.h5")["update"]


@pytest.fixture(scope="module")
def update(exact, tmp_path_factory):
    chart = noisy(exact, np.random.default_rng())
    return updated(chart, tmp_path_factory.mktemp("update"), (0.1, 8e7, 0.0), "--update", ",".join(FREE))


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


def test_the_intervals_hold_the_truth_and_are_of_use(update):
    truth = np.array([0.3, 2e7, 0.4])
    std = (update.intervals[:, 1] - update.intervals[:, 0]) / 3.92
    # of 3 intervals one may miss by chance; none may miss by 5 standard uncertainties
    assert np.all(np.abs(update.values - truth) < 5 * std)
    assert np.all(update.intervals[:2, 1] / update.intervals[:2, 0] < 1.5)


def test_with_levels_known_only_relative_to_each_other_mu_is_told_over_the_force_alone(exact, tmp_path):
    chart = noisy(exact, np.random.default_rng())
    found = updated(chart, tmp_path, (0.2, 2e7, 0.4), "--update", "friction_coefficient", "--relative-levels")
    assert found.names == ("friction_coefficient", "force_scale")
    assert found.identifiable == (False, False)
    (finding,) = (one for one in found.findings if one.code == "not-identifiable")
    assert "only the ratio of friction_coefficient and force_scale" in finding.message
    assert found.values[0] / found.values[1] == pytest.approx(0.3, rel=0.05)


def test_the_updated_model_agrees_and_another_one_does_not(exact, update):
    chart = noisy(exact, np.random.default_rng())
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
        (["exponent"], "no exponent m"),
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


OMEGA, ZETA = 2 * np.pi * 499.0, 0.00638
ON = Dof(1, "+X")


def against_a_wall(law):
    """1 kg at 499 Hz that rubs against a wall."""
    sides = ON, Dof(1, "+Z")
    host = Matrices(np.eye(2), np.diag([OMEGA**2, 1e9]), sides)
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), tuple(replace(dof, part="wall") for dof in sides))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, 100.0, 1.0)
    return BeamModel(host, wall, (joint,), Damping(ratio=ZETA))


def closed_form_map(mu, stiffness, exponent, levels, forces):
    """Frequency and damping of that mass at resonance from the describing function of Masing's spring.

    With y = F_C / (k A), cos theta = 1 - 2 y: k' = (k / pi) (theta - sin(2 theta) / 2), k'' = 4 k y (1 - y) / pi. At
    quadrature w^2 = w_0^2 + k', F_E = A (k'' + 2 zeta w_0 w), solved by bisection, and the damping ratio is
    (k'' + 2 zeta w_0 w) / (2 w^2).
    """
    frequency, damping = np.empty((2, len(levels), len(forces)))
    for i, level in enumerate(levels):
        for j, force in enumerate(forces):
            k, slip = stiffness * (force / 1000) ** exponent, mu * force
            low, high = 1e-12, 1.0
            for _ in range(200):
                amplitude = np.sqrt(low * high)
                y = min(slip / (k * amplitude), 1.0)
                theta = np.arccos(1 - 2 * y)
                w = np.sqrt(OMEGA**2 + k / np.pi * (theta - np.sin(2 * theta) / 2))
                loss = 4 * k * y * (1 - y) / np.pi + 2 * ZETA * OMEGA * w
                low, high = (low, amplitude) if amplitude * loss > level else (amplitude, high)
            frequency[i, j], damping[i, j] = w / (2 * np.pi), loss / (2 * w**2)
    return ModalMap(np.asarray(levels), np.asarray(forces), frequency, damping, method="frozen", name="closed form")


@pytest.mark.slow
def test_joint_parameters_from_a_closed_form_map_with_noise():
    """The map is that of a describing function, of which the model that is fitted knows nothing; bounds as above."""
    truth = 0.3, 0.05 * OMEGA**2, 0.4
    exact = closed_form_map(*truth, [10.0, 40.0], [12.0, 30.0, 75.0, 180.0, 450.0])
    chart = noisy(exact, np.random.default_rng())
    start = against_a_wall(Masing(0.1, 4 * truth[1]))
    found = compare.update(start, chart, FREE, ON, ON)
    assert found.values[0] == pytest.approx(truth[0], rel=0.10)
    assert found.values[1] == pytest.approx(truth[1], rel=0.15)
    assert found.values[2] == pytest.approx(truth[2], abs=0.1)
    assert all(found.identifiable)
