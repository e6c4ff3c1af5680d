"""Virtual structures and built-in campaigns, generated on first use into the folder named or the cache folder."""

from ema.public import attach

_HOMES = {
    "cache_folder": "ema.datasets.folders",
    "fetch": "ema.datasets.folders",
    "fetch_recipe": "ema.datasets.folders",
    "names": "ema.datasets.folders",
    "recipe_file": "ema.datasets.folders",
    "recipes": "ema.datasets.folders",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
