"""The estimates of a panel's effects against PSFs with each effect and without it."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative
from virtual_bench import NEUTRAL, light_of, ring_pattern, world

import optics.slm.modulator
from optics.camera import Camera, Lens, Panel, Sensor
from optics.patterns import axicon, fresnel_lens
from optics.plane import Plane
from optics.psf import PSFOperator, modulated_psf
from optics.slm import Map, Modulator, Response, phase_to_grey
from simulator.effects import Pattern, Situation, decide, phase_spread
from simulator.effects.panel import PANEL_EFFECTS, sizes_of
from simulator.effects.video import crystal_size
from simulator.motion import exposures
from simulator.shown import Shown

WAVELENGTH = 550e-9
PANEL = Panel(shape=(72, 96), pitch=20e-6, fill_factor=0.81, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.125, 20.0, 2.0), Sensor())
PLANE = Plane((256, 256), (14e-6, 14e-6))
"""One period of the panel's orders, at 14 µm: its fringes are 38 µm apart."""

TOO_LITTLE, TOO_MUCH = 3.0, 16.0
"""Times that an estimate may be below what an effect does, or above it."""

FRAME = 1 / 60


def grey(phase) -> torch.Tensor:
    return phase_to_grey(PANEL, torch.as_tensor(phase), WAVELENGTH)


def patterns() -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(3)
    y, x = (p.numpy() for p in PANEL.plane.mesh())
    z = CAMERA.lens.image_distance
    return {
        "ring": grey(axicon(PANEL, 150e-6, z, WAVELENGTH)),
        "lens": grey(fresnel_lens(PANEL, 2.0, WAVELENGTH)),
        "smooth": grey(3 * np.sin(5e3 * y) * np.cos(4e3 * x) + 3e6 * x * y),
        "random": torch.from_numpy(rng.integers(0, 77, PANEL.shape).astype(np.uint8)),
    }


def uneven() -> tuple[np.ndarray, np.ndarray]:
    return np.mgrid[-1:1:18j, -1:1:24j]


def beam(radius: float) -> Map:
    y, x = uneven()
    return Map(np.exp(-(y**2 + x**2) / radius**2))


def figure(metres: float) -> Map:
    y, x = uneven()
    path = x**2 - y**2 + 0.5 * x * y**2 + 0.7 * x**3
    return Map(path / path.std() * metres)


def response(gamma: float, wiggle: float, highest: float) -> Response:
    x = np.arange(256) / 255
    return Response.tabulated(550e-9, highest * (x**gamma + wiggle * np.sin(2 * np.pi * x)))


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
CASES = [(name, field, value) for name, (field, values) in DATA.items() for value in values]


@pytest.fixture(scope="module")
def operator() -> PSFOperator:
    return PSFOperator(CAMERA, 2.0, WAVELENGTH, PLANE, integrate=False, tol=1e-5)


def psf(operator: PSFOperator, panel: Panel, shown: torch.Tensor) -> np.ndarray:
    modulator = Modulator(panel, WAVELENGTH)
    return modulated_psf(operator, modulator, modulator.still(shown)).numpy().astype(float)


def estimate(panel: Panel, shown: torch.Tensor, effect: str) -> float:
    pattern = Pattern(replace(CAMERA, panel=panel), shown, WAVELENGTH)
    return sizes_of(pattern, tol=1.0)[effect]


@pytest.mark.parametrize(("effect", "field", "value"), CASES)
def test_an_estimate_is_about_as_large_as_the_effect(effect, field, value, operator):
    panel = replace(PANEL, **{field: value})
    for name, shown in patterns().items():
        change = relative(psf(operator, PANEL, shown), psf(operator, panel, shown))
        size = estimate(panel, shown, effect)
        assert change <= TOO_LITTLE * size, name
        # Beyond all of the light there is nothing to be changed.
        assert min(size, 1.0) <= TOO_MUCH * change, name


@pytest.mark.parametrize(("effect", "field", "value"), CASES)
def test_an_estimate_grows_with_its_cause_and_vanishes_with_it(effect, field, value):
    shown = patterns()["ring"]
    assert estimate(replace(PANEL, **{field: value}), shown, effect) > 0
    assert effect not in sizes_of(Pattern(CAMERA, shown, WAVELENGTH), tol=1.0)
    if isinstance(value, float):
        half = estimate(replace(PANEL, **{field: value / 2}), shown, effect)
        assert half < estimate(replace(PANEL, **{field: value}), shown, effect)


def test_the_data_of_no_effect_make_no_estimate():
    flat, even = Map(np.full((3, 4), 2e-9)), Map(np.full((3, 4), 7.0))
    straight = Response.tabulated(550e-9, np.arange(256) / 255)
    panel = replace(PANEL, flatness=flat, illumination=even, response=straight)
    sizes = sizes_of(Pattern(replace(CAMERA, panel=panel), patterns()["ring"], WAVELENGTH), 1.0)
    assert set(sizes) == {"flatness", "illumination", "panel response"}
    assert max(sizes.values()) < 1e-7


def videos() -> dict[str, list[torch.Tensor]]:
    rng = np.random.default_rng(4)
    cone = axicon(PANEL, 150e-6, CAMERA.lens.image_distance, WAVELENGTH).numpy()
    coarse = [np.kron(rng.uniform(0, 6, (6, 8)), np.ones((12, 12))) for _ in range(3)]
    return {
        "related": [grey(cone + k * math.pi / 4) for k in range(8)],
        "unrelated": [grey(cone + start) for start in coarse],
        "random": [
            torch.from_numpy(rng.integers(0, 77, PANEL.shape).astype(np.uint8)) for _ in range(3)
        ],
        "lenses": [grey(fresnel_lens(PANEL, 2 + 0.05 * k, WAVELENGTH)) for k in range(4)],
        "on and off": [grey(cone), grey(0 * cone)],
    }


@pytest.mark.parametrize("tau", [0.5e-3, 4e-3, 30e-3])
def test_the_estimate_of_a_slow_crystal_is_about_as_large_as_what_it_does(tau, operator):
    panel = replace(PANEL, response_time=tau)
    for name, video in videos().items():
        shown = Shown.of(np.stack([frame.numpy() for frame in video]), FRAME)
        moving, standing = (
            modulated_psf(
                operator,
                Modulator(panel, WAVELENGTH),
                exposures(Modulator(panel, WAVELENGTH), seen, shown.pictures, 1e-3),
            )
            for seen in (shown.procession(0.0, 0.0), shown.mixture(0.0, 0.0))
        )
        change = relative(standing, moving)
        frames = (Pattern(replace(CAMERA, panel=panel), frame, WAVELENGTH) for frame in video)
        size = crystal_size(panel, frames, FRAME)
        assert change <= TOO_LITTLE * size, name
        assert min(size, 1.0) <= TOO_MUCH * change, name


def test_frames_that_are_alike_have_no_way_to_go():
    panel = replace(PANEL, response_time=0.01)
    frames = [Pattern(replace(CAMERA, panel=panel), patterns()["ring"], WAVELENGTH)] * 3
    assert crystal_size(panel, frames, FRAME) == 0


# What is decided off is taken off the panel.


def everything() -> Panel:
    changes = {field: values[-1] for field, values in DATA.values()}
    return replace(PANEL, response_time=0.01, **changes)


@pytest.mark.parametrize("effect", [*DATA, "liquid-crystal response"])
def test_an_effect_that_is_off_is_stripped_from_the_panel(effect):
    panel = everything()
    field = {**{name: field for name, (field, _) in DATA.items()}}.get(effect, "response_time")
    situation = Situation(replace(CAMERA, panel=panel), WAVELENGTH, 7e-9, 1e-4)
    names = [*DATA, "liquid-crystal response"]
    on = dict.fromkeys(names, True)
    assert decide(situation, 0.01, on).panel(panel) is panel
    stripped = decide(situation, 0.01, {**on, effect: False}).panel(panel)
    assert stripped == replace(panel, **{field: getattr(PANEL, field)})
    none = decide(situation, 0.01, dict.fromkeys(names, False)).panel(panel)
    assert none == PANEL


def test_effects_below_the_tolerance_are_not_rendered(monkeypatch):
    """A microscopic coupling: seen by the estimate, and not by the picture."""

    def never(*args, **kwargs):
        raise AssertionError("called for nothing")

    monkeypatch.setattr(optics.slm.modulator, "coupled", never)
    bench = world()
    camera = replace(bench.camera, panel=replace(bench.camera.panel, coupling=0.3e-6))
    w, pattern = world(camera), ring_pattern(80e-6)
    assert np.array_equal(light_of(w, pattern), light_of(bench, pattern))
    decision = w.effect_plan(pattern, WAVELENGTH)["neighbour coupling"]
    assert not decision.on
    assert 0 < decision.estimate < w.tol


@pytest.mark.parametrize(("effect", "field", "value"), CASES[:-2])
def test_every_effect_of_the_panel_reaches_the_picture(effect, field, value):
    bench = world()
    camera = replace(bench.camera, panel=replace(bench.camera.panel, **{field: value}))
    pattern = ring_pattern(80e-6)
    on, off = (light_of(world(camera, forced={effect: state}), pattern) for state in (True, False))
    # Where light goes by the true phase decides on the samples of both.
    assert relative(off, light_of(bench, pattern)) <= 1e-3
    assert relative(on, off) > 1e-4


def test_a_small_share_of_unmodulated_light_counts_where_the_psf_is_wide():
    bench = world()
    camera = replace(bench.camera, panel=replace(bench.camera.panel, unmodulated=0.004))
    plan = world(camera).effect_plan(ring_pattern(300e-6), WAVELENGTH)
    assert plan["unmodulated light"].estimate > 2 * 0.004
    assert world(camera).effect_plan(NEUTRAL, WAVELENGTH)["unmodulated light"].estimate == (
        pytest.approx(0.004)
    )


def test_aberrations_and_flatness_widen_what_is_rendered():
    """Both send light as far as a pattern of the same phase does."""
    y, x = PANEL.plane.mesh()
    path = 2e-4 * (x + 0.5 * y)
    camera = replace(CAMERA, panel=replace(PANEL, flatness=Map(path)))
    neutral = torch.zeros(PANEL.shape, dtype=torch.uint8)
    expected = phase_spread(CAMERA, 2 * math.pi / WAVELENGTH * path, WAVELENGTH)
    assert Pattern(camera, neutral, WAVELENGTH).spread == pytest.approx(expected)
    tilted = replace(CAMERA, lens=replace(CAMERA.lens, aberrations=((1, 1, 1e-6),)))
    radius = CAMERA.lens.stop_diameter / 2
    # Z(1, 1) is 2 x.
    expected = phase_spread(
        CAMERA, (2 * math.pi / WAVELENGTH * 2e-6 * x / radius).expand(PANEL.shape), WAVELENGTH
    )
    assert Pattern(tilted, neutral, WAVELENGTH).spread == pytest.approx(expected, rel=1e-6)
    assert Pattern(CAMERA, neutral, WAVELENGTH).spread == 0


def test_every_effect_has_a_sentence():
    for effect in PANEL_EFFECTS:
        assert effect.why(everything())
