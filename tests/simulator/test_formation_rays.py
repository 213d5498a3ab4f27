"""Defocus and occlusion against rays."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from figures.depth import CAMERA, GEOMETRIC, PANEL, PLACES, ray_error

from optics.plane import Plane
from optics.psf import PSFOperator
from simulator.formation.rays import RayOperator

SWEPT = ("far in focus", "none in focus")


@pytest.mark.parametrize(
    "distances",
    [
        pytest.param(places, id=name, marks=[pytest.mark.sweep] if name in SWEPT else [])
        for name, places in PLACES.items()
    ],
)
def test_defocus_and_occlusion_are_those_of_rays(distances):
    """Four strata in a pixel with 256 rays each: 5e6 rays."""
    assert ray_error(distances, GEOMETRIC, 16) <= 0.02


def test_without_occlusion_near_things_are_as_if_transparent():
    assert ray_error((0.8, 0.9, 1.0), GEOMETRIC.with_changes(occlusion=False), 8) > 0.1


def test_waves_make_nearly_the_same_of_so_much_blur():
    recipe = GEOMETRIC.with_changes(diffraction=True, dispersion=True, window=96)
    assert ray_error((0.8, 0.9, 1.0), recipe, 12) <= 0.03


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
