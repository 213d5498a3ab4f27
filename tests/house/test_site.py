"""The site that `make docs` makes has every page of the guide and every package's face."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from test_docstrings import PACKAGES

from labapp.common.guide import PAGES, list_topics

ROOT = Path(__file__).parents[2]


def test_the_index_has_all_pages_in_the_guides_order() -> None:
    index = (PAGES / "index.rst").read_text()
    listed = re.findall(r"^   ([a-z0-9-]+)$", index, re.MULTILINE)
    assert listed == [*(topic.name for topic in list_topics()), "api"]


def test_the_reference_has_every_package_that_users_import() -> None:
    named = set(re.findall(r"^\.\. automodule:: (\S+)$", (PAGES / "api.rst").read_text(), re.M))
    assert set(PACKAGES) - _INSIDE <= named


_INSIDE = {"labapp.cli", "drivers.x11", "simulator.machines.varispec", "simulator.scene.charts"}
"""Faces for other packages of the project, and the command line's start."""


def test_the_changelog_and_the_citation_name_the_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert re.search(rf"^## {re.escape(version)} \(", (PAGES / "changelog.md").read_text(), re.M)
    assert f"version: {version}\n" in (PAGES / "citing.md").read_text()
