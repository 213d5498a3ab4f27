"""Small situations by chance, for the effects of optics: panels and sensors that are quick."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from optics.caching import ByteCache
from optics.camera import Camera, Ghost, Lens, Panel, Sensor
from optics.camera.field_aberrations import FieldAberrations
from optics.light import Band, Spectrum, Waveform, halogen
from optics.slm import PanelMap, PhaseResponse
from simulator.effects import registry
from simulator.effects.band_effects import Bandwidth, Leak
from simulator.effects.diffraction import Diffraction, PSFReach
from simulator.effects.field_effects import FieldAberrations as FieldAberrationsEffect
from simulator.effects.field_effects import FieldPosition, Vignetting
from simulator.effects.filter_angle import FilterAngle
from simulator.effects.glare import LensGhosts, VeilingGlare
from simulator.effects.lens_effects import AxialColour, Distortion, FocusDrift, LateralColour
from simulator.effects.panel_effects import (
    CrystalResponse,
    Interference,
    PanelDispersion,
    PanelEffect,
)
from simulator.effects.panel_orders import PanelOrders
from simulator.effects.pixel_effects import Dust, PixelCrosstalk
from simulator.effects.sampling import LightSampling
from simulator.effects.time_effects import Vibration
from simulator.formation.mean_picture import expected_electrons
from simulator.ledger import Ledger
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.planning import Effect
from simulator.recipe import Recipe
from simulator.scene import Flat, PhotographPrint, Star, Target
from simulator.situation import Situation

EFFECTS: tuple[Effect, ...] = (
    PSFReach(),
    LightSampling(),
    Diffraction(),
    Bandwidth(),
    Leak(),
    FilterAngle(),
    PanelDispersion(),
    *(one for one in registry.EFFECTS if isinstance(one, PanelEffect)),
    CrystalResponse(),
    Interference(),
    FieldPosition(),
    FieldAberrationsEffect(),
    Vignetting(),
    PanelOrders(),
    AxialColour(),
    FocusDrift(),
    Vibration(),
    LateralColour(),
    Distortion(),
    LensGhosts(),
    VeilingGlare(),
    Dust(),
    PixelCrosstalk(),
)

PANEL = Panel(shape=(24, 32), pitch=40e-6, fill_factor=0.81, unmodulated=0.05)
CAMERA = Camera(
    PANEL, Lens(0.05, 40.0, 1.0), Sensor(shape=(20, 24), pitch=20e-6, full_well=1e7, bits=16)
)
CORNER = math.hypot(20, 24) * 10e-6
STAR = Star(40e-6, 1.0, 2e12, (2e-4, 1e-4))
STILL = PanelContent.of(np.zeros((1, *PANEL.shape), np.uint8), math.inf)


def situation(
    target: Target = STAR,
    camera: Camera = CAMERA,
    band: Band | None = None,
    shown: PanelContent | None = None,
    exposure: float = 0.01,
    moment: float = 0.0,
    mount: Mount | None = None,
    numerics: float = 1e-6,
    **more,
) -> Situation:
    if shown is None:
        shown = PanelContent.of(np.zeros((1, *camera.panel.shape), np.uint8), math.inf)
    return Situation(
        camera,
        mount or Mount(),
        target.for_camera(camera),
        band or Band(550e-9, 20e-9),
        shown,
        moment,
        exposure,
        numerics=numerics,
        **more,
    )


def before_lens(mount: Mount, y: Any, x: Any) -> tuple[Any, Any]:
    """Where a point of the panel lies before the lens: mirrored, turned, then shifted."""
    y, x = (-y if mount.flip_y else y), (-x if mount.flip_x else x)
    c, s = math.cos(mount.rotation), math.sin(mount.rotation)
    return x * s + y * c + mount.shift[0], x * c - y * s + mount.shift[1]


def pattern(rng: np.random.Generator, panel: Panel) -> np.ndarray:
    """A smooth, a steep or a random one, (rows, columns) uint8."""
    y, x = np.mgrid[-1 : 1 : panel.shape[0] * 1j, -1 : 1 : panel.shape[1] * 1j]
    kind = rng.integers(4)
    if kind == 0:
        phase = np.full(panel.shape, 10.0)
    elif kind == 1:
        phase = 40 + 30 * np.sin(rng.uniform(1, 6) * x + rng.uniform(1, 6) * y)
    elif kind == 2:
        phase = rng.uniform(20, 60) * np.hypot(x, y) % 60
    else:
        phase = rng.integers(0, rng.integers(10, 200), panel.shape)
    return phase.astype(np.uint8)


def random_panel(rng: np.random.Generator) -> Panel:
    y, x = np.mgrid[-1:1:6j, -1:1:8j]
    data = {
        "illumination": PanelMap(np.exp(-(x**2) - y**2) * rng.uniform(0.5, 2) + 0.1),
        "front_reflection": rng.uniform(0, 0.05),
        "response": PhaseResponse.from_curve(
            550e-9, rng.uniform(0.9, 1.1) * (np.arange(256) / 255) ** rng.uniform(0.8, 1.3)
        ),
        "coupling": rng.uniform(2e-6, 15e-6),
        "flicker": rng.uniform(0.005, 0.1),
        "jitter": rng.uniform(0.01, 0.3),
        "gap_reflection": rng.uniform(0.05, 0.7),
        "flatness": PanelMap((x**2 - y + x * y) * rng.uniform(5e-9, 60e-9)),
    }
    chosen = {name: value for name, value in data.items() if rng.random() < 0.5}
    return replace(PANEL, unmodulated=rng.uniform(0, 0.1), **chosen)


def random_target(rng: np.random.Generator) -> Target:
    light = halogen() if rng.random() < 0.5 else None
    distance = float(rng.choice([1.0, 0.9, 1.2]))
    kind = rng.integers(3)
    if kind == 0:
        place = tuple(rng.uniform(-2e-3, 2e-3, 2))
        return Star(rng.uniform(20e-6, 400e-6), distance, 2e11, place, light=light)
    if kind == 1:
        return Flat(distance, 1e7, light=light)
    image = torch.from_numpy(rng.random((16, 20, 3)).astype(np.float32))
    smooth = torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None], 3, 1, 1)[0]
    cover = float(rng.choice([0.7, 1.2]))
    return PhotographPrint(smooth.permute(1, 2, 0), distance, 1e7, cover=cover, light=light)


def random_situation(seed: int, *, video: bool = False) -> Situation:
    rng = np.random.default_rng(seed)
    camera = replace(CAMERA, panel=random_panel(rng))
    shape = str(rng.choice(["gaussian", "interference"]))
    leak = float(rng.choice([0.0, 1e-4, 3e-3]))
    band = Band(rng.uniform(500e-9, 600e-9), rng.uniform(5e-9, 40e-9), shape, leak)
    target = random_target(rng)
    if rng.random() < 0.3:
        lamp = Waveform("sine", 100.0, rng.uniform(0, 0.5), rng.uniform(0, 6))
        target = replace(target, lamp=lamp)
    shown = PanelContent.of(pattern(rng, camera.panel)[None], math.inf)
    if video:
        camera = replace(camera, panel=replace(camera.panel, response_time=rng.uniform(1e-3, 8e-3)))
        video = np.stack([pattern(rng, camera.panel) for _ in range(3)])
        shown = PanelContent.of(video, 1 / 60)
    exposure, moment = rng.uniform(3e-3, 40e-3), rng.uniform(0, 0.1)
    camera = replace(camera, glare=float(rng.choice([0.0, 0.01, 0.2])))
    specks = tuple(
        (*rng.uniform(-2e-4, 2e-4, 2), rng.uniform(10e-6, 80e-6)) for _ in range(rng.integers(4))
    )
    sensor = replace(
        camera.sensor,
        crosstalk=float(rng.choice([0.0, 0.02, 0.1])),
        dust=tuple((float(y), float(x), float(d)) for y, x, d in specks),
        dust_distance=float(rng.uniform(2e-4, 3e-3)),
    )
    bent = (float(rng.choice([0.0, 0.0, -300.0, 1000.0])), 0.0)
    blue, red = (float(10 ** rng.uniform(-5, -2.7)) * rng.choice([-1, 1]) for _ in range(2))
    colour = ((400e-9, float(blue)), (540e-9, 0.0), (720e-9, float(red)))
    lens = replace(camera.lens, distortion=bent, axial_colour=colour if rng.random() < 0.4 else ())
    if rng.random() < 0.3:
        wide, narrow = (float(one) for one in 10 ** rng.uniform(-4, -2, 2))
        lens = replace(lens, lateral_colour=((400e-9, wide), (550e-9, 0.0), (700e-9, -narrow)))
    camera = replace(camera, sensor=sensor, lens=lens)
    chance = np.random.default_rng([seed, 1])
    if chance.random() < 0.04:
        by = FieldAberrations(CORNER, *(float(one) for one in chance.uniform(-4e-9, 4e-9, 3)))
        camera = replace(camera, lens=replace(camera.lens, field_aberrations=by))
    trembling = float(rng.choice([0.0, 2e-6, 15e-6]))
    camera = replace(camera, vibration=trembling, vibration_frequency=rng.uniform(5, 100))
    if rng.random() < 0.4:
        size = float(rng.choice([-1, 1]) * rng.uniform(0.6, 2))
        camera = replace(camera, ghosts=(Ghost(0.05, size, float(rng.uniform(0, 3e-4))),))
    drift = float(rng.choice([0.0, 0.0, -1.0, 1.0]) * 10 ** rng.uniform(-4.5, -2.5))
    camera = replace(camera, focus_drift=drift, focus_drift_time=0.1)
    if shape == "interference":
        # Within .3 mm of the axis no angle is large.
        band = replace(band, effective_index=1.0)
    return situation(target, camera, band, shown, exposure, moment, numerics=1e-4)


def colour_curve(centre: float, width: float) -> Spectrum:
    return Spectrum(
        (300e-9, centre - width, centre, centre + width, 1100e-9), (0.0, 0.1, 0.8, 0.1, 0.0)
    )


def finest(s: Situation) -> dict[str, int]:
    return {one.name: one.finest_level(s) for one in EFFECTS if one.is_present(s)}


def recipe(s: Situation, levels: dict[str, int]) -> Recipe:
    made = Recipe.minimal(s).with_changes(lamp=s.target.lamp is not None, pixel_aperture=True)
    for one in EFFECTS:
        if levels.get(one.name, 0):
            made = one.add_to_recipe(made, s, levels[one.name])
    return made


def rendered(s: Situation, levels: dict[str, int], cache: ByteCache) -> np.ndarray:
    return expected_electrons(s, recipe(s, levels), cache, Ledger()).double().numpy()
