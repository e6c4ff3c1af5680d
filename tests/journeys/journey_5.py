"""Tutorial 5: live, take by take, without hardware; then the modes and the browser."""

import acquisition
import ema
from ema.datasets import table

sensors = tuple(
    ema.data.Channel(f"acc {n}", ema.Dof(node, "+Z"), "acceleration", unit="m/s^2") for n, node in ((1, 1), (2, 67))
)
hammer = ema.simulate.RovingHammer(tuple(ema.Dof(node, "-Z") for node in (1, 1, 5, 5, 67, 67)), hits=1)
rig = ema.simulate.VirtualRig(table.with_beam(), hammer, sensors, 4096.0, noise={"acceleration": 0.001})

with acquisition.record("today", rig, run="beam", judge=ema.estimate.check_impact) as takes:   # or the device of rig.toml
    for take in takes.first(6):
        print(take.point, take.peak, take.reasons or "accepted")

frfs  = ema.estimate.hammer(acquisition.open_campaign("today")["beam"])
poles = ema.fit.stabilise(frfs.band(300, 1100), orders=range(4, 31, 2))
modes = ema.fit.modes(frfs, poles)
print(modes.table())                                            # now `ema app today`
