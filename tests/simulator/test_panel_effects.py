"""Each of the panel's effects reaches the picture, or is left out of it."""

from dataclasses import replace

import numpy as np
import pytest
from judges import relative
from small_bench.world import CAMERA, light_of, ring_pattern, world

import optics.slm.modulator
from optics.slm import PanelMap, PhaseResponse

WAVELENGTH = 550e-9


def uneven() -> tuple[np.ndarray, np.ndarray]:
    return np.mgrid[-1:1:18j, -1:1:24j]


def beam(radius: float) -> PanelMap:
    y, x = uneven()
    return PanelMap(np.exp(-(y**2 + x**2) / radius**2))


def figure(metres: float) -> PanelMap:
    y, x = uneven()
    path = x**2 - y**2 + 0.5 * x * y**2 + 0.7 * x**3
    return PanelMap(path / path.std() * metres)


def response(gamma: float, wiggle: float, highest: float) -> PhaseResponse:
    x = np.arange(256) / 255
    return PhaseResponse.from_curve(550e-9, highest * (x**gamma + wiggle * np.sin(2 * np.pi * x)))


DATA = {
    "illumination": ("illumination", [beam(4.0), beam(1.0)]),
    "front reflection": ("front_reflection", [0.001, 0.005, 0.05]),
    "panel response": ("response", [response(1.1, 0.02, 1.0), response(1.3, 0.02, 0.92)]),
    "neighbour coupling": ("coupling", [1.5e-6, 4e-6, 8e-6]),
    "flicker": ("flicker", [0.1, 0.2]),
    "jitter": ("jitter", [0.05, 0.3]),
    "gap light": ("gap_reflection", [0.05, 0.7]),
    "flatness": ("flatness", [figure(5e-9), figure(40e-9), figure(150e-9)]),
    "unmodulated light": ("unmodulated", [0.001, 0.05]),
}
CASES = [
    pytest.param(name, field, value, marks=[] if value is values[0] else pytest.mark.sweep)
    for name, (field, values) in DATA.items()
    for value in values
]
"""The weakest of each, and stronger ones."""


def test_effects_below_the_tolerance_are_not_rendered(monkeypatch):
    """A microscopic coupling: seen by the plan, and not by the picture."""

    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    bench = world()
    camera = replace(bench.camera, panel=replace(bench.camera.panel, coupling=0.3e-6))
    w, pattern = world(camera), ring_pattern(80e-6)
    decision = w.effect_plan(pattern, WAVELENGTH, target="star")["neighbour coupling"]
    assert not decision.on
    assert decision.relative < w.imaging.tol
    monkeypatch.setattr(optics.slm.modulator, "fringing_field_mean", never)
    assert np.array_equal(light_of(w, pattern), light_of(bench, pattern))


@pytest.fixture(scope="module")
def without_any():
    """The light of a panel that has none of them."""
    return light_of(world(), ring_pattern(80e-6))


@pytest.mark.parametrize(("effect", "field", "value"), CASES[:-2])
def test_every_effect_of_the_panel_reaches_the_picture(effect, field, value, without_any):
    camera = replace(CAMERA, panel=replace(CAMERA.panel, **{field: value}))
    pattern = ring_pattern(80e-6)
    on, off = (light_of(world(camera, forced={effect: state}), pattern) for state in (True, False))
    # Where light goes by the true phase decides on the samples of both.
    assert relative(off, without_any) <= 1e-3
    assert relative(on, off) > 1e-4
