"""Sphinx makes one site of the guide and an API reference: `make docs`."""

from __future__ import annotations

from importlib.metadata import version as installed_version

project = "labapp"
version = release = installed_version("labapp")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
exclude_patterns = ["__pycache__"]

# Pages show the README's own structure on GitHub, in terminal and window: links among them are
# files, and those to files beside the guide stay as they are.
myst_all_links_external = False
suppress_warnings = ["myst.xref_missing"]

autodoc_typehints = "none"
numpydoc_class_members_toctree = False
numpydoc_show_class_members = False

html_theme = "alabaster"
html_theme_options = {
    "description": "Programmable optics for computational photography",
    "page_width": "1100px",
}
