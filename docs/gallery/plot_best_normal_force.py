"""
How hard to press
=================

At a given amplitude X friction loses most energy per cycle where the contact slips just enough: a Masing element at
:math:`X = 2 F_C / k`, from :math:`\\partial/\\partial F_C\\,[4 F_C (X - F_C/k)] = 0`. The damping ratio is largest a little
earlier, since a contact that is pressed harder also stiffens the structure.
"""

import numpy as np
from matplotlib.figure import Figure

import ema
from ema.data import BeamModel, Damping, Joint, Matrices
from ema.dof import Dof

mass, spring, contact, amplitude, friction = 2.0, 8e5, 4e5, 1e-4, 0.5  # kg, N/m, N/m, m, -
law = ema.simulate.Masing(friction, contact)
body = Matrices(np.diag([mass, mass]), np.diag([spring, 2e9]), (Dof(1, "+X"), Dof(1, "+Z")))
wall = Matrices(1e3 * np.eye(2), 1e16 * np.eye(2), (Dof(1, "+X", "wall"), Dof(1, "+Z", "wall")))
forces = np.linspace(8.0, 96.0, 12)
damping = []
for force in forces:
    joint = Joint("contact", ((1, 1),), (0.0, 0.0), law, float(force), 1.0)
    model = BeamModel(body, wall, (joint,), Damping())
    mode = ema.simulate.backbone(model, [amplitude * np.sqrt(mass)], near=110.0, outputs=["1:+X"], harmonics=1)
    damping.append(float(mode.damping_ratios[0]))

# %%
# The closed form (Caughey 1960): loss over 2 pi times twice the energy, the stiffness that of the slipping element.

normal = np.linspace(8.0, 96.0, 500)
slip = np.minimum(friction * normal / contact, amplitude)
turn = np.arccos(np.clip(1 - 2 * slip / amplitude, -1, 1))
stiffness = spring + contact / np.pi * (turn - 0.5 * np.sin(2 * turn))
closed = 4 * contact * slip * (amplitude - slip) / (2 * np.pi * stiffness * amplitude**2)
picture = Figure(figsize=(9, 3.2), layout="constrained")
axes = picture.subplots()
axes.plot(normal, 100 * closed, "k--", lw=1, label="closed form")
axes.plot(forces, 100 * np.array(damping), "o", label="nonlinear mode")
axes.set_xlabel("Normal force [N]")
axes.set_ylabel("Damping ratio [%]")
legend = axes.legend()
best, most = normal[np.argmax(closed)], amplitude * contact / 2 / friction
print(f"largest damping ratio at {best:.1f} N, most energy lost at {most:.1f} N")
assert np.allclose(damping, np.interp(forces, normal, closed), atol=1e-4)
assert best < most
