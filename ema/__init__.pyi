from ema.data import Finding as Finding
from ema.data import FrfSet as FrfSet
from ema.data import Geometry as Geometry
from ema.data import ModalModel as ModalModel
from ema.data import PoleTable as PoleTable
from ema.data import Recording as Recording
from ema.dof import Dof as Dof
from ema.errors import EmaError as EmaError
from ema.study import Study as Study

from . import app as app
from . import compare as compare
from . import data as data
from . import datasets as datasets
from . import estimate as estimate
from . import fit as fit
from . import place as place
from . import proposal as proposal
from . import report as report
from . import shapes as shapes
from . import show as show
from . import simulate as simulate
from . import store as store
from . import study as study
from . import synthesis as synthesis

__version__: str
