from ema.datasets.folders import cache_folder as cache_folder
from ema.datasets.folders import fetch as fetch
from ema.datasets.folders import fetch_recipe as fetch_recipe
from ema.datasets.folders import names as names
from ema.datasets.folders import recipe_file as recipe_file
from ema.datasets.folders import recipes as recipes
