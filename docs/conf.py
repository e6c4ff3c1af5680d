"""The site: `python -m sphinx -W -b html docs docs/_build/site` (extra `docs`)."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import ema  # noqa: E402

project = "friction-ema"
author = "The friction-ema developers"
copyright = author
version = release = ema.__version__
extensions = ["myst_parser", "sphinx.ext.autosummary", "sphinx.ext.autodoc", "numpydoc"]
templates_path = ["templates"]
exclude_patterns = ["_build", "templates"]
html_theme = "pydata_sphinx_theme"
html_title = "friction-ema"
html_theme_options = {"navigation_with_keys": False, "show_toc_level": 2, "header_links_before_dropdown": 3}
# only the reference has pages below it
html_sidebars = {page.stem: [] for page in ROOT.glob("docs/*.md") if page.stem != "api"}
html_show_sourcelink = False

myst_heading_anchors = 4
language = "en"

autosummary_generate = True
# the packages are lazy: their __all__ says what is public
autosummary_ignore_module_all = False
autosummary_imported_members = True
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
