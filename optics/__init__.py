"""Model light, modulators, lenses, sensors and their inverses, as functions on tensors.

Import what you need from each module. This package doesn't depend on files, devices or windows,
and importing it loads nothing else.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType


class _OldNames:
    """Looks names of modules that aren't there up among those that stand elsewhere now."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if not name.startswith("optics.") or name == "optics.moved":
            return None
        from optics.moved import find_moved

        return find_moved(name)


sys.meta_path.append(_OldNames)
