"""The tiny bench as the simulator sees it: a camera, a scene, and the world of both."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import torch

from optics.camera import Camera
from optics.patterns import axicon, fresnel_lens
from optics.slm import phase_to_grey
from simulator.scene import Dark, PhotographPrint, Scene, Star
from simulator.world import World
from small_bench.files import TINY
from small_bench.setups import bench_file

_BENCH = bench_file(TINY).build_camera()
CAMERA = replace(_BENCH, panel=replace(_BENCH.panel, fill_factor=0.81))
"""Pixels of nine tenths of the pitch a side can be drawn finely, ten samples to a pixel."""

WIDE_OPEN = replace(CAMERA, lens=replace(CAMERA.lens, f_number=5.0))
GREY_CARD = torch.full((50, 50, 3), 0.5)
SCENE = Scene(
    {
        "dark": Dark(),
        "star": Star(20e-6, 2.0, 2e12),
        "near star": Star(20e-6, 1.7, 2e12),
        "card": PhotographPrint(GREY_CARD, 2.0, 1e7, cover=20.0),
    }
)
NEUTRAL = np.zeros(CAMERA.panel.shape, dtype=np.uint8)


def world(camera: Camera = CAMERA, scene: Scene = SCENE, **options) -> World:
    return World(camera, scene, **options)


def light_of(
    world: World, grey=NEUTRAL, wavelength=550e-9, target="star", exposure=0.01
) -> np.ndarray:
    world.grey, world.wavelength, world.target = grey, wavelength, target
    return world.electron_rates(exposure)[0].numpy().astype(np.float64)


def fresh_light(grey=NEUTRAL, **seen) -> np.ndarray:
    """light_of() a world that has seen nothing before; that of each question is made once."""
    return _fresh_light(grey.tobytes(), tuple(sorted(seen.items())))


@cache
def _fresh_light(grey: bytes, seen: tuple) -> np.ndarray:
    pixels = np.frombuffer(grey, np.uint8).reshape(CAMERA.panel.shape)
    light = light_of(world(), pixels.copy(), **dict(seen))
    light.setflags(write=False)
    return light


def ring_pattern(radius: float, camera: Camera = CAMERA) -> np.ndarray:
    phase = axicon(camera.panel, radius, camera.lens.image_distance, 550e-9)
    return phase_to_grey(camera.panel, phase, 550e-9).numpy()


def lens_pattern(focal_length: float, camera: Camera = CAMERA) -> np.ndarray:
    phase = fresnel_lens(camera.panel, focal_length, 550e-9)
    return phase_to_grey(camera.panel, phase, 550e-9).numpy()
