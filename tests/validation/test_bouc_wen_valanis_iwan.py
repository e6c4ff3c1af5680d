"""Laws of Bouc and Wen, of Valanis, and of Iwan with any exponent of microslip, in time: an oscillator that rubs on a
wall, against its equations of motion integrated by DOP853 between the reversals of its velocity; and closed forms.

Wen (1976); Valanis (1971) as in Gaul and Nitsche (2001); Segalman (2005), Eqs. 10 to 22; loops by Masing's rules.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from ema.data import BeamModel, Damping, FrictionLaw, Joint, Matrices
from ema.dof import Dof
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Iwan,
    Masing,
    ModifiedIwan,
    RegularisedMasing,
    Valanis,
    frf,
    loop,
    register_law,
    respond,
    snapback,
)
from ema.simulate.loops import drive
from tests.closed_forms import iwan_area

K, FC, STIFFNESS = 4e5, 30.0, 4e5


def oscillator(law):
    """1 kg on a spring, in contact with a wall that presses with 30 N."""
    host = Matrices(np.diag([1.0, 1.0]), np.diag([STIFFNESS, 1e9]), (Dof(1, "+X"), Dof(1, "+Z")))
    wall = Matrices(np.diag([1e6, 1e6]), np.diag([1e16, 1e16]), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, FC, 1.0)
    return BeamModel(host, wall, (joint,), Damping(), "oscillator")


def bouc_wen(n, gamma):
    return lambda phi: 1 - abs(phi) ** n * (gamma + (1 - gamma) * np.sign(phi))


def valanis(kappa):
    return lambda phi: (1 - phi) / (1 - kappa * phi)


CASES = {
    "bouc wen, n = 1, gamma = -1/2": (BoucWen(1.0, K, 1.0, -0.5), bouc_wen(1.0, -0.5)),
    "bouc wen, n = 2, gamma = 0": (BoucWen(1.0, K, 2.0, 0.0), bouc_wen(2.0, 0.0)),
    "bouc wen, n = 1.5, gamma = 0.4": (BoucWen(1.0, K, 1.5, 0.4), bouc_wen(1.5, 0.4)),
    "valanis, kappa = 0": (Valanis(1.0, K, 0.0), valanis(0.0)),
    "valanis, kappa = 0.8": (Valanis(1.0, K, 0.8), valanis(0.8)),
}


def released(rate, load, duration, samples):
    """Displacement after a slow load is let go, from x'' = -(STIFFNESS x + F), dF/dx = K rate(F in its direction)."""
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}

    def pulled(x, f):
        return [K * rate(f[0] / FC)]

    # slowly: STIFFNESS x + F(x) = load, F along the virgin curve
    low, high = 0.0, load / STIFFNESS
    for _ in range(60):
        x = 0.5 * (low + high)
        force = solve_ivp(pulled, (0, x), [0.0], **options).y[0, -1]
        low, high = (x, high) if STIFFNESS * x + force < load else (low, x)

    def turned(t, y):
        return y[1]

    turned.terminal = True
    state, start, found = [x, 0.0, force], 0.0, np.empty(0)
    times = np.linspace(0, duration, samples)
    while start < duration:
        sign = 1.0 if -(STIFFNESS * state[0] + state[2]) > 0 else -1.0

        def motion(t, y, sign=sign):
            return [y[1], -(STIFFNESS * y[0] + y[2]), K * rate(sign * np.clip(y[2] / FC, -1, 1)) * y[1]]

        turned.direction = -sign
        done = solve_ivp(motion, (start, duration), state, events=turned, dense_output=True, max_step=1e-4, **options)
        end = done.t[-1] if done.status == 1 else np.inf
        inside = times[(times >= start) & (times < end)]
        found = np.append(found, done.sol(inside)[0]) if len(inside) else found
        if done.status == 0:
            break
        start, state = done.t[-1], [done.y[0, -1], 0.0, done.y[2, -1]]
    return found[:samples]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("load", [15.0, 60.0, 200.0])
def test_release_from_a_slow_load(name, load):
    """True error below the stated one, and below the tolerance asked for."""
    law, rate = CASES[name]
    run = snapback(oscillator(law), load, "1:+X", 0.05, ["1:+X"], sampling_rate=20_000.0, tolerance=1e-4)
    truth = released(rate, load, 0.05, len(run.times))
    error = np.abs(run.displacements[0] - truth).max() / np.abs(truth).max()
    assert error <= max(run.error_estimate, 1e-6) <= 1.1e-4
    assert run.energy.error <= 1e-6 and run.energy.friction[-1] > 0


@pytest.mark.parametrize("chi", [-0.9, -0.5, 0.0, 0.5, 1.0])
@pytest.mark.parametrize("beta", [0.0, 0.7])
def test_iwan_against_its_density(chi, beta):
    """Force on first loading, integral of phi rho up to u and u times that of rho beyond, and the loss per cycle, four
    times the integral of (A - phi) phi rho; the springs err by their number squared."""
    scale = beta + (chi + 1) / (chi + 2)
    largest = FC * (1 + beta) / (K * scale)
    density = FC * (chi + 1) / (largest ** (chi + 2) * scale)
    last = FC / largest * beta / scale
    assert density * largest ** (chi + 1) / (chi + 1) + last == pytest.approx(K)

    def force(u):
        slid = density * min(u, largest) ** (chi + 2) / (chi + 2) + (last * largest if u > largest else 0.0)
        stuck = density * (largest ** (chi + 1) - u ** (chi + 1)) / (chi + 1) + last if u <= largest else 0.0
        return slid + u * stuck

    ways = largest * np.array([0.05, 0.2, 0.5, 0.9, 1.3])
    errors = {}
    for springs in (30, 60, 120):
        law = ModifiedIwan(1.0, K, chi, beta, springs)
        found = drive(law, np.concatenate([[0.0], ways]), FC, 1.0)[1:]
        errors[springs] = np.abs(found / np.array([force(u) for u in ways]) - 1).max()
    assert errors[60] < 3e-3 and errors[120] < errors[30] / 6
    for amplitude in ways[:3]:
        exact = 4 * quad(lambda x, a=amplitude: (a - x) * density * x ** (chi + 1), 0, amplitude, epsabs=0)[0]
        assert iwan_area(K, FC, amplitude, chi, beta) == pytest.approx(exact, rel=1e-6)
        assert loop(ModifiedIwan(1.0, K, chi, beta, 120), FC, amplitude).area == pytest.approx(exact, rel=0.01)


def test_loss_of_iwan_in_microslip_grows_with_the_power_3_plus_chi():
    for chi in (-0.7, 0.0, 0.6, 1.0):
        amplitudes = np.geomspace(0.1, 0.8, 7) * FC / K
        areas = [loop(ModifiedIwan(1.0, K, chi, 1.0, 200), FC, a).area for a in amplitudes]
        assert np.polyfit(np.log(amplitudes), np.log(areas), 1)[0] == pytest.approx(3 + chi, abs=0.01)


@pytest.mark.parametrize("chi", [-1.0, -1.5, 1.0001, float("nan"), float("inf")])
def test_exponents_that_make_no_density_are_refused_in_one_sentence(chi):
    """At -1 and below the slip forces have no finite sum of stiffnesses."""
    with pytest.raises(InputError, match=r"got chi .*, expected above -1 and up to 1") as refused:
        ModifiedIwan(0.3, K, chi)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BoucWen(0.3, K, 0.0), "got exponent 0, expected above 0"),
        (lambda: BoucWen(0.3, K, 1.0, 0.6), "got gamma 0.6, expected -1 or more and up to 0.5"),
        (lambda: BoucWen(0.3, K, float("nan")), "got exponent nan"),
        (lambda: Valanis(0.3, K, 1.0), "got kappa 1, expected 0 or more and up to 0.999"),
    ],
)
def test_bad_parameters_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_limits_of_the_laws_are_the_laws_there_were():
    path = np.cumsum(np.random.default_rng(3).normal(size=200)) * 0.7 * FC / K
    same = [
        (BoucWen(1.0, K, 3.0, 0.5), RegularisedMasing(1.0, K, 3.0), 1e-12),
        (Valanis(1.0, K, 0.0), dahl(), 1e-10),
        (Valanis(1.0, K, 0.999), Masing(1.0, K), 0.03),
        (ModifiedIwan(1.0, K, -0.4, 0.3), Iwan(1.0, K, -0.4, 0.3), 1e-12),
        (ModifiedIwan(1.0, K, 0.5, 1e6, 60), Masing(1.0, K), 1e-5),
    ]
    for law, other, tolerance in same:
        np.testing.assert_allclose(drive(law, path, FC, 1.0), drive(other, path, FC, 1.0), atol=tolerance * FC)


def dahl():
    return FrictionLaw("dahl", 1.0, K, (("shape", 1.0),))


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


def clip_below(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -p0 * limit), p0 * limit)


def test_several_laws_of_ones_own_rub_side_by_side():
    """A clip and one at a share of the slip force are two Masing springs: motion in time and steady states are theirs."""
    one, other = register_law("clip, alone", clip), register_law("clip, below", clip_below)

    def side_by_side(first, second):
        model = oscillator(first)
        return replace(model, joints=(model.joints[0], replace(model.joints[0], name="other", law=second)))

    own = side_by_side(one(1.0, K), other(1.0, 0.5 * K, 0.4))
    springs = side_by_side(Masing(1.0, K), Masing(0.4, 0.5 * K))
    runs = [snapback(model, 150.0, "1:+X", 0.05, ["1:+X"], sampling_rate=10_000.0) for model in (own, springs)]
    np.testing.assert_allclose(runs[0].displacements, runs[1].displacements, atol=1e-9 * runs[1].displacements.max())
    assert runs[0].energy.friction[-1] > 0.1 * runs[0].energy.total[0] and runs[0].energy.error <= 1e-9
    states = [frf(model, np.array([100.0, 120.0]), 60.0, "1:+X", ["1:+X"]) for model in (own, springs)]
    assert states[0].converged.all()
    np.testing.assert_allclose(states[0].values[:, 0, 0], states[1].values[:, 0, 0], rtol=5e-3)


@pytest.mark.parametrize(
    "law", [BoucWen(1.0, K, 1.0, -0.5), Valanis(1.0, K, 0.8), ModifiedIwan(1.0, K, 0.8)], ids=lambda law: law.name
)
def test_a_steady_state_is_that_of_the_motion_in_time(law):
    """First harmonic of the oscillator driven at 120 Hz with 60 N, after 60 periods."""
    frequency, cycles, per = 120.0, 60, 400
    model = oscillator(law)
    times = np.arange(cycles * per + 1) / (frequency * per)
    force = 60.0 * np.cos(2 * np.pi * frequency * times)
    run = respond(model, force[None], ["1:+X"], frequency * per, ["1:+X"], tolerance=1e-4)
    last = run.displacements[0, -per - 1 : -1]
    first = 2 / per * np.sum(last * np.exp(-2j * np.pi * np.arange(per) / per))
    found = frf(model, np.array([frequency]), 60.0, "1:+X", ["1:+X"])
    assert found.converged.all()
    assert abs(found.values[0, 0, 0] - first) <= 5e-3 * abs(first)
