"""Imports colour-science when it is needed, and undoes its effect on warnings."""

from __future__ import annotations

import warnings
from types import ModuleType


def colour_library() -> ModuleType:
    """Import colour-science, which takes a second, and would hide all warnings of the process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
        import colour.colorimetry
        import colour.quality
    return colour
