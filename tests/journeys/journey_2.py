"""Tutorial 2: shaker runs at several excitations and normal forces become the damping map of a mode."""

import acquisition
import ema
from ema.study import mapping, recipe

campaign = acquisition.open_campaign("datasets/work_table_bending")
mode  = recipe.MapTable(near=495, runs=["mode1_FE15_*", "mode1_FE30_*"], reference="bare", force_levels=[15, 30])
found = mapping.mapped(campaign, mode, recipe.EstimateTable(mount_mass=0.05))   # kg between load cell and table
chart = found.chart                                                             # ModalMap over (F_E, F_N)
print(found.homogeneity)                                                        # above 0.3: no linear fit
ema.store.save("reports/_build/journey_map.h5", chart)
ema.show.damping_map(chart).savefig("reports/_build/journey_map.svg")
