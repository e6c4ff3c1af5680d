"""Rough surfaces against sums over a hundred thousand summits, each a sphere in contact with friction.

A summit pressed by delta carries delta^(3/2) (Hertz 1882); under a constant force it slips by Cattaneo's and Mindlin's
closed form, and turns by Masing's rules; under a force that changes it is a row of springs that touch where the sphere
does, each with Coulomb's law (Popov and Hess 2015). Heights: Greenwood and Williamson (1966). None of it knows ``ema``.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import norm

from ema.contact.rough import GROWTH, partial_moment, rough_springs
from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import (
    HarmonicBalance,
    RoughContact,
    RoughNormalContact,
    frf,
    loop,
    respond,
    snapback,
    snapback_reference,
)
from ema.simulate.loops import drive

MU, NU, S, FN = 0.3, 0.25, 1e-6, 500.0
KAPPA = 2 * (1 - NU) / (2 - NU)
UC = MU * S / KAPPA
"""Displacement at which a summit that is S deep slips as a whole."""
EXACT = 0.002
"""Bound of the error of 60 springs on first loading over mu F_N, which is 0.0016 at 2 UC; on branches of a loop Masing's
rule doubles it."""

CHANGED = 0.005
"""The same where the normal force has grown, over its largest value: stretches of h = 0.2 err by h^2/8."""


def compressions(separation, seed):
    """Of 100,000 summits that touch, in S, one drawn from each hundred thousandth of the heights.

    Exponential heights have no memory of the separation.
    """
    draw = (np.arange(100_000) + np.random.default_rng(seed).uniform(size=100_000)) / 100_000
    return -np.log(draw) if separation is None else norm.isf(draw * norm.sf(separation)) - separation


def first_loading(delta, x):
    """Friction of all summits, moved by x in UC for the first time: Mindlin (1949), in mu S^(3/2)."""
    return np.sum(delta**1.5 * (1 - np.maximum(1 - x / delta, 0) ** 1.5))


@pytest.mark.parametrize("separation", [None, 2.0, 4.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_first_loading_and_reversals_against_summits_of_mindlin(separation, seed):
    """To 2, back by Masing's rule to -2, up again within the loop, and 3 beyond it."""
    delta = compressions(separation, seed)
    whole = np.sum(delta**1.5)
    law = RoughContact(MU, S, NU, separation, reference_force=FN)

    def curve(x):
        return np.array([first_loading(delta, float(one)) for one in x])

    up, down, again = np.linspace(0, 2, 9), np.linspace(2, -2, 9)[1:], np.linspace(-2, 1, 7)[1:]
    top = curve([2.0])
    truth = np.concatenate(
        [curve(up), top - 2 * curve((2 - down) / 2), -top + 2 * curve((again + 2) / 2), curve([3.0])]
    )
    found = drive(law, UC * np.concatenate([up, down, again, [3.0]]), FN) / (MU * FN)
    np.testing.assert_allclose(found[:9], truth[:9] / whole, atol=EXACT)
    np.testing.assert_allclose(found, truth / whole, atol=2 * EXACT)


def test_exponential_heights_are_a_closed_form():
    law = RoughContact(MU, S, NU)
    x = np.geomspace(1e-3, 12, 200)
    assert law.contact_stiffness == pytest.approx(KAPPA * 1000 / S)
    found = drive(law, np.append(0.0, x * UC), FN)[1:]
    np.testing.assert_allclose(found, MU * FN * -np.expm1(-x), rtol=EXACT)
    # twice the normal force: twice the stiffness and the friction at any displacement
    np.testing.assert_allclose(drive(law, np.append(0.0, x * UC), 2 * FN)[1:], 2 * found, rtol=1e-12)


def test_loss_per_cycle():
    """8 int F du - 4 u F of the curve by Masing's rules; at small amplitudes (2/3) k_T^2 u^3 / (mu F_N)."""
    x, top = np.geomspace(0.01, 10, 25), MU * FN
    curve = -np.expm1(-x)
    for springs, exact in ((60, 0.016), (120, 0.004)):
        losses = np.array([loop(RoughContact(MU, S, NU, springs=springs), FN, one * UC).area for one in x])
        np.testing.assert_allclose(losses, top * UC * (8 * (x - curve) - 4 * x * curve), rtol=exact)
    # the closed form and its limit differ by 2 % at x = 0.03
    np.testing.assert_allclose(losses[:4], 2 / 3 * (KAPPA * FN / S) ** 2 * (x[:4] * UC) ** 3 / top, rtol=0.02 + exact)
    assert np.polyfit(np.log(x[:4]), np.log(losses[:4]), 1)[0] == pytest.approx(3, abs=0.02)


def test_error_of_the_springs_falls_with_their_number_squared():
    x = np.geomspace(1e-2, 10, 200)
    errors = {
        count: np.abs(
            drive(RoughContact(MU, S, NU, springs=count), np.append(0.0, x * UC), FN)[1:] / (MU * FN) + np.expm1(-x)
        ).max()
        for count in (30, 60, 120, 240)
    }
    assert errors[60] < EXACT and errors[30] / errors[240] > 40


class Bed:
    """100,000 summits with heights at even probabilities, each of 200 springs; those of one depth are one spring."""

    def __init__(self, highest):
        count, rings, cell = 100_000, 200, 1e-3
        touch = highest + np.log((np.arange(count) + 0.5) / count)
        radius = (np.arange(rings) + 0.5) / rings * np.sqrt(14.0)
        edges = np.arange(touch.min(), highest + cell, cell)
        self.stiffness = np.zeros(len(edges))
        for x in radius:
            rows = ((touch + x**2 - edges[0]) / cell).astype(int)
            self.stiffness += np.bincount(rows[rows < len(edges)], minlength=len(edges))
        self.depth, self.force, self.before = edges + cell / 2, np.zeros(len(edges)), 0.0
        self.stiffness /= self.pressed(0.0)

    def pressed(self, depth):
        """Normal force over that at depth 0, in S."""
        return float(np.sum(self.stiffness * np.maximum(depth - self.depth, 0)))

    def moved(self, depth, x):
        """Friction over mu F_N at depth 0, after a move to x in UC."""
        top = self.stiffness * np.maximum(depth - self.depth, 0)
        self.force = np.clip(self.force + self.stiffness * (x - self.before), -top, top)
        self.before = x
        return self.force.sum()


T = np.linspace(0, 1, 1001)
KNOTS = np.random.default_rng(7).uniform(-1, 1, (2, 11))
PATHS = {
    "pressed and moved": (2.5 * T, 2.2 * T),
    "let go and pressed again": (-4 * np.sin(2 * np.pi * T) ** 2, 1.5 * np.sin(4 * np.pi * T)),
    "pressed to and fro": (1.2 * np.sin(4 * np.pi * T), 0.8 * np.sin(6 * np.pi * T)),
    "at random": tuple(
        size * np.interp(T, np.linspace(0, 1, 12), np.append(0, row)) for size, row in zip((2.5, 3), KNOTS)
    ),
}


@pytest.mark.parametrize("path", PATHS)
def test_normal_forces_that_change_against_summits(path):
    """Depth in S and displacement in UC; the forces change by factors up to 12, and to 0.02."""
    depth, x = PATHS[path]
    bed = Bed(2.6)
    normal, truth = np.array([bed.pressed(d) for d in depth]), np.array([bed.moved(*one) for one in zip(depth, x)])
    found = drive(RoughContact(MU, S, NU), x * UC, FN * normal) / (MU * FN)
    assert np.abs(found - truth).max() <= CHANGED * normal.max()
    # the law of a fixed stiffness is far from it
    assert np.abs(drive(RoughContact(MU, S, NU), x * UC, FN) / (MU * FN) - truth).max() > 0.2 * normal.max() ** 0.5


def test_what_sticks_while_it_is_pressed_is_elastic():
    """u = c mu D / kappa with c < 1 slips nowhere: dF_T = kappa k_N du, hence F_T = c mu (F_N - F_N0)."""
    depth = np.linspace(0, 2.5, 500)
    normal = FN * np.exp(depth)
    for c in (0.3, 0.9):
        found = drive(RoughContact(MU, S, NU), c * MU * depth * S / KAPPA, normal)
        np.testing.assert_allclose(found, c * MU * (normal - FN), atol=CHANGED * MU * normal.max())


def test_a_contact_that_opened_comes_back_without_friction():
    law = RoughContact(MU, S, NU)
    x, normal = UC * np.array([0.0, 2.0, 2.0, 2.0, 2.5]), FN * np.array([1.0, 1.0, 0.0, 1.0, 1.0])
    found = drive(law, x, normal) / (MU * FN)
    np.testing.assert_allclose(found[1:], [-np.expm1(-2.0), 0.0, 0.0, -np.expm1(-0.5)], atol=EXACT)


@pytest.mark.parametrize("separation", [0.5, 1.0, 3.0, 6.0])
def test_moments_of_gaussian_heights(separation):
    for power in (0.5, 1.5):
        exact = quad(lambda x, n=power: (x - separation) ** n * norm.pdf(x), separation, np.inf, epsabs=0)[0]
        assert float(partial_moment(power, separation)) == pytest.approx(exact, rel=1e-8)
    force, slope = (float(partial_moment(n, separation)) for n in (1.5, 0.5))
    law = RoughContact(MU, S, NU, separation)
    assert law.contact_stiffness == pytest.approx(KAPPA * 1000 * 1.5 * slope / force / S)
    nearer = [np.log(float(partial_moment(n, separation - h))) for n in (0.5, 1.5) for h in (1e-4, -1e-4)]
    assert law.stiffness_exponent == pytest.approx((nearer[0] - nearer[1]) / (nearer[2] - nearer[3]), rel=1e-6)
    depth, pressed = np.array(RoughNormalContact(S, 1000.0, separation).points).T
    assert np.interp(1000.0, pressed, np.gradient(pressed, depth)) * KAPPA == pytest.approx(
        law.contact_stiffness, rel=1e-3
    )


@pytest.mark.parametrize("separation", [None, 1.0, 4.0])
def test_springs_hold_stiffness_and_force(separation):
    stiffness, force = rough_springs(60, separation)
    assert stiffness.sum() == pytest.approx(1) and force.sum() == pytest.approx(1) and min(*stiffness, *force) > 0
    more, level = rough_springs(60, separation, growing=True)
    # as deep as brings the normal force to GROWTH times that at rest with exponential heights
    assert np.all(level[60:] < 0) and np.all(np.diff(level[60:] / more[60:]) < 0)
    if separation is None:
        assert np.maximum(level + np.log(GROWTH) * more, 0).sum() == pytest.approx(GROWTH, rel=1e-9)


F0, SHALLOW = 100.0, 5e-6


def sledge(deviation=6e-5, directions=("X",), lift=0.0, parts=False, springs=30):
    """1 kg on springs that rubs on a wall above it; ``lift`` couples X to Z."""
    k = (2 * np.pi * F0) ** 2
    stiffness = np.diag([k, 1.3 * k, 0.2 * k])
    stiffness[0, 2] = stiffness[2, 0] = lift * k
    dofs, walls = (tuple(Dof(1, axis, body) for axis in ("+X", "+Y", "+Z")) for body in ("", "wall"))
    law = RoughContact(1.0, deviation, 0.3, springs=springs, reference_force=30.0)
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, 30.0, 1e6, directions=directions)
    host, wall = Matrices(np.eye(3), stiffness, dofs), Matrices(1e3 * np.eye(3), 1e16 * np.eye(3), walls)
    if parts:
        joint = replace(joint, normal_contact=RoughNormalContact(deviation, 30.0))
    return BeamModel(host, wall, (joint,), Damping(mass_factor=100.0), "sledge")


def explicit(times, push, lift):
    """Motion of the sledge in X and Z by small steps against the summits, and the share of the time in which it is off;
    ``push`` N (2, time). The preload of 30 N acts on it, and friction does not while it is put on."""
    k, s, uc, h = (2 * np.pi * F0) ** 2, SHALLOW, SHALLOW * 1.7 / 1.4, times[1]
    matrix, bed = k * np.array([[1.0, lift], [lift, 0.2]]), Bed(3.1)

    def normal(z):
        return max(30.0 * bed.pressed(z / s + np.log(1e-4)) - 30.0 * 1e-4, 0.0)

    x = np.zeros(2)
    rest = brentq(lambda z: (matrix[1, 1] - matrix[0, 1] ** 2 / matrix[0, 0]) * z + normal(z) - 30.0, 0.0, 20 * s)
    start, v = np.array([-lift * rest, rest]), np.zeros(2)
    out, off = np.zeros((2, len(times))), 0
    for n in range(len(times)):
        out[:, n] = x
        whole = start + x
        friction = 30.0 * bed.moved(whole[1] / s + np.log(1e-4), x[0] / uc)
        force = push[:, n] + [0.0, 30.0] - matrix @ whole - np.array([friction, normal(whole[1])])
        v = (v + h * force) / (1 + 100.0 * h)
        x = x + h * v
        off += normal(whole[1]) == 0.0
    return out, off / len(times)


@pytest.mark.slow
def test_motion_with_lift_off_against_small_steps_on_summits():
    """Small steps are of first order: half of them differs by what they err."""
    fine = np.arange(5_001) / 100_000
    push = np.array([40.0 * np.sin(2 * np.pi * 60 * fine), 24.5 * np.sin(2 * np.pi * 85 * fine)])
    (truth, off), (coarse, _) = explicit(fine, push, 0.2), explicit(fine[::2], push[:, ::2], 0.2)
    model = sledge(SHALLOW, lift=0.2, parts=True, springs=60)
    found = respond(model, push[:, ::2], ["1:+X", "1:+Z"], 50_000.0, ["1:+X", "1:+Z"], tolerance=1e-3)
    assert "lift-off" in {finding.code for finding in found.findings} and found.energy.error <= 1e-6
    assert found.pressure.open_time[0] == pytest.approx(off, abs=0.02) and 0 < off < 0.1
    error = np.abs(found.displacements - truth[:, ::2]).max() / np.abs(truth).max()
    own = np.abs(coarse - truth[:, ::2]).max() / np.abs(truth).max()
    assert error <= own + EXACT


def test_time_and_the_event_driven_reference_agree():
    model = replace(sledge(), damping=Damping())
    exact = snapback_reference(model, 60.0, "1:+X", 0.05, ["1:+X"])
    found = snapback(model, 60.0, "1:+X", 0.05, ["1:+X"], tolerance=1e-4)
    error = np.abs(found.displacements - exact.displacements).max() / np.abs(exact.displacements).max()
    assert error <= found.error_estimate <= 1e-4 and found.energy.error <= 1e-6


@pytest.mark.parametrize(
    "model",
    [sledge(), sledge(directions=("X", "Y")), sledge(2e-5, lift=0.1, parts=True)],
    ids=["line", "plane", "lift-off"],
)
def test_harmonic_balance_and_time_agree(model):
    found = frf(model, np.array([115.0]), 40.0, "1:+X", ["1:+X"], HarmonicBalance(verify=True))
    turns = np.arange(80 * 200 + 1) / 200
    run = respond(model, 40.0 * np.cos(2 * np.pi * turns)[None], ["1:+X"], 23_000.0, ["1:+X"], tolerance=3e-4)
    last, turn = run.displacements[0][-400:], turns[-400:]
    first = np.mean(2 * last * np.exp(-2j * np.pi * turn))
    error = abs(found.values[0, 0, list(found.orders).index(1)] - first) / abs(first)
    assert error <= found.error_estimate[0] + 3e-4 and found.power_error <= 1e-4


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: RoughContact(MU, 0.0), "not a rough surface; got summit deviation 0, expected above 0"),
        (lambda: RoughContact(MU, S, 0.6), "got poisson 0.6, expected above -1 and up to 0.5"),
        (lambda: RoughContact(MU, S, separation=0.0), "got separation 0, expected above 0 and up to 6"),
        (lambda: RoughContact(MU, S, springs=1), "got springs 1, expected 2 or more"),
        (lambda: RoughContact(MU, S, reference_force=float("nan")), "not a reference force; got nan N"),
        (lambda: RoughNormalContact(-S), "summit_deviation = -1e-06, expected above 0"),
        (lambda: RoughNormalContact(S, separation=7.0), "not a separation; got 7.0, expected above 0 and up to 6"),
        (
            lambda: drive(replace(RoughContact(MU, S), stiffness_exponent=0.0), np.zeros(3), FN),
            "follows its normal force",
        ),
        (
            lambda: drive(replace(RoughContact(MU, S), stiffness_cap=1e9), np.zeros(3), FN),
            "an exponent above 0 .* no cap",
        ),
    ],
)
def test_surfaces_that_are_none_get_a_sentence(make, words):
    with pytest.raises(InputError, match=words):
        make()
