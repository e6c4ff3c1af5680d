"""Mode shapes: how alike, how complex, and where in space."""

from ema.arguments import checked
from ema.shapes.alignment import Alignment, align, on_test_dofs
from ema.shapes.certainty import MacUncertainty, mac_uncertainty
from ema.shapes.complexity import (
    mean_phase,
    mean_phase_deviation,
    modal_phase_collinearity,
    quality,
    realise,
)
from ema.shapes.continuation import with_plate
from ema.shapes.correlation import Comparison, auto_mac, co_mac, compare, frac, mac
from ema.shapes.expansion import Expansion, expand, expand_by_modes
from ema.shapes.rigid import mass_of, rigid_rows, with_body_uncertainty, with_rigid_body
from ema.shapes.surface import Surface, smooth

__all__ = [
    "Alignment",
    "Comparison",
    "Expansion",
    "MacUncertainty",
    "Surface",
    "align",
    "auto_mac",
    "co_mac",
    "compare",
    "expand",
    "expand_by_modes",
    "frac",
    "mac",
    "mac_uncertainty",
    "mass_of",
    "mean_phase",
    "mean_phase_deviation",
    "modal_phase_collinearity",
    "on_test_dofs",
    "quality",
    "realise",
    "rigid_rows",
    "smooth",
    "with_body_uncertainty",
    "with_plate",
    "with_rigid_body",
]

for _name in __all__:
    globals()[_name] = checked(globals()[_name], __name__)
