"""Tutorial 4: from a hammer test to the place of a friction beam, its normal force, and a report."""

import ema

study  = ema.Study.load("tests/journeys/journey_4.toml")
result = study.run(resume=True)                                 # writes the report; finished parts are kept
best   = result.placement.ranking.best
print(best.centre, best.normal_force, best.damping)             # where, F_N per joint, damping over F_E
ema.report.write(result, "reports/_build/journey_placement.docx")
