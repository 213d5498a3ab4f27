"""The measurements by name, from the modules that declare some at their end."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

from figures import Measurement


def _declared(path: Path) -> Iterator[str]:
    """The names in a module's MEASUREMENTS, read without importing it: most load torch."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict):
            (target,) = node.targets
            if isinstance(target, ast.Name) and target.id == "MEASUREMENTS":
                yield from (ast.literal_eval(key) for key in node.value.keys if key)


_FOUND = {
    name: path.stem
    for path in Path(__file__).parent.glob("*.py")
    if path != Path(__file__)
    for name in _declared(path)
}

MEASUREMENTS = dict(sorted(_FOUND.items()))
"""Name to module: a measurement is a function of one file, and an entry at the file's end."""

ON_REQUEST = ("million frames",)
"""Measurements that take an hour, and are made only where all words of their name are asked for."""


def measurement(name: str) -> Measurement:
    module = importlib.import_module(f"figures.{MEASUREMENTS[name]}")
    found: Measurement = module.MEASUREMENTS[name]
    return found
