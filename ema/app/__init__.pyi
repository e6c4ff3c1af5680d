from ema.app.server import serve as serve
from ema.app.state import Workbench as Workbench
