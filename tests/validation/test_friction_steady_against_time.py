"""Steady states by harmonic balance, at the peak and on both flanks, against the exact solver in time once it has settled.

Double beam of Gaul, Roseira and Becker, Shock and Vibration 15 (2008), six elements. The run in time starts from the
harmonic solution and goes on for eight time constants of the damping, so that it is at its own steady state at the end.
"""

import numpy as np
import pytest

from ema.data import Damping
from ema.elements import Section
from ema.simulate import Masing, double_beam, resonance
from ema.simulate.events import Harmonic, run_reference
from ema.simulate.harmonic import condense
from ema.simulate.transient import _State

TIP, PERIOD, SETTLED = "beam 2:6:+Z", 64, 8.0


def start_of(condensed, point):
    """State at the start of a period of a harmonic solution; the friction forces from two periods of its slips."""
    orders, x, base = condensed.orders(point.count), condensed.modal(point), condensed.problem.base
    q, p = x.real.sum(axis=0), -(point.omega * orders[:, None] * x.imag).sum(axis=0)
    angle = 2 * np.pi * np.arange(4096)[:, None] / 4096 * orders
    motion = np.cos(angle) @ point.amplitudes[:, ::2].T + np.sin(angle) @ point.amplitudes[:, 1::2].T
    force, before = np.zeros(motion.shape[1]), np.zeros(motion.shape[1])
    for u in np.concatenate([motion, motion, motion[:1]]):
        force = np.clip(force + condensed.stiffness * (u - before), -condensed.limits, condensed.limits)
        before = u
    memory = np.zeros((len(force), 3))
    memory[:, 0] = force
    return _State(q, p, base.slip @ q, force, memory)


def both(model, frequency):
    """First harmonic at the tip by harmonic balance and by the settled exact run, which is seen to be settled."""
    condensed = condense(model, 1.0, TIP, [TIP], 2e-3, None)
    point = condensed.solve(frequency)
    periods = round(SETTLED * frequency)
    run = run_reference(
        condensed.problem,
        start_of(condensed, point),
        periods / frequency,
        PERIOD * frequency,
        None,
        Harmonic(1.0, frequency, condensed.driven),
    )
    wave = 2 / PERIOD * np.exp(-2j * np.pi * np.arange(PERIOD) / PERIOD)
    last = [run.displacements[0][k * PERIOD : (k + 1) * PERIOD] @ wave for k in (periods - 10, periods - 1)]
    assert abs(last[1] - last[0]) < 1e-3 * abs(last[1])
    rows = np.array([condensed.problem.base.row(condensed.problem.system, TIP)])
    return condensed.outputs(point, rows)[0, 0], last[1]


@pytest.mark.parametrize("ratio", [10.0, 100.0, 300.0, 1000.0, 5000.0])
def test_peak_within_1_percent_and_flanks_within_2(ratio):
    """F_N/F_E from well below to well above the optimum (about 250); amplitude, and amplitude with phase."""
    model = double_beam(
        Masing(0.3, 1e9), ratio, Section(0.5, 0.04, 0.005, elements=6), damping=Damping(mass_factor=2.0)
    )
    peak = resonance(model, 1.0, TIP, TIP, (14.0, 34.0), tolerance=2e-3)
    for frequency, bound in ((peak.frequency, 0.01), (0.97 * peak.frequency, 0.02), (1.03 * peak.frequency, 0.02)):
        steady, settled = both(model, frequency)
        assert abs(steady) == pytest.approx(abs(settled), rel=bound)
        assert abs(steady - settled) < 0.02 * abs(settled)
