"""
From a hammer test to modes
===========================

A virtual steel table with a friction beam, struck at 82 points with two accelerometers on it; both joints are pressed by
1.02 kN. One impact was too hard for the range of the force channel: it is left out and named.
"""

import acquisition
import ema

folder = ema.datasets.fetch("virtual_table_hammer")
campaign = acquisition.open_campaign(folder)
run = campaign["beam_1kN"]

# %%
# The impacts: pulses that were accepted, those that were not and why, and the peak of each.

frfs, gallery = ema.estimate.hammer_test(run)
rejected = sorted({hit.reason for hit in gallery.hits if not hit.accepted})
print(f"{len(gallery.hits)} impacts, left out: {rejected}")
impacts = ema.show.hits(gallery)
assert len(rejected) == 1 and "overloaded" in rejected[0]

# %%
# FRFs of the band, and poles of models of growing order.

band = frfs.band(200, 1350)
poles = ema.fit.stabilise(band)
diagram = ema.show.stabilisation(poles)

# %%
# Modes are selected from the poles without anything given; they come with 95 % intervals.

modes = ema.fit.modes(band, poles)
print(modes.table().to_string())
overview = ema.show.frf_overview(band, modes)
shapes = ema.show.plot(modes, geometry=campaign.geometry, modes=[0, 1, 2])

# %%
# The table was made with a mode of 492.0 Hz and 1.80 % at this normal force.

assert abs(modes.natural_frequencies[0] - 492.0) < 0.05
assert abs(100 * modes.damping_ratios[0] - 1.80) < 0.01
