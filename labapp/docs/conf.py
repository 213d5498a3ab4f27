"""Sphinx makes one site of the guide and an API reference: `make docs`."""

from __future__ import annotations

from importlib.metadata import version as installed_version

project = "labapp"
version = release = installed_version("labapp")

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["__pycache__"]

# Links to files beside the guide, such as the measured results, lead out of the site.
suppress_warnings = ["myst.xref_missing"]

autodoc_typehints = "none"
numpydoc_class_members_toctree = False
numpydoc_show_class_members = False

html_theme = "alabaster"
html_theme_options = {
    "description": "Programmable optics for computational photography",
    "page_width": "1100px",
}
