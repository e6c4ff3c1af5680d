from ema.archive.adding import Added as Added
from ema.archive.adding import add as add
from ema.archive.finding import Answer as Answer
from ema.archive.finding import Observation as Observation
from ema.archive.finding import Query as Query
from ema.archive.finding import find as find
from ema.archive.picture import trend as trend
from ema.archive.record import Source as Source
