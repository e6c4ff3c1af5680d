"""Every law in every solver: the energy of a run in time and the power of a steady state balance.

Limits of the simulator: 1e-6 of the energy in time, 1e-4 of the input power in steady states, and the reference mode
refuses what it does not follow.
"""

from dataclasses import replace

import numpy as np
import pytest

from ema.data import Damping, EnergyBalance
from ema.elements import Section
from ema.errors import InputError
from ema.simulate import (
    BoucWen,
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ModifiedIwan,
    ParallelMasing,
    RegularisedMasing,
    RoughContact,
    Valanis,
    controlled_snapback,
    double_beam,
    frf,
    hammer_pulse,
    register_law,
    respond,
    snapback,
    snapback_reference,
    swept_sine,
)
from ema.simulate.control import ReleasePulse
from ema.simulate.events import Harmonic, run_reference
from ema.simulate.transient import ENERGY_LIMIT, energy_findings, prepare, released

TIP, MU, K = "beam 2:2:+Z", 0.3, 1e8
SHARES = ([0.5, 0.3, 0.2], [0.2, 0.3, 0.5])


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


LAWS = {
    "masing": lambda: Masing(MU, K),
    "coulomb": lambda: Coulomb(MU, 10 * K),
    "parallel masing": lambda: ParallelMasing(MU, K, *SHARES),
    "iwan": lambda: Iwan(MU, K, springs=20),
    "rough contact": lambda: RoughContact(MU, 300 / K, springs=20, reference_force=300.0),
    "regularised masing, m = 8": lambda: RegularisedMasing(MU, K, 8.0),
    "regularised masing, m = 1.5": lambda: RegularisedMasing(MU, K, 1.5),
    "bouc wen": lambda: BoucWen(MU, K, 1.5, -0.3),
    "modified iwan": lambda: ModifiedIwan(MU, K, 0.8, springs=20),
    "valanis": lambda: Valanis(MU, K),
    "dahl": lambda: Dahl(MU, K),
    "lugre": lambda: LuGre(MU, K, 30.0, 5.0, 1.3, 1e-3),
    "a user's own": lambda: register_law("clip of the energy table", clip)(MU, K),
}
PIECEWISE = ("masing", "coulomb", "parallel masing", "iwan", "modified iwan", "rough contact")
DURATION, RATE = 0.03, 5000.0
TIMES = np.arange(round(DURATION * RATE) + 1) / RATE


def model(law):
    return double_beam(LAWS[law](), 300.0, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(mass_factor=4.0))


def breathing(time):
    return 300.0 * (1 + 0.6 * np.sin(700 * time))


def forced(m, force):
    return respond(m, force[None], [TIP], RATE, [TIP], tolerance=1e-2)


IN_TIME = {
    "snap-back": lambda m: snapback(m, 20.0, TIP, DURATION, tolerance=1e-2),
    "snap-back, F_N(t)": lambda m: snapback(m, 20.0, TIP, DURATION, tolerance=1e-2, normal_forces=breathing),
    "swept": lambda m: forced(m, swept_sine(TIMES, 20.0, (10.0, 200.0), DURATION)),
    "blow": lambda m: forced(m, hammer_pulse(TIMES, 80.0, 5e-3, 1e-3)),
    "random": lambda m: forced(m, 20.0 * np.random.default_rng(5).normal(size=len(TIMES))),
    "controlled": lambda m: controlled_snapback(m, ReleasePulse(300.0, 2e-3), 20.0, TIP, DURATION, step=5e-5),
}


@pytest.mark.parametrize("solver", IN_TIME)
@pytest.mark.parametrize("law", LAWS)
def test_energy_in_time(law, solver):
    run = IN_TIME[solver](model(law))
    assert run.energy.error <= 1e-6
    assert "energy-balance" not in {finding.code for finding in run.findings}
    assert run.energy.friction[-1] > 0 and run.energy.damping[-1] > 0


def test_a_balance_that_does_not_close_is_a_finding():
    """Two millionths of the initial energy too much, at one sample."""
    falling = np.linspace(1.0, 0.5, 6)
    books = {name: np.zeros(6) for name in ("contact", "damping", "projection", "supplied")}
    good = EnergyBalance(mechanical=falling, friction=1.0 - falling, **books)
    bad = replace(good, friction=1.0 - falling + 2e-6 * (np.arange(6) == 4))
    assert energy_findings(good, "beam", ENERGY_LIMIT) == []
    (finding,) = energy_findings(bad, "beam", ENERGY_LIMIT)
    assert (finding.severity, finding.code, finding.where) == ("error", "energy-balance", "beam")
    assert finding.value == pytest.approx(2e-6, rel=1e-6) and finding.limit == 1e-6 and finding.advice


@pytest.mark.parametrize("law", LAWS)
def test_energy_in_the_reference_mode(law):
    free = double_beam(LAWS[law](), 300.0, Section(0.5, 0.04, 0.005, elements=2))
    if law not in PIECEWISE:
        with pytest.raises(InputError, match="Masing-type laws only"):
            snapback_reference(free, 20.0, TIP, DURATION)
        return
    run = snapback_reference(free, 20.0, TIP, DURATION)
    assert run.energy.error <= 1e-6 and run.energy.friction[-1] > 0


@pytest.mark.parametrize("law", PIECEWISE)
@pytest.mark.parametrize("mass_factor", [0.0, 4.0, 60.0])
def test_energy_of_the_reference_mode_with_damping_and_a_harmonic_load(law, mass_factor):
    """Loss to damping and work of the load are booked in closed form, phase by phase."""
    held = double_beam(
        LAWS[law](), 300.0, Section(0.5, 0.04, 0.005, elements=2), damping=Damping(mass_factor=mass_factor)
    )
    problem = prepare(held, [TIP])
    state = released(problem, 20.0, problem.outputs[0])
    for load in (None, Harmonic(10.0, 30.0, problem.outputs[0], 0.3)):
        run = run_reference(problem, state, DURATION, RATE, None, load)
        assert run.energy.error <= 1e-9
        assert (run.energy.damping[-1] > 0) == (mass_factor > 0)
        assert (run.energy.supplied[-1] != 0) == (load is not None)
        assert np.diff(run.energy.damping).min() >= -1e-15
    if mass_factor:
        # the loss is 2 half times the integral of twice the kinetic energy, here by quadrature over the samples
        every = [str(dof) for dof in problem.system.dofs]
        shown = prepare(held, every)
        run = run_reference(shown, state, DURATION, 200_000.0, None, Harmonic(10.0, 30.0, problem.outputs[0], 0.3))
        power = mass_factor * np.einsum("it,ij,jt->t", run.velocities, problem.system.mass, run.velocities)
        lost = np.sum(0.5 * (power[1:] + power[:-1])) * run.times[1]
        assert run.energy.damping[-1] == pytest.approx(lost, rel=1e-3)
        row = [str(dof) for dof in shown.outputs].index(str(problem.outputs[0]))
        push = 10.0 * np.cos(2 * np.pi * 30.0 * run.times + 0.3) * run.velocities[row]
        work = np.sum(0.5 * (push[1:] + push[:-1])) * run.times[1]
        assert run.energy.supplied[-1] == pytest.approx(work, rel=1e-3)


@pytest.mark.parametrize("law", LAWS)
def test_power_of_steady_states(law):
    found = frf(model(law), np.array([18.0, 22.0, 27.0, 33.0]), 2.0, TIP, [TIP])
    assert found.converged.all() and np.all(found.friction_power > 0)
    assert found.power_error <= 1e-4
