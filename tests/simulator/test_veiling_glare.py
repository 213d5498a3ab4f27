"""Veiling glare against ISO 9358's own measurement, and its bounds against pictures by chance."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, situation
from sensor_situations import BARE, changes, picture, read, sensor
from sensor_situations import situation as sharp_situation
from sweeps import some

from optics.caching import ByteCache
from optics.camera import Camera, Sensor
from simulator.effects.glare import VeilingGlare
from simulator.formation.mean_picture import expected_electrons
from simulator.ledger import Ledger
from simulator.recipe import Recipe
from simulator.scene import Flat, PhotographPrint

EFFECT = VeilingGlare()


def black_area(share: float) -> np.ndarray:
    """A white surround with a black area in its middle, as wide as a share of the frame."""
    image = np.ones((200, 240, 3), np.float32)
    rows, columns = (int(n * math.sqrt(share) / 2) for n in image.shape[:2])
    image[100 - rows : 100 + rows, 120 - columns : 120 + columns] = 0
    return image


def formed(camera: Camera, image: np.ndarray, glare: bool) -> np.ndarray:
    """On a sensor that is wholly covered, and without blur by diffraction."""
    s = situation(PhotographPrint(torch.from_numpy(image), 1.0, 1e8, cover=2.0), camera)
    recipe = Recipe.minimal(s).with_changes(pixel_aperture=True, glare=glare)
    return expected_electrons(s, recipe, ByteCache(), Ledger()).double().numpy()


@pytest.mark.parametrize("glare", [0.003, 0.05, 0.5])
def test_the_index_is_what_the_standard_measures(glare):
    """ISO 9358: light in the image of a small black area over that of white in its place, both in
    a white surround."""
    camera = replace(CAMERA, glare=glare, sensor=Sensor(shape=(100, 120), pitch=20e-6))
    white = formed(camera, black_area(0.0), True)[50, 60]
    black = formed(camera, black_area(0.01), True)[50, 60]
    # The area itself sends no light.
    lit = formed(camera, black_area(0.01), False).mean() / white
    assert 0.9 < lit < 1
    assert black / white == pytest.approx(glare * lit, rel=1e-4)


def test_no_light_is_lost_and_none_is_won():
    camera = replace(CAMERA, glare=0.2)
    image = np.random.default_rng(2).random((50, 60, 3)).astype(np.float32)
    without, veiled = formed(camera, image, False), formed(camera, image, True)
    assert veiled.sum() == pytest.approx(without.sum(), rel=1e-6)
    assert veiled == pytest.approx(0.8 * without + 0.2 * without.mean(), rel=1e-5)


def test_even_light_stays_as_it_is_and_needs_no_veil():
    s = situation(Flat(1.0, 1e7), replace(CAMERA, glare=0.1))
    recipe = Recipe.minimal(s).with_changes(glare=True)
    lit = expected_electrons(s, recipe, ByteCache(), Ledger())
    assert float(lit.std() / lit.mean()) < 1e-6
    assert EFFECT.error_bound(s, 0).mean <= 2e-3 * float(torch.linalg.vector_norm(lit))


def test_a_camera_without_glare_knows_nothing_of_it():
    assert not EFFECT.is_present(situation())
    assert EFFECT.is_present(situation(camera=replace(CAMERA, glare=0.01)))


@pytest.mark.parametrize("glare", [-0.1, 1.1, math.nan])
def test_a_camera_refuses_a_glare_that_is_no_share(glare):
    with pytest.raises(ValueError, match=r"glare is .*must lie between 0 and 1"):
        Camera(glare=glare)


def seen(light: torch.Tensor, one: Sensor, glare: float):
    """The bound, and by how much what is read differs, in mean, variance and σ."""
    s = sharp_situation(light, one)
    s.camera = replace(s.camera, glare=glare)
    recipe = BARE.with_changes(shot="Poisson", read_noise=True, dark_current=True)
    veiled = torch.lerp(light, light.mean(), glare)
    found = (read(part, one, s.exposure, recipe) for part in (veiled, light))
    return EFFECT.error_bound(s, 0), changes(*found)


@pytest.mark.parametrize("seed", some(range(40), *range(0, 40, 2)))
def test_what_is_read_differs_by_no_more_than_the_bound(seed):
    rng = np.random.default_rng(seed)
    light = picture(rng, 10 ** rng.uniform(0, 4))
    if seed % 4 == 0:
        # All light but what a tenth of the pixels would have, which are black.
        light = torch.full((12, 12), float(light.max()), dtype=torch.float64)
        light[0, :] = 0
    bound, (mean, variance, sigma) = seen(light, sensor(rng), float(rng.choice([0.005, 0.1, 0.9])))
    slack = 1 + 1e-9
    assert mean <= bound.mean * slack
    assert variance <= bound.variance * slack
    assert sigma <= bound.sigma * slack


def test_the_bound_of_noise_is_near_what_changes():
    """Photons in the dark: a star's light that is spread over pixels which have none."""
    light = torch.zeros(12, 12, dtype=torch.float64)
    light[6, 6] = 1e4
    one = Sensor(shape=(12, 12), read_noise=0.0, dark_current=0.0, full_well=1e6, bits=16, gain=1.0)
    bound, (mean, variance, sigma) = seen(light, one, 0.05)
    assert bound.mean <= 1.3 * mean
    assert bound.variance <= 1.5 * variance
    assert bound.sigma <= 2 * sigma
