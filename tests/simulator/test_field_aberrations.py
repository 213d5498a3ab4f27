"""Field aberrations against a direct sum of waves, and what their bounds say of few places."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.aberrated_star import aberrated_star
from judges.imperfect_camera import imperfect
from optical_situations import CAMERA, CORNER, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Sensor
from optics.camera.field_aberrations import FieldAberrations as Aberrations
from optics.camera.field_aberrations import add_aberrations
from optics.light import Band
from optics.zernike import zernike
from simulator.effects.field_effects import FieldAberrations
from simulator.effects.psf_bounds import displacement
from simulator.mount import Mount
from simulator.scene import PhotographPrint, Star

STAR = Star(200e-6, 1.0, 1e11, (3.0e-3, -3.4e-3))
PANEL = replace(CAMERA.panel, unmodulated=0.0)
NARROW = Band(550e-9, 1e-9)


def bent(coma=0.0, astigmatism=0.0, curvature=0.0, **more) -> Camera:
    by = Aberrations(CORNER, coma, astigmatism, curvature)
    return replace(CAMERA, panel=PANEL, lens=replace(CAMERA.lens, field_aberrations=by), **more)


def picture(camera: Camera, level: int, target=STAR, mount: Mount | None = None) -> np.ndarray:
    s = situation(target, camera, NARROW, mount=mount)
    off = ("panel orders", "filter bandwidth", "vignetting")
    levels = finest(s) | dict.fromkeys(off, 0)
    return rendered(s, levels | {"field aberrations": level}, ByteCache())


def test_seidels_wave_is_its_zernike_polynomials():
    by, rng = Aberrations(5e-3, 300e-9, -200e-9, 120e-9), np.random.default_rng(1)
    y, x = rng.uniform(-0.7, 0.7, (2, 50))
    for place in [(3e-3, -2e-3), (0.0, 5e-3), (-6e-3, 1e-3)]:
        terms = by.at(*place)
        path = sum(one * zernike(n, m, torch.tensor(y), torch.tensor(x)) for n, m, one in terms)
        off = by.path(place, y, x) - path.numpy()
        assert np.ptp(off) < 1e-12 * np.ptp(path.numpy())
    assert by.at(0.0, 0.0) == ()


def test_aberrations_add_up():
    both = add_aberrations(((2, 0, 1e-9), (3, 1, 2e-9)), ((3, 1, 3e-9),))
    assert both == ((2, 0, 1e-9), (3, 1, 5e-9))


@pytest.mark.parametrize(
    "waves", [{"coma": 2e-7}, {"astigmatism": -2.5e-7, "curvature": 3e-7}], ids=["coma", "fields"]
)
def test_a_star_off_the_axis_is_what_its_waves_add_up_to(waves):
    camera, finer = bent(**waves), 4
    shape, pitch = [2 * n * finer for n in camera.sensor.shape], camera.sensor.pitch / finer
    wanted, sharp = (
        imperfect(aberrated_star(STAR, one, 550e-9, shape, pitch), finer, camera, 0.0)
        for one in (camera, replace(camera, lens=CAMERA.lens))
    )
    found, plain = picture(camera, 3), picture(camera, 0)
    light = (plain * sharp).sum() / (sharp**2).sum()
    assert np.linalg.norm(found - plain) > 0.1 * np.linalg.norm(plain)
    # The judge's pixels have 4 x 4 samples: as well does it know the unaberrated star.
    assert np.linalg.norm(plain - light * sharp) < 0.012 * np.linalg.norm(plain)
    assert np.linalg.norm(found - light * wanted) < 0.015 * np.linalg.norm(found)


def test_coma_moves_light_outwards_by_its_rays():
    """By the mean of the wave's slopes over the stop, to first order of the aberration."""
    camera = bent(coma=5e-8)
    camera = replace(camera, panel=replace(PANEL, shape=(40, 40)))  # Wider than the stop.
    whole = replace(camera, sensor=Sensor((60, 60), 20e-6, full_well=1e7, bits=16))
    y, x = np.mgrid[-30:30, -30:30] * 20e-6
    with_, without = (picture(whole, level) for level in (2, 0))
    away = [
        float((with_ * p).sum() / with_.sum() - (without * p).sum() / without.sum()) for p in (y, x)
    ]
    place = [one * camera.magnification(1.0) for one in STAR.offset]
    # The mean of the gradient of r² (v·H) over the disc is H.
    scale = 5e-8 / CORNER / float(camera.lens.image_numerical_aperture)
    assert away == pytest.approx([scale * one for one in place], rel=0.1)
    assert math.hypot(*away) < displacement(situation(STAR, camera))


@pytest.mark.parametrize("mount", [Mount(flip_x=True), Mount(rotation=math.pi)])
def test_a_turned_panel_does_not_turn_the_lens(mount):
    camera = bent(coma=1.5e-7, astigmatism=1e-7)
    even = replace(camera, panel=replace(PANEL, shape=(25, 33)))
    straight, turned = picture(even, 1), picture(even, 1, mount=mount)
    assert np.linalg.norm(turned - straight) < 2e-3 * np.linalg.norm(straight)


@pytest.mark.parametrize("nanometres", [4.0, 60.0])
def test_bounds_hold_for_few_places(nanometres):
    rng = np.random.default_rng(3)
    image = torch.from_numpy(rng.random((24, 30, 3)).astype(np.float32))
    parts = nanometres * 1e-9 * rng.uniform(-1, 1, 3)
    camera, cache = bent(*(float(one) for one in parts)), ByteCache()
    for target in (STAR, PhotographPrint(image, 1.0, 1e8, cover=1.2)):
        s = situation(target, camera, NARROW, numerics=1e-3)
        effect, top = FieldAberrations(), FieldAberrations().finest_level(s)
        levels = finest(s) | {"panel orders": 0, "filter bandwidth": 0}
        every = [rendered(s, levels | {effect.name: k}, cache) for k in range(top + 1)]
        for level in range(top):
            change = np.linalg.norm(every[level] - every[top])
            assert 0 < change <= effect.error_bound(s, level).mean
        assert top == (1 if nanometres < 10 else 2)


def test_a_lens_without_them_has_no_such_effect():
    assert not FieldAberrations().is_present(situation())
    assert not FieldAberrations().is_present(situation(camera=bent()))
    assert FieldAberrations().is_present(situation(camera=bent(coma=1e-9)))


def test_more_waves_than_places_resolve_are_refused():
    with pytest.raises(ValueError, match=r"field_aberrations span .* waves .* give smaller"):
        FieldAberrations().finest_level(situation(camera=bent(curvature=2e-5)))


@pytest.mark.parametrize(
    ("data", "name"),
    [((0.0, 1e-9), "height"), ((1e-3, math.nan), "coma"), ((1e-3, 0, 0, 500.0), "curvature")],
)
def test_data_that_cannot_be_are_refused(data, name):
    with pytest.raises(ValueError, match=name):
        Aberrations(*data)
