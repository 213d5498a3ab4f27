"""Radial distortion against a slow renderer that looks up where every place's light comes from."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from judges.imperfect_camera import imperfect
from optical_situations import CAMERA, PANEL, STAR, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Lens, Sensor
from optics.camera.camera import RadialDistortion
from simulator.effects.lens_effects import Distortion
from simulator.effects.picture_norms import minimum_norms
from simulator.imaging import Imaging
from simulator.scene import Flat, PhotographPrint

BENT = [(-1500.0, 0.0), (2000.0, 0.0), (1200.0, -1.5e7)]
"""On a frame whose corner is .006 image distances from the axis: 5 to 7 % there."""


def bent(k: tuple[float, float], camera: Camera = CAMERA) -> Camera:
    return replace(camera, lens=replace(camera.lens, distortion=k))


def moved(height: float, k: tuple[float, float], z: float = CAMERA.lens.image_distance) -> float:
    return height * (1 + k[0] * (height / z) ** 2 + k[1] * (height / z) ** 4)


def smooth_print() -> PhotographPrint:
    """Waves of five pixels and more, all over the frame and beyond it."""
    y, x = np.mgrid[-1:1:80j, -1:1:100j]
    image = 0.5 + 0.2 * np.sin(9 * x + 7 * y) + 0.2 * np.cos(11 * y - 5 * x)
    shown = np.repeat(image[..., None], 3, 2).astype(np.float32)
    return PhotographPrint(torch.from_numpy(shown), 1.0, 1e7, cover=2.0)


def looked_up(k: tuple[float, float], finer: int = 4) -> np.ndarray:
    """From a straight picture on pixels 4 times finer, by the judge."""
    one = CAMERA.sensor
    rows, columns = (2 * n * finer for n in one.shape)
    fine = replace(CAMERA, sensor=replace(one, shape=(rows, columns), pitch=one.pitch / finer))
    # The print is as large as on the coarse frame: it covers what a frame does.
    s = situation(replace(smooth_print(), cover=1.0), fine)
    straight = rendered(s, {"light sampling": 0}, ByteCache()) * finer**2
    return imperfect(straight, finer, bent(k), 0.0)


@pytest.mark.parametrize("k", BENT)
def test_a_picture_is_looked_up_where_its_light_comes_from(k):
    s, cache = situation(smooth_print(), bent(k)), ByteCache()
    levels = {"light sampling": 2, "PSF reach": 0}
    straight, found = (rendered(s, levels | {"distortion": on}, cache) for on in (0, 1))
    wanted = looked_up(k)
    assert np.linalg.norm(straight - wanted) > 0.03 * np.linalg.norm(wanted)
    assert np.linalg.norm(found - wanted) <= 0.006 * np.linalg.norm(wanted)


@pytest.mark.parametrize("k", BENT)
def test_a_star_is_imaged_where_browns_formula_says_and_keeps_its_light(k):
    scale, place = CAMERA.magnification(1.0), np.array([-90e-6, 120e-6])
    star = replace(STAR, offset=tuple(place / scale))
    s, cache = situation(star, bent(k)), ByteCache()
    levels = finest(s) | {"panel orders": 0}
    straight, found = (rendered(s, levels | {"distortion": on}, cache) for on in (0, 1))
    y, x = (np.arange(n) - n // 2 for n in CAMERA.sensor.shape)
    for light, where in ((straight, place), (found, place * moved(150e-6, k) / 150e-6)):
        core = np.clip(light - 0.02 * light.max(), 0, None)
        middle = np.array([(core.sum(1) * y).sum(), (core.sum(0) * x).sum()]) / core.sum()
        assert np.abs(middle - where / CAMERA.sensor.pitch).max() < 0.06
    assert found.sum() == pytest.approx(straight.sum(), rel=5e-3)


@pytest.mark.parametrize("k", BENT)
def test_a_curve_of_relative_illumination_holds_where_light_lands(k):
    curve = ((0.0, 1.0), (1e-4, 0.9), (4e-4, 0.4))
    camera = bent(k)
    camera = replace(camera, lens=replace(camera.lens, relative_illumination=curve))
    s = situation(Flat(1.0, 1e7), camera)
    levels = {"light sampling": 2, "vignetting": 1}
    lit = rendered(s, levels | {"distortion": 1}, ByteCache())
    straight = replace(camera, lens=replace(camera.lens, distortion=(0.0, 0.0)))
    wanted = rendered(situation(Flat(1.0, 1e7), straight), levels, ByteCache())
    assert lit == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize(
    "k", [*BENT[:1], *(pytest.param(k, marks=pytest.mark.sweep) for k in BENT[1:])]
)
@pytest.mark.parametrize("target", [STAR, smooth_print(), Flat(1.0, 1e7)], ids=type)
def test_no_more_changes_than_the_bound_and_no_less_is_left(k, target):
    s, cache = situation(target, bent(k)), ByteCache()
    levels = finest(s) | {"panel orders": 0}
    straight, found = (rendered(s, levels | {"distortion": on}, cache) for on in (0, 1))
    change = np.linalg.norm(found - straight)
    assert change <= Distortion().error_bound(s, 0).mean * (1 + 1e-6)
    assert minimum_norms(s).mean <= np.linalg.norm(found)


def test_a_straight_lens_has_no_distortion_and_a_plan_takes_one_that_bends():
    assert not Distortion().is_present(situation())
    s = situation(smooth_print(), bent(BENT[0]))
    plan = Imaging(1e-2).plan(s)
    assert plan.recipe.distortion
    slightly = situation(smooth_print(), bent((-0.05, 0.0)))
    assert not Imaging(1e-2).plan(slightly).recipe.distortion


def test_heights_go_there_and_back():
    heights = np.linspace(0, 0.03, 500)
    for k in ((-0.3, 0.05), (0.4, 0.0), (0.1, -0.2)):
        by = RadialDistortion(k, 0.1)
        assert by.undistorted(by.distorted(heights)) == pytest.approx(heights, abs=1e-12)
        area = np.gradient(by.distorted(heights) ** 2, heights**2)
        assert by.area_gain(heights)[5:-5] == pytest.approx(area[5:-5], rel=1e-3)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="two finite numbers"):
        Lens(distortion=(float("nan"), 0.0))
    with pytest.raises(ValueError, match=r"folds back .* mm from the axis"):
        bent((-1e5, 0.0))
    wide = Camera(PANEL, Lens(0.01, 8.0, 1.0, distortion=(0.4, 0.0)),
                  Sensor(shape=(2000, 2400), pitch=4e-6))  # fmt: skip
    with pytest.raises(ValueError, match=r"moves light by \d+ pixels, and .* follows it over 128"):
        Imaging(1e-2).plan(situation(Flat(1.0, 1e7), wide))
