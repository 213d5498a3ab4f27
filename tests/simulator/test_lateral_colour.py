"""Lateral colour: images of other scale by wavelength, in place, light and sum."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, STAR, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Lens
from optics.light import Band
from simulator.effects.band_effects import Bandwidth
from simulator.effects.lens_effects import LateralColour
from simulator.effects.picture_norms import minimum_norms
from simulator.imaging import Imaging
from simulator.scene import Flat, PhotographPrint
from simulator.situation import Situation

CURVE = ((400e-9, 0.08), (550e-9, 0.0), (720e-9, -0.08))
APART = replace(CAMERA, lens=replace(CAMERA.lens, lateral_colour=CURVE))
WIDE = Band(540e-9, 60e-9)
PLACE = np.array([-1.4e-4, 1.6e-4])
"""Of a star's image in green light, metres."""


def star_in_the_corner():
    return replace(STAR, offset=tuple(PLACE / CAMERA.magnification(1.0)))


def random_print():
    image = np.random.default_rng(3).random((20, 24, 3)).astype(np.float32)
    return PhotographPrint(torch.from_numpy(image), 1.0, 1e7, cover=2.0)


def seen(target=None, camera: Camera = APART, band: Band = WIDE) -> Situation:
    return situation(target or star_in_the_corner(), camera, band)


def picture(s: Situation, **levels: int) -> np.ndarray:
    named = {name.replace("_", " "): level for name, level in levels.items()}
    return rendered(s, finest(s) | {"panel orders": 0} | named, ByteCache())


@pytest.mark.parametrize(("nanometres", "scale"), [(475, 1.04), (550, 1.0), (635, 0.96)])
def test_a_colour_is_imaged_at_its_scale_and_keeps_its_light(nanometres, scale):
    s = seen(band=Band(nanometres * 1e-9, 1e-9))
    found, straight = picture(s), picture(s, lateral_colour=0)
    y, x = (np.arange(n) - n // 2 for n in CAMERA.sensor.shape)
    for light, factor in ((found, scale), (straight, 1.0)):
        core = np.clip(light - 0.02 * light.max(), 0, None)
        middle = np.array([(core.sum(1) * y).sum(), (core.sum(0) * x).sum()]) / core.sum()
        assert np.abs(middle - factor * PLACE / CAMERA.sensor.pitch).max() < 0.06
    assert found.sum() == pytest.approx(straight.sum(), rel=0.01)


def test_even_light_is_as_dense_as_its_image_is_small():
    s = seen(Flat(1.0, 1e7), band=Band(475e-9, 1e-9))
    found, straight = picture(s), picture(s, lateral_colour=0)
    assert found / straight == pytest.approx(np.full(found.shape, 1.04**-2), rel=3e-3)
    curve = ((0.0, 1.0), (4e-4, 1.0))
    as_told = replace(APART, lens=replace(APART.lens, relative_illumination=curve))
    assert picture(seen(Flat(1.0, 1e7), as_told, s.band)) == pytest.approx(straight, rel=3e-3)


@pytest.mark.parametrize("bent", [pytest.param(0.0, marks=pytest.mark.sweep), 1500.0])
def test_a_band_is_the_sum_of_its_wavelengths(bent):
    """By the midpoint rule over narrow bands, each with as much light as the wide one has."""
    camera = replace(APART, lens=replace(APART.lens, distortion=(bent, 0.0)))
    low, high = WIDE.support
    middles = low + (high - low) * (np.arange(8) + 0.5) / 8
    shares = WIDE.transmission(middles) * middles
    wanted = 0.0
    for wavelength, share in zip(middles, shares / shares.sum(), strict=True):
        if share > 1e-5:
            narrow = seen(camera=camera, band=Band(float(wavelength), 0.1e-9))
            light = picture(narrow, filter_bandwidth=0)
            whole = picture(narrow, filter_bandwidth=0, lateral_colour=0, distortion=0)
            wanted = wanted + share * light / whole.sum()
    s = seen(camera=camera)
    found, straight = picture(s), picture(s, lateral_colour=0, distortion=0)
    assert found / straight.sum() == pytest.approx(wanted, abs=6e-3 * wanted.max())


@pytest.mark.parametrize("target", [random_print(), Flat(1.0, 1e7)], ids=type)
def test_no_more_changes_than_the_bound_and_no_less_is_left(target):
    s = seen(target)
    found, straight = picture(s), picture(s, lateral_colour=0)
    change = np.linalg.norm(found - straight)
    assert 1e-3 * np.linalg.norm(found) < change <= LateralColour().error_bound(s, 0).mean
    assert minimum_norms(s).mean <= np.linalg.norm(found)
    few = picture(s, filter_bandwidth=1) if "filter bandwidth" in finest(s) else found
    level = min(1, Bandwidth().finest_level(s))
    assert np.linalg.norm(few - found) <= Bandwidth().error_bound(s, level).mean + 1e-6 * change


def test_a_plan_takes_what_is_seen_and_nothing_else():
    assert not LateralColour().is_present(situation())
    plan = Imaging(1e-2).plan(seen(random_print()))
    assert plan.recipe.lateral_colour
    assert plan.recipe.wavelengths > 1
    weak = replace(CAMERA.lens, lateral_colour=((450e-9, 1e-6), (650e-9, -1e-6)))
    s = seen(random_print(), replace(CAMERA, lens=weak))
    assert not Imaging(1e-2).plan(s).recipe.lateral_colour


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"lateral_colour is 0.2 at 450 nm; it is between -0.1"):
        Lens(lateral_colour=((450e-9, 0.2), (550e-9, 0.0)))
    steep = replace(CAMERA.lens, lateral_colour=((540e-9, 0.0), (550e-9, 0.05)))
    with pytest.raises(ValueError, match=r"lateral_colour goes on to .* give its curve up to"):
        Imaging(1e-2).plan(seen(camera=replace(CAMERA, lens=steep)))
    wide = replace(CAMERA.sensor, shape=(2000, 4000))
    with pytest.raises(ValueError, match=r"moves light by \d+ pixels, and .* follows it over 128"):
        Imaging(1e-2).plan(seen(camera=replace(APART, sensor=wide)))
