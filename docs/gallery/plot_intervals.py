"""
What a 95 % interval holds
==========================

Three modes of a free plate, FRFs with 2 % of noise, and the fit without a hint. The truth is known here, so the error of
each frequency can be compared with the uncertainty that the fit states.
"""

from dataclasses import replace

import numpy as np

import ema
from ema.examples import plate

truth, points = plate()
lines = np.arange(60.0, 230.0, 0.25)
exact = ema.synthesis.frfs(truth, lines, "accelerance")
random = np.random.default_rng(7)
noise = 0.02 * np.sqrt(np.mean(np.abs(exact.values) ** 2))
shake = random.normal(size=(2, *exact.values.shape)) / np.sqrt(2)
frfs = replace(
    exact, values=exact.values + noise * (shake[0] + 1j * shake[1]), variance=np.full(exact.values.shape, noise**2)
)

# %%
# The fit, and the FRFs that its modes give.

modes = ema.fit.modes(frfs, ema.fit.stabilise(frfs))
again = ema.synthesis.frfs(modes, lines, "accelerance")
picture = ema.show.reconstruction(frfs, again, [(0, 0), (17, 0)], modes=modes)

# %%
# Errors over stated standard uncertainties: about one, and hardly ever above three.

pull = (modes.natural_frequencies - truth.natural_frequencies) / np.sqrt(modes.covariance[:, 0, 0])
print("errors of the frequencies over their stated uncertainty:", pull.round(2))
assert len(modes.poles) == 3
assert np.all(np.abs(pull) < 4)

# %%
# Shapes: MAC with the true ones.

mac = ema.shapes.mac(modes, truth)
matrix = ema.show.mac_matrix(mac, row_label="Fitted", column_label="True")
assert np.all(np.diag(mac) > 0.99)
