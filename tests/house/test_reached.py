"""What is shipped is reached: from commands, the window, devices, or a library's face."""

from __future__ import annotations

import ast
import functools
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("optics", "drivers", "simulator", "labapp")

FOR_CALLERS = {
    "optics.focal_plane": "the field near a focus, for Python",
    "optics.psf.over_field": "PSFs between field positions, for Python; the guide has an example",
    "optics.measuring.slanted_edge": "a camera's MTF from a picture of an edge, for Python",
    "optics.camera.system_mtf": "a camera's MTF and the light that it takes, for Python",
}
"""Modules of the engine that people call from Python, with the reason; no command does."""

OTHER_PROCESSES = {
    "labapp.docs.conf": "Sphinx reads it: make docs",
    "drivers.aravis.library": "runs under the system's Python, which has gi",
}


BY_NAME = ("labapp.studies.catalogue",)
"""Packages whose modules are imported by names that are put together."""


def modules() -> dict[str, Path]:
    found = {}
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = modules()


@functools.cache
def imported(path: Path) -> frozenset[str]:
    """Modules of ours that a file imports, or names in a text as a module to be started."""
    names: set[str] = set()
    if path == ROOT / "optics/moved.py":
        return frozenset()  # it leads old names of callers to new ones
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names.add(node.value.partition(":")[0])
    return frozenset(names & MODULES.keys())


@functools.cache
def reached(roots: frozenset[str]) -> set[str]:
    """With the packages that they lie in."""
    found: set[str] = set()
    left = set(roots)
    while left:
        name = left.pop()
        if name not in found:
            found.add(name)
            left |= imported(MODULES[name])
            if name in BY_NAME:
                left |= {one for one in MODULES if one.startswith(f"{name}.")}
            package = name.rpartition(".")[0]
            left |= {package} & MODULES.keys()
    return found


def entrances() -> frozenset[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = [project["scripts"], *project["entry-points"].values()]
    named = {value.partition(":")[0] for group in groups for value in group.values()}
    return frozenset(named) | {name for name in MODULES if name.endswith("__main__")}


def test_every_module_is_reached_or_named_with_its_reason():
    exceptions = tuple(FOR_CALLERS) + tuple(OTHER_PROCESSES)
    roots = entrances() | {name for name in MODULES if name.startswith(exceptions)}
    assert sorted(MODULES.keys() - reached(roots)) == []


@pytest.mark.parametrize("name", [*FOR_CALLERS, *OTHER_PROCESSES])
def test_a_reason_is_given_only_where_one_is_needed(name):
    others = {one for one in MODULES if one.startswith(name)}
    assert others
    assert not others <= reached(entrances())


REFERENCES = {
    "tests/figures/chains.py": "panels of 300 pixels take tests' own judge of chains hours",
    "tests/figures/problems.py": "the same references as labapp accuracy shows, on random problems",
    "tests/figures/told.py": "the same problems and references as those two",
    "tests/labapp/test_chain_accuracy.py": "they are what is tested",
    "tests/labapp/test_references.py": "they are what is tested",
    "tests/peers/labapp_peers/free_space.py": "an adapter of labapp accuracy's",
}


def test_tests_judge_by_judges_of_their_own():
    pattern = re.compile(r"^from labapp\.accuracy\.references", re.MULTILINE)
    users = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "tests").rglob("*.py")
        if pattern.search(path.read_text())
    }
    assert users == set(REFERENCES)
