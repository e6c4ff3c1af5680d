"""Steps of the fast mode: exact over any length, whatever the damping, and the same with long strides as without."""

import math

import numpy as np
import pytest

from ema.data import Damping, EnergyBalance
from ema.dof import Dof
from ema.elements import Section
from ema.errors import CancelledError, FailureError
from ema.simulate import Masing, controlled_snapback, double_beam, loop, register_law, respond, transient
from ema.simulate.control import constant
from ema.simulate.flow import joint_coefficients, long_coefficients, own_coefficients
from ema.simulate.transient import ENERGY_LIMIT, Drive, energy_findings, integrate, prepare, refined, released

TIP = "beam 2:20:+Z"


@pytest.mark.parametrize("h", [1e-6, 1e-4, 1e-2])
def test_damping_takes_what_the_motion_loses(h):
    """Modes of 16 Hz to 115 kHz under a constant force: a step of 10 ms is up to 1100 turns long."""
    omega = 2 * np.pi * np.array([16.0, 300.0, 5e3, 115e3])
    decay = 2 * np.array([1e-4, 0.3, 0.02, 0.002]) * omega
    q, p, force = np.array([1.0, -0.5, 0.3, 0.1]), omega * np.array([0.2, 1.0, -1.0, 0.5]), omega**2 * 0.7
    flow, loss = own_coefficients(omega, decay, h)
    q1, p1 = flow[0] * q + flow[1] * p + flow[2] * force, flow[3] * q + flow[4] * p + flow[5] * force
    lost = q * (loss[0] * q + loss[1] * p + loss[2] * force) + p * (loss[3] * p + loss[4] * force) + loss[5] * force**2
    before, after = (0.5 * (p**2 + (omega * q) ** 2) for q, p in ((q, p), (q1, p1)))
    np.testing.assert_allclose(after, before + force * (q1 - q) - lost, atol=1e-12 * (before + np.abs(force * q)).max())
    assert np.all(lost > 0)


def test_long_coefficients_are_those_of_one_long_step():
    omega, decay = np.array([100.0, 3e4]), np.array([3.0, 50.0])
    tables, forms = long_coefficients(omega, decay, 1e-5, 4)
    for level in range(5):
        table, form = own_coefficients(omega, decay, 1e-5 * 2**level)
        np.testing.assert_allclose(tables[level], table, rtol=1e-14)
        np.testing.assert_allclose(forms[level], form, rtol=1e-9, atol=1e-12 * np.abs(form).max())
    np.testing.assert_allclose(
        forms[4], joint_form(omega, decay, 16e-5), rtol=1e-8, atol=1e-10 * np.abs(forms[4]).max()
    )


def joint_form(omega, decay, h):
    """The same losses from the matrix exponential, which damping that couples modes needs."""
    _, whole = joint_coefficients(omega, np.diag(decay), h)
    count = len(omega)
    pp, pr, rr = (
        np.diag(whole[a, b])
        for a, b in ((slice(count), slice(count)), (slice(count), slice(count, None)), (slice(count, None),) * 2)
    )
    # with r = force - w^2 q
    square = omega**2
    return np.array([rr * square**2, -2 * pr * square, -2 * rr * square, pp, 2 * pr, rr])


@pytest.mark.parametrize("damping", [Damping(), Damping(ratio=0.003), Damping(mass_factor=2.0)])
def test_strides_are_the_steps_they_leave_out(damping):
    """Partial slip at 4 kN: most steps are left out where every contact sticks, and nothing changes."""
    model = double_beam(Masing(0.3, 1e9), 4000.0, damping=damping)
    problem = prepare(model, [TIP])
    state = released(problem, 20.0, Dof.parse(TIP))
    h, samples = 1e-5, 400
    whole, _ = integrate(problem, state.copy(), h, 16, samples, Drive(np.zeros(1)))
    single, _ = integrate(problem, state.copy(), h, 1, 16 * samples, Drive(np.zeros(1)))
    for name, size in (("q", 1e-10), ("u", 1e-10), ("f", 1e-9), ("energy", 1e-9)):
        same = single[name][::16]
        np.testing.assert_allclose(whole[name], same, atol=size * np.abs(same).max(), err_msg=name)
    assert whole["energy"][-1, 0] > 0.1 * whole["energy"][0, 4:].sum()


def pressing(t):
    return 3000.0 + 1500.0 * np.sin(400.0 * t)


def test_forces_made_block_by_block_are_the_same(monkeypatch):
    """Loads and normal forces of the steps of one sample at a time; the run can be stopped at each of them."""
    model, tip = double_beam(Masing(0.3, 1e9), 4000.0, Section(0.5, 0.04, 0.005, elements=4)), "beam 2:4:+Z"
    push = 60.0 * np.sin(700.0 * np.arange(61) / 5000.0)[None]
    whole = respond(model, push, [tip], 5000.0, [tip], normal_forces=pressing)
    monkeypatch.setattr(transient, "_BLOCK", 1)
    told = []
    parts = respond(
        model, push, [tip], 5000.0, [tip], normal_forces=pressing, progress=lambda *where: told.append(where)
    )
    np.testing.assert_allclose(parts.displacements, whole.displacements, atol=1e-12 * np.abs(push).max())
    assert parts.energy.friction[-1] == pytest.approx(whole.energy.friction[-1], rel=1e-9)
    assert len(told) == 60 * len({done for _, done, _ in told}) and told[0][:2] == ("time steps", 0)
    with pytest.raises(CancelledError):
        respond(model, push, [tip], 5000.0, [tip], progress=lambda what, done, total: done < 1)


def test_strides_wait_for_the_end_of_a_pulse():
    """A half-sine pulse of 2 ms, then silence: the balance holds and the motion agrees with finer sampling."""
    model = double_beam(Masing(0.3, 1e9), 4000.0, Section(0.5, 0.04, 0.005, elements=6))
    tip, rate = "beam 2:6:+Z", 5000.0
    times = np.arange(301) / rate
    push = np.where(times < 2e-3, 200.0 * np.sin(np.pi * times / 2e-3), 0.0)[None]
    run = respond(model, push, [tip], rate, [tip], tolerance=1e-4)
    assert run.energy.error <= 1e-9
    fine = np.interp(np.arange(9601) / (32 * rate), times, push[0])[None]
    closely = respond(model, fine, [tip], 32 * rate, [tip], tolerance=1e-4)
    assert closely.energy.error <= 1e-9
    np.testing.assert_allclose(
        run.displacements[0], closely.displacements[0][::32], atol=3e-4 * np.abs(run.displacements).max()
    )


def test_a_balance_with_a_number_that_is_none_is_off():
    """A run that begins well and ends as NaN, or so large that its energy is infinite."""
    books = {name: np.zeros(3) for name in ("contact", "friction", "damping", "projection", "supplied")}
    for end in (np.nan, np.inf, -np.inf):
        energy = EnergyBalance(mechanical=np.array([1.0, 1.0, end]), **books)
        (finding,) = energy_findings(energy, "beam", ENERGY_LIMIT)
        assert energy.error == np.inf and finding.value == np.inf
    assert EnergyBalance(mechanical=np.zeros(3), **books | {"friction": np.array([0.0, 0.0, np.nan])}).error == np.inf


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_runs_that_are_not_finite_are_refined(lost):
    """The first two of them diverge; then the error is that of a method of second order, two of whose runs agree."""
    counts = []

    def attempt(finer):
        counts.append(finer)
        return np.array([1.0, 1.0 + 0.01 / finer**2 if finer > 2 else lost]), finer

    result, error = refined(attempt, 1e-3, 9)
    assert counts == [1, 2, 4, 8, 16] and result == 16
    assert 0.01 / 16**2 <= error <= 1e-3
    assert refined(lambda finer: (np.array([lost]), finer), 1e-3, 3) == (8, np.inf)


def test_a_motion_that_is_not_finite_is_refused():
    """Masing's law, but NaN beyond 500 N and for slip forces below 1 mN, where no law is tried before it is taken."""

    def breaking(force, du, k, limit, p0, p1, p2, p3):
        after = max(-limit, min(limit, force + k * du))
        return math.nan if abs(after) > 500.0 or 0 < limit < 1e-3 else after

    law = register_law("breaking", breaking)(0.3, 1e9)
    model, tip = double_beam(law, 1e6, Section(0.5, 0.04, 0.005, elements=4)), "beam 2:4:+Z"
    push = 60.0 * np.sin(700.0 * np.arange(41) / 5000.0)[None]
    words = r"the motion is not finite, however short the steps; got NaN .* from 0\.0.* s on, law breaking;"
    assert respond(model, 1e-3 * push, [tip], 5000.0, [tip]).energy.error <= 1e-9
    with pytest.raises(FailureError, match=words):
        respond(model, 1e3 * push, [tip], 5000.0, [tip])
    for check in (True, False):
        with pytest.raises(FailureError, match="law breaking"):
            controlled_snapback(model, constant(1e-3), 1.0, tip, duration=0.01, start_force=1e6, check=check)
    with pytest.raises(FailureError, match=r"law breaking: the law gives forces that are not finite; got NaN"):
        loop(law, 1e6, 1e-5)
    assert np.isfinite(loop(law, 1e6, 1e-9).area)
