"""
Loops of friction laws
======================

Force over relative displacement of three laws of one slip force and one stiffness. The loop of the Masing element
(Jenkins element: a spring that slips) has the area :math:`4 F_C (X - F_C / k)`, which is the work lost per cycle.
"""

import numpy as np

import ema
from ema.simulate.loops import drive

slip_force, stiffness, reach = 30.0, 4e5, 3.0e-4  # N, N/m, m
phase = np.linspace(0, 6 * np.pi, 60001)
times = phase / (2 * np.pi)
displacement = reach * np.sin(phase)
laws = {
    "Masing": ema.simulate.Masing(1.0, stiffness),
    "Dahl": ema.simulate.Dahl(1.0, stiffness),
    "Bouc-Wen": ema.simulate.BoucWen(1.0, stiffness, 2.0, 0.1),
}
loops = [
    ema.simulate.measured_loop(times, displacement, drive(law, displacement, slip_force), 1.0, slip_force, cycles=1)
    for law in laws.values()
]
picture = ema.show.hysteresis(loops, list(laws))

# %%
# The area against the closed form (Caughey 1960).

closed = 4 * slip_force * (reach - slip_force / stiffness)
print(f"Masing: {loops[0].area:.6f} J, closed form {closed:.6f} J")
assert abs(loops[0].area / closed - 1) < 1e-3
