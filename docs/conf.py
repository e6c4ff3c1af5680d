"""The site: `python -m sphinx -W -b html docs docs/_build/site` (extra `docs`)."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "docs"))

import ema  # noqa: E402

project = "friction-ema"
author = "The friction-ema developers"
copyright = author
version = release = ema.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autosummary",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "mathml",
]
templates_path = ["templates"]
exclude_patterns = ["_build", "templates", "gallery", "auto_gallery/*.ipynb"]
html_theme = "pydata_sphinx_theme"
html_title = "friction-ema"
html_theme_options = {"navigation_with_keys": False, "show_toc_level": 2, "header_links_before_dropdown": 3}
# only the reference, the theory and the gallery have pages below them
html_sidebars = {page.stem: [] for page in ROOT.glob("docs/*.md") if page.stem != "api"}
html_show_sourcelink = False

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
language = "en"

autosummary_generate = True
# the packages are lazy: their __all__ says what is public
autosummary_ignore_module_all = False
autosummary_imported_members = True
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "image_scrapers": ("gallery_pictures.scraper",),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "copyfile_regex": r".*\.csv",
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "reset_modules": (),
    "plot_gallery": "True",
}
