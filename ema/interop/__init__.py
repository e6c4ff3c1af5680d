"""Objects of other Python packages for modal analysis, to and from ours; none of those packages is imported."""

from ema.arguments import checked_names
from ema.lazy import attach

_HOMES = {
    "from_pyfbs": "ema.interop.frames",
    "from_pyoma": "ema.interop.operational",
    "from_sdynpy": "ema.interop.structured",
    "from_sdypy": "ema.interop.sdypy_model",
    "modes_from_sdypy": "ema.interop.sdypy_model",
    "to_dataframe": "ema.interop.dataframes",
    "to_pyfbs": "ema.interop.frames",
    "to_pyoma": "ema.interop.operational",
    "to_sdynpy": "ema.interop.structured",
    "to_sdypy": "ema.interop.sdypy_model",
    "to_xarray": "ema.interop.labelled",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
__getattr__ = checked_names(__name__, __getattr__)
