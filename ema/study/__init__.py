"""One recipe, the whole chain: campaign, FRFs, modes, shapes, findings, report."""

from ema.public import attach

_HOMES = {
    "Study": "ema.study.study",
    "read_placement": "ema.study.placement_inputs",
    "summary": "ema.study.plain",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
