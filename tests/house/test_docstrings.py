"""What a package's face exports has a docstring in NumPy style that says all of its parameters."""

from __future__ import annotations

import importlib
import inspect
from typing import Any

import pytest
from numpydoc.validate import Validator, validate

CHECKED = {
    "GL03",  # blank lines
    "GL08",  # no docstring
    "SS02",  # summary begins with a capital letter
    "SS03",  # and ends with a full stop
    "PR01",  # a parameter isn't described
    "PR02",  # a described one isn't there
    "PR03",  # another order
    "PR04",  # no type
    "PR07",  # no description
    "RT01",  # what is returned isn't described
    "RT03",
    "YD01",
}


PACKAGES = (
    "drivers.aravis",
    "drivers.cs2000",
    "drivers.hosted",
    "drivers.screen",
    "drivers.thorlabs_wheel",
    "drivers.usb_link",
    "drivers.uvc",
    "drivers.varispec",
    "drivers.x11",
    "labapp.bench.opening",
    "labapp.cli",
    "labapp.files.cubes",
    "labapp.pictures.report",
    "labapp.pictures.report.record_analysis",
    "labapp.runs.export",
    "labapp.studies",
    "optics.accuracy",
    "optics.fourier",
    "optics.inverse",
    "optics.light",
    "optics.measuring",
    "optics.patterns",
    "optics.propagation",
    "optics.psf",
    "optics.retrieval",
    "optics.sensor",
    "optics.slm",
    "optics.targets",
    "simulator.devices",
    "simulator.formation",
    "simulator.machines.varispec",
    "simulator.planning",
    "simulator.scene",
    "simulator.scene.charts",
    "simulator.screens",
    "simulator.wire",
)
"""Whose faces are in that style."""


def exported() -> list[str]:
    faces = map(importlib.import_module, PACKAGES)
    return [
        f"{face.__name__}.{name}"
        for face in faces
        for name in face.__all__
        if _is_documented(getattr(face, name))
    ]


def _is_documented(thing: Any) -> bool:
    """Constants and aliases of types have no docstring of their own."""
    return inspect.isclass(thing) or inspect.isfunction(thing)


@pytest.mark.parametrize("name", exported())
def test_a_docstring_says_all_that_a_caller_gives_and_gets(name: str) -> None:
    found = validate(name)["errors"]
    wrong = [f"{code} {words}" for code, words in found if code in CHECKED]
    assert not wrong, Validator._load_obj(name).__doc__
