"""Semi-active normal force on the double beam: amplitude-scheduled against the best constant force.

Gaul, Roseira and Becker, Shock and Vibration 15 (2008), Sec. 1: the most energy is dissipated just before sticking.
Reference set with 0.1 % damping, 20 N, all runs from the same slid initial state.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.errors import InputError
from ema.simulate import Masing, controlled_snapback, double_beam
from ema.simulate.control import Actuator, AmplitudeScheduled, BangBang, ReleasePulse, constant

TIP = "beam 2:20:+Z"
START = 100.0
TURN = 4.69e-3


def run(law, mu=0.3, lag=0.0, load=20.0, duration=1.0):
    model = double_beam(Masing(mu, 1e9), START, damping=Damping(mass_factor=0.126))
    actuator = Actuator(5e-4, lag, (0.0, 2e4))
    return controlled_snapback(model, law, load, TIP, duration, actuator, step=2.5e-5, start_force=START)


def integral(response):
    share = response.energy.total / response.energy.total[0]
    return float(np.sum(0.5 * (share[1:] + share[:-1])) * response.times[1])


def settled(response, level):
    """Last time at which the tip is further than ``level`` of its largest displacement from rest."""
    tip = np.abs(response.displacements[0])
    above = np.flatnonzero(tip > level * tip.max())
    return float(response.times[above[-1]])


@pytest.fixture(scope="module")
def constants():
    return {force: run(constant(force)) for force in (200.0, 300.0, 500.0, 800.0, 1200.0, 1700.0, 2500.0)}


def test_scheduled_force_beats_every_constant_one(constants):
    best = min(integral(response) for response in constants.values())
    scheduled = run(AmplitudeScheduled(3000.0, TURN), lag=1e-3)
    slow = run(AmplitudeScheduled(3000.0, TURN), lag=2e-3)
    assert integral(scheduled) <= 0.5 * best
    assert integral(slow) <= 0.5 * best
    assert settled(scheduled, 0.02) * 3 <= min(settled(response, 0.02) for response in constants.values())


def test_no_controller_adds_energy(constants):
    laws = (AmplitudeScheduled(3000.0, TURN), ReleasePulse(3000.0), BangBang(2000.0))
    for response in (*constants.values(), *(run(law, lag=1e-3, duration=0.4) for law in laws)):
        assert response.energy.error <= 1e-6
        assert np.diff(response.energy.total).max() <= 1e-9 * response.energy.total[0]
    assert run(ReleasePulse(3000.0), duration=0.1).energy.projection[-1] > 0


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_scheduled_force_is_robust_against_the_friction_coefficient(constants, factor):
    best = min(constants, key=lambda force: integral(constants[force]))
    fixed = run(constant(best), mu=0.3 * factor)
    assert integral(run(AmplitudeScheduled(3000.0, TURN), mu=0.3 * factor, lag=1e-3)) <= 0.6 * integral(fixed)


def test_bad_controllers_get_a_sentence():
    with pytest.raises(InputError, match="returns no number"):
        run(lambda seen: float("nan"), duration=0.01)
    with pytest.raises(InputError, match="wrong number"):
        run(lambda seen: [1.0, 2.0, 3.0], duration=0.01)
    with pytest.raises(InputError, match="lag"):
        run(constant(1.0), lag=-1.0, duration=0.01)
