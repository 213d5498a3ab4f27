"""Defocus and occlusion against rays."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges import relative
from optical_situations import situation
from ray_tracer import Thing, ray_traced

from optics.camera import Camera, Lens, Panel, Sensor
from optics.light import Band, Spectrum
from optics.plane import Plane
from optics.psf import PSFOperator
from simulator.caching import ByteCache
from simulator.formation.picture import expected
from simulator.formation.rays import RayOperator
from simulator.ledger import Ledger
from simulator.recipe import Recipe
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import Sheet, Sheets

PANEL = Panel(shape=(48, 64), pitch=100e-6, fill_factor=1.0, unmodulated=0.0)
CAMERA = Camera(PANEL, Lens(0.05, 5.0, 1.0), Sensor(shape=(64, 72), pitch=6e-6))
"""Its panel is smaller than its stop."""


def inside(centre, size):
    (cy, cx), (height, width) = centre, size

    def map_(y, x):
        return ((np.abs(y - cy) <= height / 2) & (np.abs(x - cx) <= width / 2)).astype(float)

    return map_


def scene(distances):
    """A square before a bar before a wall with two windows; things and the same as a target.

    No edge of one lies along another's: where two do, both blurred, their blurs aren't
    independent, and a product of them is wrong by up to 15 % of the light along that line.
    """
    near, middle, far = distances
    mid = (far / 0.0526) * 6e-6  # a pixel on the wall, metres
    small = 6e-6 * near / 0.0526
    square = ((2 * small, -8 * small), (26 * small, 22 * small))
    bar = 6e-6 * middle / 0.0526
    stripe = ((0.0, 20 * bar), (400 * bar, 12 * bar))
    windows = [
        ((-24 * mid, 13 * mid), (12 * mid, 46 * mid)),
        ((2 * mid, -18 * mid), (12 * mid, 24 * mid)),
    ]
    things = [
        Thing(near, lambda y, x: 0.9 * inside(*square)(y, x), inside(*square)),
        Thing(middle, lambda y, x: 0.6 * inside(*stripe)(y, x), inside(*stripe)),
        Thing(
            far, lambda y, x: 0.2 + sum(0.7 * inside(*w)(y, x) for w in windows), lambda y, x: 0 * y
        ),
    ]
    front, between = (
        Polygons((rectangle(*square),), (1.0,)),
        Polygons((rectangle(*stripe),), (1.0,)),
    )
    wall = Polygons(tuple(rectangle(*w) for w in windows), (0.9, 0.9), 0.2)
    grey = [Spectrum.even(share) for share in (0.9, 0.6)]
    target = Sheets(
        (
            Sheet(near, ((grey[0], front),), front),
            Sheet(middle, ((grey[1], between),), between),
            Sheet(far, ((None, wall),)),
        ),
        1e9,
    )
    return things, target


RAYS = Recipe(PANEL, 64, 3, occlusion=True, depths=9, pixel_aperture=True)


def compared(distances, recipe, rays):
    things, target = scene(distances)
    s = situation(target, CAMERA, Band(550e-9, 5e-9), numerics=1e-4)
    light = expected(s, recipe, ByteCache(), Ledger()).double().numpy()
    white = Sheets((Sheet(1.0, ((None, Polygons((rectangle((0, 0), (1, 1)),), (1.0,))),)),), 1e9)
    full = expected(situation(white, CAMERA, Band(550e-9, 5e-9)), recipe, ByteCache(), Ledger())
    middle = float(full[32, 36])
    return relative(light / middle, ray_traced(things, CAMERA, rays, seed=1))


@pytest.mark.parametrize(
    "distances",
    [(1.0, 1.2, 1.5), (0.8, 0.9, 1.0), (0.85, 1.0, 1.2), (0.8, 1.2, 1.3)],
    ids=["near in focus", "far in focus", "middle in focus", "none in focus"],
)
def test_defocus_and_occlusion_are_those_of_rays(distances):
    """Four strata in a pixel with 256 rays each: 5e6 rays."""
    assert compared(distances, RAYS, 16) <= 0.02


def test_without_occlusion_near_things_are_as_if_transparent():
    assert compared((0.8, 0.9, 1.0), RAYS.having(occlusion=False), 8) > 0.1


def test_waves_make_nearly_the_same_of_so_much_blur():
    recipe = RAYS.having(wave=True, dispersion=True, window=96)
    assert compared((0.8, 0.9, 1.0), recipe, 12) <= 0.03


def test_rays_carry_the_light_of_waves():
    """The same share of light within large squares, for a prism, a lens and an aberration."""
    panel = replace(PANEL, shape=(40, 40))
    lens = replace(CAMERA.lens, aberrations=((2, 2, 400e-9), (3, 1, 300e-9)))
    camera = replace(CAMERA, panel=panel, lens=lens)
    plane = Plane((71, 71), (4e-6, 4e-6))
    y, x = panel.plane.mesh()
    phase = 6e3 * y - 3e3 * x + 4e6 * (x**2 + y**2)
    field = torch.polar(torch.ones_like(phase), phase)
    rays = RayOperator(camera, 0.9, 550e-9, plane)(None, field).numpy()
    waves = PSFOperator(camera, 0.9, 550e-9, plane, integrate=False, unmodulated=0.0)(None, field)
    waves = waves.double().numpy()
    assert rays.sum() == pytest.approx(1.0, abs=1e-3)
    places = np.arange(71) - 35
    for light in (rays, waves):
        light /= light.sum()
    for axis in (0, 1):
        centres = [float((light.sum(1 - axis) * places).sum()) for light in (rays, waves)]
        assert centres[0] == pytest.approx(centres[1], abs=1.2)
    blocks = [light[:70, :70].reshape(7, 10, 7, 10).sum((1, 3)) for light in (rays, waves)]
    # A diffraction spot is as wide as a third of a block.
    assert np.abs(blocks[0] - blocks[1]).sum() <= 0.25


def test_a_square_pupil_out_of_focus_is_a_square():
    panel = replace(PANEL, shape=(41, 41), fill_factor=1.0)
    plane = Plane((101, 101), (2e-6, 2e-6))
    operator = RayOperator(replace(CAMERA, panel=panel), 0.8, 550e-9, plane)
    light = operator.straight().numpy()
    z = CAMERA.lens.image_distance
    half = 41 * 100e-6 / 2 * z * (1 / 0.8 - 1.0)
    expected_density = (2e-6 / (2 * half)) ** 2
    assert light.sum() == pytest.approx(1.0, abs=1e-9)
    assert light[50, 50] == pytest.approx(expected_density, rel=0.05)
    n = math.floor(half / 2e-6)
    assert light[50 - n + 2 : 50 + n - 1, 50 - n + 2 : 50 + n - 1].min() >= 0.9 * expected_density
    assert light[50, 50 + n + 3] == 0
