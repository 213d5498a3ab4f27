"""Cameras behind the wire need Aravis, which no package index has."""

from __future__ import annotations

import subprocess
from functools import cache

import pytest

from drivers.aravis.library_process import PACKAGES, python_with_gi


@cache
def aravis_is_there() -> bool:
    code = "import gi; gi.require_version('Aravis', '0.8'); from gi.repository import Aravis"
    try:
        done = subprocess.run([*python_with_gi(), "-c", code], capture_output=True, check=False)
    except OSError:
        return False
    return done.returncode == 0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    skipped = pytest.mark.skip(reason=f"needs {PACKAGES}")
    for item in items:
        if item.get_closest_marker("aravis") and not aravis_is_there():
            item.add_marker(skipped)
