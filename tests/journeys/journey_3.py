"""Tutorial 3: a model of the table with its beam is compared with the measured map of tutorial 2."""

import acquisition
import ema

chart = ema.store.load("reports/_build/journey_map.h5")
model = acquisition.open_model("datasets/work_table_bending")           # measured host, beam, two joints
seen  = ema.compare.measure(model, chart, at="91:+Z", output="92:+Z")   # the same tests, on the model
found = ema.compare.maps(chart, seen)
print(found.verdict)                                                    # whether it agrees, and why
ema.report.write({"comparison": found}, "reports/_build/journey_comparison.html")
