"""Joints pressed a million times harder than they are loaded: the released mass vibrates as if it were welded on."""

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import BoucWen, Dahl, Iwan, LuGre, Masing, RegularisedMasing, Valanis, snapback, snapback_reference

SPRING, STIFFNESS, DAMPING, LOAD = (2 * np.pi * 41.0) ** 2, 1.3e5, 4.0, 50.0


def on_wall(law, normal_force, spring):
    """1 kg on a spring, pressed to a wall."""
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Z")) for body in ("", "wall"))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, normal_force, 1.0, directions=("X",))
    host = Matrices(np.eye(2), np.diag([spring, 2 * SPRING]), dofs)
    wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), walls)
    return BeamModel(host, wall, (joint,), Damping(mass_factor=DAMPING), "pressed")


@pytest.mark.parametrize("normal_force", [1e9, 1e12])
@pytest.mark.parametrize(
    "law",
    [
        Dahl(0.3, STIFFNESS),
        Dahl(0.3, STIFFNESS, 0.6),
        Dahl(0.3, STIFFNESS, 1.7),
        Valanis(0.3, STIFFNESS),
        LuGre(0.3, STIFFNESS, 0.0, 0.0, 1.3, 1e-3),
        BoucWen(0.3, STIFFNESS),
        RegularisedMasing(0.3, STIFFNESS, 8.0),
    ],
    ids=lambda law: f"{law.name} {law.parameters}",
)
def test_a_joint_that_hardly_slips_is_a_spring(law, normal_force):
    """At 1e9 N Dahl's law had no static equilibrium: its force was a difference of two that are 1e8 times as large."""
    run = snapback(on_wall(law, normal_force, SPRING), LOAD, "1:+X", 0.05)
    decay, omega = DAMPING / 2, np.sqrt(SPRING + STIFFNESS - DAMPING**2 / 4)
    waves = np.cos(omega * run.times) + decay / omega * np.sin(omega * run.times)
    true = LOAD / (SPRING + STIFFNESS) * np.exp(-decay * run.times) * waves
    assert np.abs(run.displacements[0] - true).max() <= max(run.error_estimate, 1e-6) * np.abs(true).max()
    assert run.error_estimate < 1e-5 and not run.findings


@pytest.mark.parametrize("solver", [snapback, snapback_reference])
@pytest.mark.parametrize("law", [Masing(0.3, STIFFNESS), Iwan(0.3, STIFFNESS)], ids=lambda law: law.name)
def test_a_mass_that_friction_alone_holds_carries_no_more_than_it(law, solver):
    """It had been let go at 2e8 m, or nowhere: NaN. A weak spring holds it, where the load less the friction says."""
    held = solver(on_wall(law, 100.0, 0.0), 20.0, "1:+X", 0.01)
    assert np.abs(held.displacements).max() < 10 * LOAD / STIFFNESS
    for load in (30.1, LOAD):
        with pytest.raises(InputError, match="slide away"):
            solver(on_wall(law, 100.0, 0.0), load, "1:+X", 0.01)
    sprung = solver(on_wall(law, 100.0, 1.0), LOAD, "1:+X", 0.01)
    assert sprung.displacements[0, 0] == pytest.approx(LOAD - 30.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(12))
def test_a_bar_that_lies_on_two_masses_by_friction_alone_pulls_at_both_with_what_it_carries(seed):
    """Two masses on springs K, a bar across them that nothing else holds: its joints carry equal and opposite forces, and
    slide together from mu F_N on. A load P on one mass then moves it by (P - mu F_N) / K, and the other by mu F_N / K."""
    rng = np.random.default_rng(seed)
    spring, bar, stiffness = 10 ** rng.uniform(5, 8), 10 ** rng.uniform(6, 10), 10 ** rng.uniform(6, 9)
    limit = 10 ** rng.uniform(0, 3)
    law, force = Masing(0.2, stiffness), limit / 0.2
    host = tuple(Dof(node, axis) for node in (1, 2) for axis in ("+X", "+Z"))
    beam = tuple(Dof(node, axis, "bar") for node in (1, 2) for axis in ("+X", "+Z"))
    along = np.kron([[1, -1], [-1, 1]], np.diag([bar, 0.0])) + np.kron(np.eye(2), np.diag([0.0, spring]))
    model = BeamModel(
        Matrices(np.eye(4), np.diag([spring, 2 * spring, spring, 2 * spring]), host),
        Matrices(0.1 * np.eye(4), along, beam),
        tuple(
            Joint(f"joint {node}", ((node, node),), (0.0, 0.0), law, force, stiffness, directions=("X",))
            for node in (1, 2)
        ),
        Damping(mass_factor=DAMPING),
        "bar on two masses",
    )
    stuck = 1 / (2 / spring + 2 / stiffness + 1 / bar) / spring  # force of a joint over the load before it slides
    load = rng.uniform(1.2, 3.0) * limit / stuck
    time = 1e-3 / np.sqrt(spring)
    moved = snapback(model, load, "1:+X", time, ["1:+X", "2:+X"]).displacements[:, 0]
    assert moved == pytest.approx(np.array([load - limit, limit]) / spring, rel=1e-6)
