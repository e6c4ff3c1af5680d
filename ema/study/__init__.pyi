from ema.study.placement_inputs import read_placement as read_placement
from ema.study.plain import summary as summary
from ema.study.study import Study as Study
