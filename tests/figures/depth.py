"""Defocus and occlusion in a scene with depth, against rays."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from judges.rays import Thing, ray_traced
from numpy.typing import NDArray

from figures import Figure
from optics.caching import ByteCache
from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Spectrum
from optics.threads import single_threaded
from simulator.formation import expected_electrons
from simulator.ledger import Ledger
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.recipe import Recipe
from simulator.scene import Sheet, Sheets, Target
from simulator.scene.polygons import Polygons, rectangle
from simulator.situation import Situation

Array = NDArray[np.float64]
Distances = tuple[float, float, float]

PANEL = Panel(shape=(48, 64), pitch=100e-6, fill_factor=1.0, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.05, 5.0, 1.0), Sensor(shape=(64, 72), pitch=6e-6))
"""Its panel is smaller than its stop."""

PLACES: dict[str, Distances] = {
    "near in focus": (1.0, 1.2, 1.5),
    "far in focus": (0.8, 0.9, 1.0),
    "middle in focus": (0.85, 1.0, 1.2),
    "none in focus": (0.8, 1.2, 1.3),
}
"""Metres, of a square, a bar behind it, and a wall with windows behind both."""

GEOMETRIC = Recipe(PANEL, 64, 3, occlusion=True, depths=9, pixel_aperture=True)
"""As rays see it: without waves."""

_GOAL = 0.02
_RAYS = 24
"""Squared, in each of four parts of a pixel: 1e7 on all."""

_SEED = 1


@single_threaded
def depth_figure(folder: Path) -> list[Figure]:
    """Three things at three distances, four times, by at least 1e7 rays each."""
    errors = {name: ray_error(place, GEOMETRIC, _RAYS) for name, place in PLACES.items()}
    worst = max(errors.values())
    rays = 4 * _RAYS**2 * math.prod(CAMERA.sensor.shape)
    return [
        Figure(
            "defocus and occlusion of three things against 1e7 rays",
            f"≤ {_GOAL:.0%} L2",
            ", ".join(f"{name} {error:.1%}" for name, error in errors.items())
            + f"; {rays:.1e} rays",
            worst <= _GOAL,
        )
    ]


def ray_error(distances: Distances, recipe: Recipe, rays: int) -> float:
    """Relative L2 of the picture by a recipe from that by rays: rays² in each of four parts of
    a pixel."""
    things, target = three_things(distances)
    light, white = (_light(one, recipe) for one in (target, _white()))
    rows, columns = CAMERA.sensor.shape
    pictured = light / float(white[rows // 2, columns // 2])
    truth = ray_traced(things, CAMERA, rays, _SEED)
    return float(np.linalg.norm(pictured - truth) / np.linalg.norm(truth))


def three_things(distances: Distances) -> tuple[list[Thing], Target]:
    """A square before a bar before a wall with two windows; for rays, and the same as a target.

    No edge of one lies along another's: where two do, both blurred, their blurs aren't
    independent, and a product of them is wrong by up to 15 % of the light along that line.
    """
    near, middle, far = distances
    # Of a pixel, on each.
    a, b, c = (CAMERA.sensor.pitch / CAMERA.magnification(d) for d in distances)
    square = ((2 * a, -8 * a), (26 * a, 22 * a))
    bar = ((0.0, 20 * b), (400 * b, 12 * b))
    windows = [((-24 * c, 13 * c), (12 * c, 46 * c)), ((2 * c, -18 * c), (12 * c, 24 * c))]
    things = [
        Thing(near, lambda y, x: 0.9 * _inside(*square, y, x), lambda y, x: _inside(*square, y, x)),
        Thing(middle, lambda y, x: 0.6 * _inside(*bar, y, x), lambda y, x: _inside(*bar, y, x)),
        Thing(
            far,
            lambda y, x: 0.2 + 0.7 * (_inside(*windows[0], y, x) + _inside(*windows[1], y, x)),
            lambda y, x: np.zeros_like(y),
        ),
    ]
    front, between = (Polygons((rectangle(*one),), (1.0,)) for one in (square, bar))
    wall = Polygons(tuple(rectangle(*one) for one in windows), (0.9, 0.9), 0.2)
    light, dark = Spectrum.flat(0.9), Spectrum.flat(0.6)
    sheets = (
        Sheet(near, ((light, front),), front),
        Sheet(middle, ((dark, between),), between),
        Sheet(far, ((None, wall),)),
    )
    return things, Sheets(sheets, 1e9)


def _inside(
    centre: tuple[float, float], size: tuple[float, float], y: Array, x: Array
) -> NDArray[np.float64]:
    within = (np.abs(y - centre[0]) <= size[0] / 2) & (np.abs(x - centre[1]) <= size[1] / 2)
    return within.astype(np.float64)


def _white() -> Target:
    sheet = Polygons((rectangle((0.0, 0.0), (1.0, 1.0)),), (1.0,))
    return Sheets((Sheet(CAMERA.lens.focus_distance, ((None, sheet),)),), 1e9)


def _light(target: Target, recipe: Recipe) -> Array:
    neutral = PanelContent.of(np.zeros((1, *PANEL.shape), np.uint8), math.inf)
    s = Situation(CAMERA, Mount(), target, Band(550e-9, 5e-9), neutral, 0.0, 0.01, numerics=1e-4)
    return expected_electrons(s, recipe, ByteCache(), Ledger()).double().numpy()


MEASUREMENTS = {"depth": depth_figure}
