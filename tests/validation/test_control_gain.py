"""What a controlled normal force brings at a tool point, against closed forms."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from acquisition.model_file import ControlTable
from ema.cli.simulations import control
from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.progress import silent
from ema.simulate import cutting_limits, ring_downs
from ema.simulate.control_gain import sticking_limit
from tests.closed_forms import masing_oscillator
from tests.golden_json import assert_keys

F0, ZETA = 499.0, 0.00638
OMEGA = 2 * np.pi * F0


def oscillator(kappa: float, force: float) -> BeamModel:
    """1 kg at 499 Hz that rubs against a wall with friction coefficient 1."""
    host = Matrices(np.eye(2), np.diag([OMEGA**2, 1e9]), (Dof(1, "+X"), Dof(1, "+Z")))
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    law = FrictionLaw("masing", 1.0, kappa * OMEGA**2)
    return BeamModel(host, wall, (Joint("contact", ((1, 1),), (0.0, 0.0), law, force, 1.0),), Damping(ratio=ZETA))


def test_depth_of_cut_of_a_sticking_joint_is_that_of_one_oscillator():
    """-1 / (2 K_s min Re G) = 2 k zeta (1 + zeta) / K_s of an oscillator, at f_n sqrt(1 + 2 zeta) (Altintas 2012)."""
    limits = cutting_limits(oscillator(0.05, 1e6), "1:+X", [1.0, 100.0], [1e6, 2e6], (450, 560), specific_force=1.5e9)
    stiffness, natural = 1.05 * OMEGA**2, F0 * np.sqrt(1.05)
    assert limits.depth == pytest.approx(2 * stiffness * ZETA * (1 + ZETA) / 1.5e9, rel=3e-3)
    assert limits.frequency == pytest.approx(natural * np.sqrt(1 + 2 * ZETA), rel=1e-3)
    assert limits.amplitude[:, 0] == pytest.approx(np.array([1.0, 100.0]) / (2 * stiffness * ZETA), rel=3e-3)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 1.0, 2.0])
def test_depth_of_cut_of_a_slipping_joint_is_that_of_the_describing_function(ratio):
    """Steady states in closed form, one harmonic, lines 0.02 Hz apart; harmonic balance adds others, 1 % at most here.
    The damping ratio of the model is that of its sticking mode."""
    kappa, level = 0.05, 10.0
    lines = np.arange(450.0, 560.0, 0.02)
    values, _ = masing_oscillator(lines, F0, ZETA * np.sqrt(1 + kappa), ratio, kappa)
    limits = cutting_limits(oscillator(kappa, ratio * level), "1:+X", [level], [ratio * level], (450, 560))
    assert limits.depth[0, 0] == pytest.approx(-1 / (2 * 2e9 * values.real.min()), rel=0.01)
    assert limits.amplitude[0, 0] == pytest.approx(level * np.abs(values).max(), rel=0.01)


def two_masses() -> tuple[BeamModel, np.ndarray, np.ndarray]:
    """1 kg at 499 Hz that rubs against a wall and carries a second mass on a spring; natural frequencies in rad/s with a
    sticking joint, and the shape (mode,) of the second mass."""
    host_mass = np.diag([1.0, 1.0, 0.3])
    spring = 0.8 * OMEGA**2
    host = Matrices(
        host_mass,
        np.array([[OMEGA**2 + spring, 0, -spring], [0, 1e9, 0], [-spring, 0, spring]]),
        (Dof(1, "+X"), Dof(1, "+Z"), Dof(2, "+X")),
    )
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), FrictionLaw("masing", 1.0, 0.05 * OMEGA**2), 1e6, 1.0)
    stiffness = np.array([[1.05 * OMEGA**2 + spring, -spring], [-spring, spring]])
    squares, shapes = scipy.linalg.eigh(stiffness, np.diag([1.0, 0.3]))
    return BeamModel(host, wall, (joint,), Damping(ratio=ZETA)), np.sqrt(squares), shapes[1]


def test_the_resonance_that_limits_the_cut_of_sticking_joints_is_found_wherever_it_lies():
    """min Re G of two modes in closed form, on lines 0.01 Hz apart; of one oscillator -1 / (4 k zeta (1 + zeta))."""
    model, omega, shape = two_masses()
    lines = 2 * np.pi * np.arange(200.0, 1500.0, 0.01)
    values = sum(a**2 / (w**2 - lines**2 + 2j * ZETA * w * lines) for a, w in zip(shape, omega, strict=True))
    depth, frequency = sticking_limit(model, "2:+X", F0)
    assert depth == pytest.approx(-1 / (2 * 2e9 * values.real.min()), rel=2e-3)
    assert frequency == pytest.approx(lines[values.real.argmin()] / (2 * np.pi), rel=1e-3)
    depth, frequency = sticking_limit(oscillator(0.05, 1e6), "1:+X", F0, 1.5e9)
    assert depth == pytest.approx(2 * 1.05 * OMEGA**2 * ZETA * (1 + ZETA) / 1.5e9, rel=2e-3)
    # without damping Re G has no bound
    depth, frequency = sticking_limit(replace(model, damping=Damping(ratio=0.0)), "2:+X", F0)
    assert (depth, frequency) == (0.0, pytest.approx(omega[0] / (2 * np.pi)))


def test_a_resonance_outside_the_band_that_limits_the_cut_is_named():
    """The lower mode moves the second mass more and is softer: chatter begins there, whatever control does above it."""
    model, omega, _ = two_masses()
    low, high = omega / (2 * np.pi)
    table = {"at": "2:+X", "load": "100 N", "normal_force": ["1000 kN"], "force": ["1 N"]}
    named = [
        control(ControlTable(**table, band=[f"{0.9 * one} Hz", f"{1.1 * one} Hz"]), model, None, None, silent)
        for one in (low, high)
    ]
    assert [one.code for one in named[0].findings] == []
    (finding,) = named[1].findings
    stated = float(re.findall(r"below ([\d.]+) Hz", finding.message)[0])
    assert finding.code == "cut-limited-elsewhere" and stated == pytest.approx(low * (1 + ZETA), rel=1e-3)
    assert finding.value == pytest.approx(named[0].more["tool"][0]["depth [mm]"], rel=5e-3)


def test_a_band_without_the_resonance_that_limits_the_cut_is_refused():
    with pytest.raises(InputError, match="most negative at an end of the band; got 530 Hz"):
        cutting_limits(oscillator(0.05, 1e6), "1:+X", [1.0], [1e6], (530, 600))


def test_one_force_for_each_level_is_proportional_to_the_level():
    """With a contact stiffness that does not depend on the normal force, twice the level under twice the normal force
    is the same motion, twice as large: depths are equal, and so is the gain of every pair."""
    limits = cutting_limits(oscillator(0.05, 10.0), "1:+X", [5.0, 10.0, 20.0], [4.0, 8.0, 16.0, 32.0], (450, 560))
    assert limits.depth[1, 1:] == pytest.approx(limits.depth[0, :-1], rel=5e-3)
    assert limits.depth[2, 1:] == pytest.approx(limits.depth[1, :-1], rel=5e-3)
    each = limits.depth[np.arange(3), limits.controlled]
    assert each.min() > 1.1 * limits.depth[:, limits.constant].min()


def test_every_law_is_shown_with_the_force_whose_energy_goes_first():
    """An oscillator under Coulomb friction and viscous damping turns every half cycle at (a - d) exp(-pi zeta') - d with
    d = F_C / k and zeta' its damping ratio while it slides (the contact stiffness, 50 k, moves d by 2 %)."""
    kappa, load, force = 50.0, 400.0, 20.0
    lines = ring_downs(oscillator(kappa, force), load, "1:+X", F0, normal_forces=[2.0, force])
    assert [line.law.split()[0] for line in lines] == ["constant", "scheduled", "released"]
    assert lines[0].force == force
    start = left = load - force
    halves, ratio = 0, ZETA * np.sqrt(1 + kappa)
    while left > 0.05 * start:
        left, halves = (left - force) * np.exp(-np.pi * ratio) - force, halves + 1
    assert lines[0].to_five == pytest.approx(halves / 2 / F0, abs=0.5 / F0)


def test_from_the_command_line(root: Path, tmp_path: Path):
    """The double beam, 20 N released, controller 2 ms late: the scheduled force leaves at most half the integral of the
    energy of the best constant one, and reaches 2 % of the amplitude at least three times as soon."""
    command = [
        Path(sys.executable).with_name("ema"),
        "simulate",
        "control",
        root / "datasets" / "double_beam",
        "--json",
    ]
    done = subprocess.run([*command, "-o", tmp_path], capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    constant, scheduled, _ = told["rows"]
    assert "less of its integral over time than the best constant force" in told["statement"]
    assert scheduled["integral of E/E0 [ms]"] <= 0.5 * constant["integral of E/E0 [ms]"]
    assert scheduled["to 2 % [ms]"] < 200
    assert constant["to 2 % [ms]"] is None or constant["to 2 % [ms]"] >= 3 * scheduled["to 2 % [ms]"]
    assert_keys("ema simulate control", told)


@pytest.mark.slow
def test_a_force_set_for_each_level_on_the_work_table(root: Path, tmp_path: Path):
    """Twice the depth of cut of the best constant normal force, and more."""
    command = [Path(sys.executable).with_name("ema"), "simulate", "control", root / "datasets" / "work_table_hammer"]
    done = subprocess.run([*command, "--json", "-o", tmp_path], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    rows = told["tool"]
    assert "After a release" in told["statement"] and "Assumed: force and chip thickness along" in told["statement"]
    assert min(row["depth, set [mm]"] for row in rows) > 2 * min(row["depth [mm]"] for row in rows)
    assert all(row["waves, set [um]"] <= 1.001 * row["waves [um]"] for row in rows)
