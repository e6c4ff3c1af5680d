from ema.study.plain import summary as summary
from ema.study.study import Study as Study
