"""Settings of the documentation site: python -m sphinx -c docs . build/site

Pages are Markdown in this folder. The build writes pages about the methods, the weights, the modules and the public
functions into docs/generated, from the code.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))
sys.path.insert(0, str(Path(__file__).parent / "generate"))

import cascadenorm

project = "cascadenorm"
author = "The cascadenorm authors"
copyright = f"2026, {author}"
version = release = cascadenorm.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "docstrings",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
    "mathml",
    "generated_pages",
]

# Sources are the pages of the repository, in their places, so that links between them hold here and there.
root_doc = "docs/index"
include_patterns = ["docs/**", "benchmarks/*.md", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = [".venv", "build", "viewer", "docs/theory", "docs/generated/theory/*.ipynb"]
suppress_warnings = ["config.cache"]  # the gallery's settings hold functions

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4

autosummary_generate = True
autodoc_typehints = "none"  # they are in the docstrings, in words
default_role = "py:obj"
add_module_names = False

# What docstrings name of other projects is listed in docs/inventories, as the build asks nothing of the network.
intersphinx_mapping = {
    "numpy": ("https://numpy.org/doc/stable", "docs/inventories/numpy.inv"),
    "scipy": ("https://docs.scipy.org/doc/scipy", "docs/inventories/scipy.inv"),
    "torch": ("https://docs.pytorch.org/docs/stable", "docs/inventories/torch.inv"),
}

sphinx_gallery_conf = {
    "examples_dirs": ["docs/theory"],
    "gallery_dirs": ["docs/generated/theory"],
    "filename_pattern": r"/\d",
    "within_subsection_order": "FileNameSortKey",
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "capture_repr": (),  # what is printed is shown, not what a last line returns
    "download_all_examples": False,
    "min_reported_time": 10,
    "abort_on_example_error": True,
}

html_theme = "pydata_sphinx_theme"
html_context = {"default_mode": "auto"}
html_title = "cascadenorm"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_show_search_summary = False  # it would read the pages found, which a browser refuses for files
html_theme_options = {
    "logo": {"text": "cascadenorm"},
    "navbar_end": ["theme-switcher"],
    "navigation_with_keys": True,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
