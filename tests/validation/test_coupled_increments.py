"""Increments of contacts that hang together: friction in two directions, normal contact that parts and stiffens, slip
forces that follow it. Random structures under random loads, in which contacts slide, stick, part and close: none of more
than ten thousand increments is left unsolved, and energy balances within the limit of the simulator.
"""

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import (
    BoucWen,
    ContactCurve,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    PowerContact,
    RegularisedMasing,
    Unilateral,
    Valanis,
    register_law,
)
from ema.simulate.transient import ENERGY_LIMIT, Drive, integrate, prepare, released

STEPS, SOLVED = 250, 1e-10
NODES = (1, 2, 3, 4)
AXES = ("+X", "+Y", "+Z")


def laws(k):
    return (
        Masing(0.4, k),
        Iwan(0.4, k, springs=12),
        Dahl(0.4, k),
        RegularisedMasing(0.4, k, 4.0),
        LuGre(0.4, k, 50.0, 5.0, 1.2, 1e-2),
        ParallelMasing(0.4, k, [0.5, 0.5], [0.3, 0.7]),
    )


def jenkins(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


OWN = register_law("jenkins of increments", jenkins)


def projected(k):
    return OWN(0.4, k), Valanis(0.4, k, 0.8), BoucWen(0.4, k, 1.5, 0.1)


def part(draw, name):
    """Four nodes with random masses, and a random stiffness matrix that couples all directions."""
    turned, _ = np.linalg.qr(draw.normal(size=(12, 12)))
    stiffness = turned @ np.diag(3e5 * 10 ** draw.uniform(-0.5, 1.5, 12)) @ turned.T
    dofs = tuple(Dof(node, axis, name) for node in NODES for axis in AXES)
    return Matrices(np.diag(np.repeat(draw.uniform(0.5, 2, 4), 3)), 0.5 * (stiffness + stiffness.T), dofs)


def model(seed, laws=laws):
    """Six laws, three kinds of normal contact, one and two directions in turn; stiffnesses over five decades."""
    draw = np.random.default_rng(seed)
    contacts = Unilateral(), PowerContact(2.0, 20.0), ContactCurve([0, 1e-5, 3e-5], [0, 10.0, 90.0])
    joint = Joint(
        "joint",
        tuple((node, node) for node in NODES),
        (0.0, 0.0),
        (laws(10 ** draw.uniform(5.0, 10.0)) * 2)[seed % 6],
        float(draw.uniform(20, 120)),
        10 ** draw.uniform(5, 9),
        directions=(("X", "Y"), ("X",))[(seed // 6) % 2],
        normal_contact=contacts[seed % 3],
    )
    return BeamModel(part(draw, ""), part(draw, "beam"), (joint,), Damping(ratio=0.002), "random"), draw


@pytest.mark.parametrize("laws", [laws, projected], ids=["own vector forms", "radial return"])
@pytest.mark.parametrize("block", range(4))
def test_no_increment_of_contacts_that_hang_together_is_left_unsolved(block, laws):
    at = [Dof(node, axis) for node in (1, 2, 3) for axis in AXES]
    taken = slid = parted = 0
    for seed in range(12 * block, 12 * block + 12):
        beam_on_beam, draw = model(seed, laws)
        problem = prepare(beam_on_beam, ["1:+X"], loads=["1:+X"], plane=True, normal=True)
        h = 10 ** draw.uniform(-5.3, -3.7)
        times = h * np.arange(STEPS + 1)
        values = np.array(
            [draw.uniform(20, 200) * np.cos(2 * np.pi * draw.uniform(20, 300) * times + draw.uniform(0, 6)) for _ in at]
        )
        run, stepper = integrate(problem, problem.rest(), h, 1, STEPS, Drive(times, tuple(at), values))
        assert stepper.residual <= SOLVED, (seed, stepper.residual)
        friction, damping, projection, supplied, contact, mechanical = run["energy"].T
        gap = friction + damping + projection + contact + mechanical - supplied
        assert np.abs(gap - gap[0]).max() <= ENERGY_LIMIT * np.abs(run["energy"]).max(), seed
        assert friction[-1] >= 0
        taken, slid, parted = taken + STEPS, slid + (friction[-1] > 0), parted + (stepper.coupled.kept[:, 2] > 0).any()
    assert taken == 3000 and slid >= 8 and parted >= 3


@pytest.mark.parametrize("seed", range(12))
def test_a_slow_load_finds_its_equilibrium(seed):
    """A quarter of the force that presses, along X."""
    beam_on_beam, _ = model(seed)
    problem = prepare(beam_on_beam, ["1:+X"], loads=["1:+X"], plane=True, normal=True)
    load = 0.25 * beam_on_beam.joints[0].normal_force
    state = released(problem, load, Dof(1, "+X"))
    system, contacts = problem.system, problem.system.contacts
    displacements = problem.base.shapes @ state.q
    residual = system.stiffness @ displacements + contacts.slip.T @ state.f - load * system.row("1:+X")
    assert np.abs(residual).max() <= 1e-8 * np.abs(system.stiffness @ displacements).max()
