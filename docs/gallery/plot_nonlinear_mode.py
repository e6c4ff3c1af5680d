"""
Frequency and damping over the amplitude
========================================

One mass on a spring that rubs on a wall. The more it moves the more the contact slips: the frequency falls, the damping
rises to a maximum and falls again. With one harmonic the nonlinear mode is that of Caughey (1960), in closed form.
"""

import numpy as np

import ema
from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof

mass, spring, contact, slip_force = 2.0, 8e5, 4e5, 30.0  # kg, N/m, N/m, N
law = ema.simulate.Masing(1.0, contact)
body = Matrices(np.diag([mass, mass]), np.diag([spring, 2e9]), (Dof(1, "+X"), Dof(1, "+Z")))
wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, slip_force, 1.0)
model = BeamModel(body, wall, (joint,), Damping(), "mass on a wall")

amplitudes = np.geomspace(0.5, 40, 25) * slip_force / contact * np.sqrt(mass)  # m sqrt(kg)
mode = ema.simulate.backbone(model, amplitudes, near=120.0, outputs=["1:+X"], harmonics=1)
picture = ema.show.plot(mode)

# %%
# The closed form: equivalent stiffness and loss of a Masing element at amplitude X.

ratio = np.maximum(amplitudes / np.sqrt(mass) * contact / slip_force, 1.0)
turn = np.arccos(1 - 2 / ratio)
equivalent = contact / np.pi * (turn - 0.5 * np.sin(2 * turn))
omega = np.sqrt((spring + equivalent) / mass)
loss = 4 * slip_force * (amplitudes / np.sqrt(mass) - slip_force / contact) * (ratio > 1)
damping = loss / (2 * np.pi * omega**2 * amplitudes**2)
picture.axes[0].plot(amplitudes, omega / (2 * np.pi), "k--", lw=1, label="closed form")
picture.axes[1].plot(amplitudes, 100 * damping, "k--", lw=1)
legend = picture.axes[0].legend()
assert np.allclose(mode.frequencies, omega / (2 * np.pi), rtol=1e-3)
assert np.allclose(mode.damping_ratios, damping, atol=1e-4)
print(f"largest damping {100 * damping.max():.2f} % at {ratio[np.argmax(damping)]:.2f} times the slip limit")
