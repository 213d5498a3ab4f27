"""Rays through a lens onto things at distances: what a picture is without any wave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera

Array = NDArray[np.float64]
Map = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Thing:
    """At a distance in metres from the lens: its light, and the share that it hides (0 or 1) of
    what is behind, as functions of (y, x) in metres across the axis, upright."""

    distance: float
    light: Map
    cover: Map


def ray_traced(
    things: Sequence[Thing], camera: Camera, rays: int, seed: int, across: int = 2
) -> Array:
    """Mean light on each pixel, 1 where all its rays end at light 1, (rows, columns).

    things: the nearest first. Every pixel has across² strata, and every stratum rays² rays, one
    in each stratum of the panel's rectangle, by chance in both. A ray ends at the first thing
    that hides. The stop must be wider than the panel, and the panel at the lens.
    """
    rng = np.random.default_rng(seed)
    lens, sensor, panel = camera.lens, camera.sensor, camera.panel
    z = lens.image_distance
    sides = [n * panel.pitch for n in panel.shape]
    total = np.zeros(sensor.shape)
    rows, columns = (np.arange(n) - n // 2 for n in sensor.shape)
    for sub in range(across**2):
        for stratum in range(rays**2):
            v, u = (rng.random(sensor.shape) for _ in range(2))
            y = (rows[:, None] + (sub // across + v) / across - 0.5) * sensor.pitch
            x = (columns[None, :] + (sub % across + u) / across - 0.5) * sensor.pitch
            b, a = (rng.random(sensor.shape) for _ in range(2))
            # Of an even number of pixels one more lies below the origin.
            py = ((stratum // rays + b) / rays - 0.5) * sides[0] - (
                1 - panel.shape[0] % 2
            ) * panel.pitch / 2
            px = ((stratum % rays + a) / rays - 0.5) * sides[1] - (
                1 - panel.shape[1] % 2
            ) * panel.pitch / 2
            total += _ended(things, lens.focus_distance, z, (y, x), (py, px))
    return total / (across**2 * rays**2)


def _ended(
    things: Sequence[Thing],
    focus: float,
    z: float,
    at: tuple[Array, Array],
    through: tuple[Array, Array],
) -> Array:
    """Light of the first thing that each ray meets: from the sensor, through the lens to the
    sensor's image in the plane in focus, as far as the thing."""
    light, open_to = np.zeros_like(at[0]), np.ones_like(at[0])
    for thing in things:
        share = thing.distance / focus
        # The image is inverted: upright coordinates are those of the sensor, mirrored.
        y, x = (
            place * focus / z * share + (1 - share) * -pupil
            for place, pupil in zip(at, through, strict=True)
        )
        light += open_to * thing.light(y, x)
        open_to = open_to * (1 - thing.cover(y, x))
    return light
