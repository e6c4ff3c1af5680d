"""LuGre where the normal force falls to nothing and returns: an oscillator against its equations in small steps.

Bristles bear F_S at most (Canudas de Wit et al. 1995, property 1: |k z| <= F_S is never left at a constant normal force).
Where the normal force falls they are brought back to that, and where it is zero nothing is left: what comes to touch
again is unstressed.
"""

import numpy as np
import pytest

from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.simulate import Dahl, LuGre, RegularisedMasing, Unilateral, Valanis, respond
from ema.simulate.loops import drive

MU, K, RATIO, STRIBECK, FN = 0.4, 4e5, 1.3, 2e-2, 60.0
SPRING, DECAY = (2 * np.pi * 60) ** 2, 20.0


def oscillator(law, lift=0.0, **joint):
    """1 kg on springs, under a wall; ``lift`` couples X to Z."""
    stiffness = SPRING * np.array([[1.0, 0.0, lift], [0.0, 1.3, 0.0], [lift, 0.0, 0.3]])
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Y", "+Z")) for body in ("", "wall"))
    host, wall = Matrices(np.eye(3), stiffness, dofs), Matrices(1e3 * np.eye(3), 1e16 * np.eye(3), walls)
    contact = Joint("contact", ((1, 1),), (0.0, 0.0), law, FN, 1e6, **joint)
    return BeamModel(host, wall, (contact,), Damping(mass_factor=DECAY), "oscillator")


class Bristles:
    """The equations of LuGre, solved exactly over a step of constant velocity; in one direction or two."""

    def __init__(self, damping, viscous):
        self.damping, self.viscous, self.z = damping, viscous, 0.0

    def force(self, velocity, normal, h):
        """Friction at the end of a step, which ``velocity`` (axis,) and the normal force hold for."""
        if normal <= 0:
            self.z = 0.0 * velocity
            return 0.0 * velocity
        speed = np.linalg.norm(velocity)
        size, most = np.linalg.norm(self.z), MU * normal * RATIO
        self.z = self.z * min(1.0, most / size) if size > 0 else 0.0 * velocity
        top = MU * normal * (1 + (RATIO - 1) * np.exp(-((speed / STRIBECK) ** 2)))
        if speed > 0:
            ahead = top * velocity / speed
            self.z = ahead + (self.z - ahead) * np.exp(-K * speed * h / top)
        rate = velocity - speed * self.z / top
        return self.z + self.damping * rate + self.viscous * velocity


def small_steps(times, push, normal, damping, viscous):
    """Motion under ``push`` (axis, time) with a given normal force (time,)."""
    stiffness = SPRING * np.array([1.0, 1.3])[: len(push)]
    x, v, h, law = np.zeros(len(push)), np.zeros(len(push)), times[1], Bristles(damping, viscous)
    out = np.zeros((len(push), len(times)))
    for n in range(len(times)):
        out[:, n] = x
        v = (v + h * (push[:, n] - stiffness * x - law.force(v, normal[n], h))) / (1 + DECAY * h)
        x = x + h * v
    return out


def falling(times):
    """Down to nothing for a fifth of every period, and up again."""
    return np.maximum(FN * (0.8 + np.cos(2 * np.pi * 31 * times)) / 1.8, 0.0)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("damping", "viscous"), [(0.0, 0.0), (40.0, 3.0)])
def test_motion_under_a_normal_force_that_vanishes_and_returns(axes, damping, viscous):
    """Small steps are of first order: their halves say what they err, of which the truth is extrapolated."""
    rate, share = 20_000.0, 8
    fine = np.arange(2000 * share + 1) / (rate * share)
    push = np.array([50 * np.sin(2 * np.pi * 47 * fine), 40 * np.sin(2 * np.pi * 71 * fine)])[:axes]
    one = small_steps(fine, push, falling(fine), damping, viscous)[:, ::share]
    two = small_steps(fine[::2], push[:, ::2], falling(fine[::2]), damping, viscous)[:, :: share // 2]
    truth = 2 * one - two
    times, ends = fine[::share], ["1:+X", "1:+Y"][:axes]
    model = oscillator(LuGre(MU, K, damping, viscous, RATIO, STRIBECK), directions=("X", "Y")[:axes])
    found = respond(model, push[:, ::share], ends, rate, ends, tolerance=1e-3, normal_forces=falling(times)[None])
    size = np.abs(truth).max()
    assert np.abs(found.displacements - truth).max() <= 1e-3 * size + np.abs(one - two).max()
    assert found.energy.error <= 1e-6


LAWS = [
    LuGre(MU, K, 0.0, 0.0, RATIO, STRIBECK),
    LuGre(MU, K, 40.0, 0.0, RATIO, STRIBECK),
    Dahl(MU, K),
    Valanis(MU, K),
    RegularisedMasing(MU, K),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_contact_at_rest_bears_no_more_than_its_slip_force(law):
    """Pulled, held, and let go: friction falls with the normal force, and does not come back with it."""
    most = MU * (RATIO if law.name == "lugre" else 1.0)
    u = np.concatenate([np.linspace(0, 3e-4, 400), np.full(40, 3e-4)])
    down = np.array([50.0, 10.0, 1.0, 0.0, 0.0, 1.0, 30.0, 60.0])
    normal = np.concatenate([np.full(432, FN), down])
    forces = drive(law, u, normal, 1.0)
    assert forces[431] > 0.9 * MU * FN
    assert np.all(np.abs(forces[432:]) <= most * down * (1 + 1e-9))
    np.testing.assert_allclose(forces[-5:], 0.0, atol=1e-12)


@pytest.mark.parametrize("law", [LAWS[0], *LAWS[2:]], ids=lambda law: law.name)
@pytest.mark.parametrize("directions", [("X",), ("X", "Y")])
def test_a_contact_that_lifts_off_bears_no_more_than_its_slip_force(law, directions):
    rate = 20_000.0
    times = np.arange(2001) / rate
    push = np.array([30 * np.sin(2 * np.pi * 47 * times), 60 * np.sin(2 * np.pi * 83 * times)])
    model = oscillator(law, 0.1, normal_contact=Unilateral(), directions=directions)
    found = respond(model, push, ["1:+X", "1:+Z"], rate, ["1:+X", "1:+Z"], tolerance=1e-3)
    assert 0.02 < found.pressure.open_time[0] < 0.9 and found.energy.error <= 1e-6
    # 30 N in a soft bolt; what the spring of 1e6 N/m carries besides
    normal = np.maximum(found.pressure.forces[0] + 1e6 * found.displacements[1], 0.0)
    most = MU * (RATIO if law.name == "lugre" else 1.0) * normal
    friction = np.linalg.norm(found.forces[: len(directions)], axis=0)
    assert np.all(friction <= most * (1 + 1e-6) + 1e-6 * FN)
    assert friction[normal == 0].max() == 0.0
