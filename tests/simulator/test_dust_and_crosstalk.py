"""Dust and pixel crosstalk against rays and loops, and their bounds against pictures by chance."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, rendered, situation
from sensor_situations import BARE, changes, picture, read, sensor
from sensor_situations import situation as sharp_situation
from sweeps import some

from optics.caching import ByteCache
from optics.camera import Camera, Sensor
from optics.light import Spectrum
from optics.sensor import Mosaic
from optics.sensor.stages import mix_neighbours
from simulator.effects.pixel_effects import Dust, PixelCrosstalk
from simulator.formation.dust_shadows import cast_shadows
from simulator.imaging import Imaging
from simulator.scene import Flat, PhotographPrint

DUSTY = replace(
    CAMERA,
    lens=replace(CAMERA.lens, f_number=10.0),
    sensor=replace(
        CAMERA.sensor,
        dust=((60e-6, -80e-6, 150e-6), (-150e-6, 100e-6, 12e-6), (-40e-6, 30e-6, 40e-6)),
        dust_distance=1e-3,
    ),
)


def photograph() -> PhotographPrint:
    image = np.random.default_rng(2).random((50, 60, 3)).astype(np.float32)
    return PhotographPrint(torch.from_numpy(image), 1.0, 1e8, cover=2.0)


def formed(camera: Camera, **on: int) -> np.ndarray:
    levels = {"light sampling": 1} | {name.replace("_", " "): level for name, level in on.items()}
    return rendered(situation(photograph(), camera), levels, ByteCache())


def traced_share(camera: Camera, row: int, column: int) -> float:
    """Of a pixel's rays that pass all specks, from points all over the stop and the pixel."""
    one, lens = camera.sensor, camera.lens
    side = (np.arange(120) + 0.5) / 60 - 1
    sy, sx = (part.ravel() * lens.stop_diameter / 2 for part in np.meshgrid(side, side))
    inside = sy**2 + sx**2 <= (lens.stop_diameter / 2) ** 2
    sy, sx = sy[inside], sx[inside]
    fine = (np.arange(5) + 0.5) / 5 - 0.5
    shares = []
    for dy in fine:
        for dx in fine:
            py = (row - one.shape[0] // 2 + dy) * one.pitch
            px = (column - one.shape[1] // 2 + dx) * one.pitch
            step = one.dust_distance / lens.image_distance
            gy, gx = py + (sy - py) * step, px + (sx - px) * step
            free = np.ones(len(sy), bool)
            for y, x, diameter in one.dust:
                free &= (gy - y) ** 2 + (gx - x) ** 2 > diameter**2 / 4
            shares.append(free.mean())
    return float(np.mean(shares))


def test_a_shadow_is_that_of_rays():
    bare, dusty = formed(DUSTY), formed(DUSTY, dust=1)
    places = [(13, 8), (12, 8), (10, 6), (13, 5), (15, 9), (2, 17), (3, 17), (8, 13), (7, 14)]
    wanted = np.array([traced_share(DUSTY, *place) for place in places])
    found = np.array([dusty[place] / bare[place] for place in places])
    assert wanted.min() < 0.2
    assert 0.9 < wanted[5] < 0.99
    assert np.abs(found - wanted).max() < 0.004


def test_a_small_aperture_makes_a_speck_a_disc_of_its_own_size():
    pinhole = replace(DUSTY, lens=replace(DUSTY.lens, f_number=1e4))
    light = torch.ones(1, *pinhole.sensor.shape)
    cast_shadows(light, pinhole.sensor, pinhole.lens)
    dark = float((1 - light).sum()) * pinhole.sensor.pitch**2
    area = sum(math.pi * d**2 / 4 for _, _, d in pinhole.sensor.dust)
    assert dark == pytest.approx(area / (1 - 1e-3 / pinhole.lens.image_distance) ** 2, rel=0.01)


def mixed(electrons: np.ndarray, share: float) -> np.ndarray:
    """Pixel after pixel gives to the eight around it; beyond the edge it gets as much back."""
    rows, columns = electrons.shape
    found = np.zeros_like(electrons)
    along = {-1: share, 0: 1 - 2 * share, 1: share}
    for i in range(rows):
        for j in range(columns):
            for di, of_row in along.items():
                for dj, of_column in along.items():
                    k = min(max(i + di, 0), rows - 1), min(max(j + dj, 0), columns - 1)
                    found[k] += electrons[i, j] * of_row * of_column
    return found


@pytest.mark.parametrize("share", [0.01, 0.08, 0.25])
def test_neighbours_collect_their_share_and_nothing_is_lost(share):
    camera = replace(CAMERA, sensor=replace(CAMERA.sensor, crosstalk=share))
    bare, crossed = formed(camera), formed(camera, pixel_crosstalk=1)
    assert crossed == pytest.approx(mixed(bare, share), rel=1e-5)
    assert crossed.sum() == pytest.approx(bare.sum(), rel=1e-6)


@pytest.mark.parametrize("cycles", [1, 3, 8, 16])
def test_fringes_keep_the_contrast_of_the_mtf(cycles):
    x = torch.arange(32).double()
    fringes = (1 + torch.cos(2 * math.pi * cycles * x / 32)).expand(6, 32)
    crossed = mix_neighbours(fringes, 0.07)[3, 2:-2]
    mtf = 1 - 2 * 0.07 * (1 - math.cos(2 * math.pi * cycles / 32))
    assert (crossed - 1).numpy() == pytest.approx(mtf * (fringes[3, 2:-2] - 1).numpy(), abs=1e-12)


def test_crosstalk_mixes_colours():
    """Behind green and blue filters: half of the neighbours in row and column are of the other."""
    curves = {"G": Spectrum.flat(0.6), "B": Spectrum.flat(0.2)}
    one = replace(CAMERA.sensor, colour=Mosaic(("GB", "BG"), curves), crosstalk=0.05)
    s = situation(Flat(1.0, 1e7), replace(CAMERA, sensor=one))
    recipe = Imaging(0.0).plan(s).recipe.with_changes(crosstalk=False)
    bare = Imaging(0.0).electrons(s, recipe).double().numpy()
    crossed = Imaging(0.0).electrons(s, recipe.with_changes(crosstalk=True)).double().numpy()
    assert crossed == pytest.approx(mixed(bare, 0.05), rel=1e-5)
    assert bare.max() / bare.min() == pytest.approx(3, rel=0.1)
    change = np.linalg.norm(crossed - bare)
    assert change <= PixelCrosstalk().error_bound(s, 0).mean <= 5 * change


def test_a_clean_sensor_knows_nothing_of_either():
    s = situation()
    assert not Dust().is_present(s)
    assert not PixelCrosstalk().is_present(s)
    beside = replace(CAMERA.sensor, dust=((1e-2, 0.0, 1e-5),), dust_distance=1e-3)
    assert not Dust().is_present(situation(camera=replace(CAMERA, sensor=beside)))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"crosstalk": 0.26}, r"crosstalk is 0\.26; .* 0 to 0\.25"),
        ({"crosstalk": math.nan}, "crosstalk is nan"),
        ({"dust": ((0.0, 0.0, 1e-5),)}, "dust_distance to the pixels"),
        ({"dust": ((0.0, 0.0, 0.0),), "dust_distance": 1e-3}, "diameter of more than 0"),
        ({"dust": ((math.inf, 0.0, 1.0),), "dust_distance": 1e-3}, "speck"),
        ({"dust_distance": -1.0}, "can't be negative"),
    ],
)
def test_data_that_cannot_be_are_refused(data, words):
    with pytest.raises(ValueError, match=words):
        Sensor(**data)


@pytest.mark.parametrize("seed", some(range(40), *range(0, 40, 4)))
def test_what_is_read_differs_by_no_more_than_the_bounds(seed):
    rng = np.random.default_rng(seed)
    light, other = picture(rng, 10 ** rng.uniform(0, 4)), np.random.default_rng([seed, 1])
    speck = (float(other.uniform(-2e-5, 2e-5)), 0.0, float(other.uniform(1e-5, 3e-4)))
    crosstalk = float(other.choice([0.01, 0.1, 0.25]))
    one = sensor(rng, crosstalk=crosstalk, dust_distance=1e-3, dust=(speck,))
    s = sharp_situation(light, one)
    dusty = light[None].clone()
    cast_shadows(dusty, one, s.camera.lens)
    recipe = BARE.with_changes(shot="Poisson", read_noise=True, dark_current=True)
    before = read(light, one, s.exposure, recipe)
    for effect, changed in (
        (PixelCrosstalk(), mix_neighbours(light, one.crosstalk)),
        (Dust(), dusty[0]),
    ):
        bound = effect.error_bound(s, 0)
        found = changes(read(changed, one, s.exposure, recipe), before)
        for change, most in zip(found, (bound.mean, bound.variance, bound.sigma), strict=True):
            assert change <= most * (1 + 1e-9), effect.name
