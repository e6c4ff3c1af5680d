"""Every law in every solver: the energy of a run in time and the power of a steady state balance.

Limits of the simulator: 1e-6 of the energy in time, 1e-4 of the input power in steady states, and the reference mode
refuses what it does not follow.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.errors import InputError
from ema.simulate import (
    Coulomb,
    Dahl,
    Iwan,
    LuGre,
    Masing,
    ParallelMasing,
    RegularisedMasing,
    controlled_snapback,
    double_beam,
    frf,
    register_law,
    respond,
    snapback,
    snapback_reference,
)
from ema.simulate.control import ReleasePulse

TIP, MU, K = "beam 2:2:+Z", 0.3, 1e8
SHARES = ([0.5, 0.3, 0.2], [0.2, 0.3, 0.5])


def clip(force, du, k, limit, p0, p1, p2, p3):
    return min(max(force + k * du, -limit), limit)


LAWS = {
    "masing": lambda: Masing(MU, K),
    "coulomb": lambda: Coulomb(MU, 10 * K),
    "parallel masing": lambda: ParallelMasing(MU, K, *SHARES),
    "iwan": lambda: Iwan(MU, K, springs=20),
    "regularised masing, m = 8": lambda: RegularisedMasing(MU, K, 8.0),
    "regularised masing, m = 1.5": lambda: RegularisedMasing(MU, K, 1.5),
    "dahl": lambda: Dahl(MU, K),
    "lugre": lambda: LuGre(MU, K, 30.0, 5.0, 1.3, 1e-3),
    "a user's own": lambda: register_law("clip of the energy table", clip)(MU, K),
}
PIECEWISE = ("masing", "coulomb", "parallel masing", "iwan")
DURATION, RATE = 0.03, 5000.0
TIMES = np.arange(round(DURATION * RATE) + 1) / RATE


def model(law):
    return double_beam(LAWS[law](), 300.0, elements=2, damping=Damping(mass_factor=4.0))


def breathing(time):
    return 300.0 * (1 + 0.6 * np.sin(700 * time))


IN_TIME = {
    "snap-back": lambda m: snapback(m, 20.0, TIP, DURATION, tolerance=1e-2),
    "snap-back, F_N(t)": lambda m: snapback(m, 20.0, TIP, DURATION, tolerance=1e-2, normal_forces=breathing),
    "forced": lambda m: respond(m, 20 * np.sin(200 * TIMES)[None], [TIP], RATE, [TIP], tolerance=1e-2),
    "controlled": lambda m: controlled_snapback(m, ReleasePulse(300.0, 2e-3), 20.0, TIP, DURATION, step=5e-5),
}


@pytest.mark.parametrize("solver", IN_TIME)
@pytest.mark.parametrize("law", LAWS)
def test_energy_in_time(law, solver):
    run = IN_TIME[solver](model(law))
    assert run.energy.error <= 1e-6
    assert "energy-balance" not in {finding.code for finding in run.findings}
    assert run.energy.friction[-1] > 0 and run.energy.damping[-1] > 0


@pytest.mark.parametrize("law", LAWS)
def test_energy_in_the_reference_mode(law):
    free = double_beam(LAWS[law](), 300.0, elements=2)
    if law not in PIECEWISE:
        with pytest.raises(InputError, match="Masing-type laws only"):
            snapback_reference(free, 20.0, TIP, DURATION)
        return
    run = snapback_reference(free, 20.0, TIP, DURATION)
    assert run.energy.error <= 1e-6 and run.energy.friction[-1] > 0


@pytest.mark.parametrize("law", LAWS)
def test_power_of_steady_states(law):
    found = frf(model(law), np.array([18.0, 22.0, 27.0, 33.0]), 2.0, TIP, [TIP])
    assert found.converged.all() and np.all(found.friction_power > 0)
    assert found.power_error <= 1e-4
