"""A measured modal model as host gives what its matrices give."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh, expm

from ema.data import Damping, ModalModel, Residuals, poles_from
from ema.elements import Section
from ema.errors import InputError
from ema.estimate import phases, ring_down
from ema.simulate import HarmonicBalance, Masing, double_beam, frf, resonance, respond, snapback, snapback_reference
from ema.simulate.flow import joint_coefficients
from ema.simulate.harmonic import condense
from ema.simulate.reduction import modal_base, stuck_stiffness
from ema.simulate.structure import assemble

TIP = "beam 1:6:+Z"
LAW = Masing(0.3, 1e9)


def measured(matrices, count=None, ratio=0.0, residual=False):
    """The modal model a perfect test of a structure would give: its lowest modes, and the rest as residual."""
    squares, shapes = eigh(matrices.stiffness, matrices.mass)
    keep = slice(0, count)
    omega, phi = np.sqrt(squares[keep]), shapes[:, keep]
    poles = poles_from(omega / (2 * np.pi), np.full(len(omega), ratio))
    rest = np.linalg.inv(matrices.stiffness) - (phi / omega**2) @ phi.T
    residuals = Residuals(np.zeros_like(rest, complex), rest.astype(complex)) if residual else None
    return ModalModel(
        poles, phi.astype(complex), matrices.dofs, phi / (2j * poles.imag), matrices.dofs, residuals, "unit modal mass"
    )


def models(count=None, ratio=0.0, residual=False, force=1000.0):
    plain = double_beam(LAW, force, Section(0.5, 0.04, 0.005, elements=6))
    return plain, replace(plain, host=measured(plain.host, count, ratio, residual))


def test_all_modes_are_the_structure():
    plain, modal = models()
    np.testing.assert_allclose(
        modal_base(assemble(modal)).frequencies, modal_base(assemble(plain)).frequencies, rtol=1e-6
    )
    one, two = (snapback(m, 20.0, TIP, 0.05) for m in (plain, modal))
    np.testing.assert_allclose(two.displacements, one.displacements, atol=2e-3 * one.displacements.max())
    assert two.energy.error <= 1e-6


def test_few_modes_need_their_residual():
    plain, bare = models(6)
    _, full = models(6, residual=True)
    exact, without, with_rest = (modal_base(assemble(m)).frequencies[0] for m in (plain, bare, full))
    assert abs(with_rest / exact - 1) < 2e-3
    assert abs(with_rest / exact - 1) < 0.2 * abs(without / exact - 1)


def test_the_damping_of_the_host_arrives():
    plain, modal = models(ratio=0.02, force=0.0)
    damped = replace(plain, damping=Damping(ratio=0.02))
    sliding = resonance(modal, 1.0, TIP, TIP, (14.0, 19.0))
    assert sliding.frequency == pytest.approx(16.71, rel=2e-3)
    # host and beam move alike, only the host is damped
    assert sliding.damping == pytest.approx(0.01, rel=1e-3)
    assert resonance(damped.with_normal_force(1e6), 1.0, TIP, TIP, (25.0, 36.0)).damping == pytest.approx(
        0.02, rel=0.02
    )


def test_modes_that_damping_couples_move_as_the_whole_equation_says():
    random = np.random.default_rng(5)
    frequencies, h = np.array([0.0, 40.0, 900.0, 2.5e4]), 3e-3
    root = random.standard_normal((4, 4)) * np.sqrt([3.0, 8.0, 60.0, 4000.0])[:, None]
    damping = root @ root.T
    (way, velocity), form = joint_coefficients(frequencies, damping, h)
    q, p, force = random.standard_normal((3, 4)) / np.array([[1e4], [1.0], [1.0]])
    x = np.concatenate([p, force - frequencies**2 * q])
    one, zero = np.eye(4), np.zeros((4, 4))
    rates = np.block([[zero, one, zero], [-np.diag(frequencies**2), -damping, one], [zero, zero, zero]])
    truth = expm(rates * h) @ np.concatenate([q, p, force])
    q1, p1 = q + way @ x, velocity @ x
    np.testing.assert_allclose(q1, truth[:4], atol=1e-11 * np.abs(q).max())
    np.testing.assert_allclose(p1, truth[4:8], atol=1e-11 * np.abs(p).max())
    energy = [0.5 * (b @ b + (frequencies * a) @ (frequencies * a)) for a, b in ((q, p), (q1, p1))]
    assert x @ form @ x == pytest.approx(energy[0] - energy[1] + force @ (q1 - q), rel=1e-10)


def test_the_damping_of_the_host_arrives_in_time():
    sliding = models(ratio=0.02, force=0.0)[1]
    free = snapback(sliding, 1.0, TIP, 1.0)
    decay = ring_down(free, band=(8.0, 45.0))
    phase = max(phases(decay), key=lambda one: one.cycles)
    assert (phase.frequency, phase.damping) == pytest.approx((16.71, 0.01), rel=3e-3)
    assert free.energy.error <= 1e-9
    slipping = snapback(models(ratio=0.02)[1], 20.0, TIP, 0.1)
    assert slipping.energy.error <= 1e-9 and slipping.error_estimate <= 1e-3
    assert slipping.energy.friction[-1] > 0.01 * slipping.energy.mechanical[0]
    finer = snapback(models(ratio=0.02)[1], 20.0, TIP, 0.1, tolerance=2e-5)
    wrong = np.abs(slipping.displacements - finer.displacements).max() / np.abs(finer.displacements).max()
    assert wrong <= slipping.error_estimate


def test_time_and_steady_states_agree_on_a_host_whose_damping_couples_modes():
    model = models(ratio=0.02, force=150.0)[1]
    frequency, rate = 20.0, 2000.0
    steady = frf(model, np.array([frequency]), 1.0, TIP, [TIP], settings=HarmonicBalance(tolerance=1e-3))
    times = np.arange(round(3.0 * rate)) / rate
    run = respond(model, (np.minimum(5 * times, 1) * np.cos(2 * np.pi * frequency * times))[None], [TIP], rate, [TIP])
    last = slice(-round(10 * rate / frequency), None)
    settled = 2 * np.mean(run.displacements[0, last] * np.exp(-2j * np.pi * frequency * times[last]))
    assert settled == pytest.approx(steady.values[0, 0, 0], rel=3e-3)


@pytest.mark.parametrize("normal_forces", [None, np.array([[150.0, 120.0, 100.0, 120.0]])])
def test_receptances_where_damping_couples_modes(normal_forces):
    """Against the inverse of stiffness - w^2 mass + j w damping in the coordinates of host and beam, at every harmonic,
    in whatever order frequencies and numbers of harmonics are asked for, and at another level of the force."""
    solver = condense(models(ratio=0.02, force=150.0)[1], 3.0, TIP, [TIP], 1e-3, normal_forces=normal_forces)
    system, base = solver.problem.system, solver.problem.base
    stiffness, damping = stuck_stiffness(system, solver.stiffness), np.diag(system.decay * np.diag(system.mass))
    slip, random = system.contacts.slip, np.random.default_rng(2)
    for omega, count in ((90.0, 3), (310.0, 2), (90.0, 7), (55.0, 2), (120.0, 4), (77.0, 2), (90.0, 2), (310.0, 5)):
        for level in (solver, solver.at(0.5, solver.limits)):
            forces = random.normal(size=(count, len(slip), 2)) @ [1, 1j]
            gains, motions = level.gains(omega, count), level.motions(omega, forces)
            for n, order in enumerate(level.orders(count)):
                w = omega * order
                whole = np.linalg.inv(stiffness - w**2 * system.mass + 1j * w * damping)
                expected = slip @ whole @ slip.T
                found = gains[0, n] + 1j * gains[1, n]
                np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
                moved = whole @ ((order == 1) * level.force * system.row(TIP) - slip.T @ forces[n])
                np.testing.assert_allclose(base.shapes @ motions[n], moved, atol=1e-9 * np.abs(moved).max())


def test_the_reference_mode_refuses_damping_that_it_does_not_follow():
    with pytest.raises(InputError, match="mass-proportional"):
        snapback_reference(models(ratio=0.02)[1], 1.0, TIP, 0.01)


def test_bad_hosts_get_a_sentence():
    _, modal = models(4, ratio=0.02)
    with pytest.raises(InputError, match="scaled shapes"):
        assemble(replace(modal, host=replace(modal.host, scaling="unscaled")))
    with pytest.raises(InputError, match="negative damping"):
        assemble(replace(modal, host=replace(modal.host, poles=np.conj(-modal.host.poles))))
    whole = models(4, residual=True)[1].host
    rest = Residuals(whole.residuals.lower[:, :1], whole.residuals.upper[:, :1])
    lonely = replace(whole, inputs=whole.inputs[:1], participation=whole.participation[:1], residuals=rest)
    assert "no-residuals" in {finding.code for finding in assemble(replace(modal, host=lonely)).findings}
