"""Files of other programs, units, matrices of finite elements, and measuring live."""

from ema.public import attach

_HOMES = {
    "Contents": "acquisition.contents",
    "Part": "acquisition.setups",
    "Session": "acquisition.session",
    "Take": "acquisition.session",
    "UndescribedError": "acquisition.files.arrays",
    "campaign_file": "acquisition.campaign_file",
    "columns": "acquisition.columns",
    "data_files": "acquisition.assignment",
    "dataset_folder": "acquisition.datasets",
    "formats": "acquisition.registry",
    "law_of": "acquisition.model_building",
    "merge": "acquisition.setups",
    "model_file": "acquisition.model_file",
    "open_campaign": "acquisition.folder",
    "open_model": "acquisition.model_building",
    "open_rig": "acquisition.recording",
    "quantities": "acquisition.quantities",
    "read": "acquisition.registry",
    "record": "acquisition.recording",
    "rig_file": "acquisition.rig_file",
    "write": "acquisition.registry",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
