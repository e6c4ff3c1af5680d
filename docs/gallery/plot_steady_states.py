"""
FRFs that depend on the force
=============================

Two cantilevers pressed together: steady states at two levels of the force, by harmonic balance. The power that the
force supplies has to be what friction and damping lose, which the solver was not told.
"""

import numpy as np

import ema

section = ema.simulate.Section(length=0.5, width=0.04, height=0.005, elements=4)
beams = ema.simulate.double_beam(ema.simulate.Masing(0.3, 1e9), normal_force=1000.0, section=section)
tip = "beam 2:4:+Z"
lines = np.linspace(24.0, 36.0, 13)
levels = [ema.simulate.frf(beams, lines, level, tip, [tip]) for level in (1.0, 10.0)]
picture = ema.show.steady_states(levels)

# %%
# The power balance of each, relative, and the height of the resonance: at the higher force the contacts slip more.

for level in levels:
    peak = np.abs(level.values[:, 0, 0]).max() / level.force
    print(f"{level.force:4.0f} N: peak {1e3 * peak:.2f} mm/N, power balance {level.power_error:.1e}")
    assert level.power_error < 1e-6
heights = [np.abs(level.values[:, 0, 0]).max() / level.force for level in levels]
assert heights[1] < 0.95 * heights[0]
