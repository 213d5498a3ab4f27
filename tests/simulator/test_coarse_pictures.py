"""Coarse pictures are near the exact ones, for patterns from none to steep ones."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from small_bench.files import Size, bench_text
from sweeps import some

from labapp.bench.opening import BenchFiles, open_bench
from optics.light import Spectrum
from optics.patterns import fresnel_lens
from optics.sensor import Mosaic
from optics.slm import phase_to_grey
from simulator.coarse_pictures import CoarsePictures, pixels_joined, psf_window

_SHAPE = (576, 768)

_SCENE = """
version = 1
title = "Photograph"
tol = 0.02
[targets.photograph]
kind = "photograph"
file = "picture.png"
distance_m = 2.0
radiance = 0.1
"""


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A sensor of more pixels than a coarse picture has, before a picture with fine detail."""
    folder = tmp_path_factory.mktemp("coarse")
    rng = np.random.default_rng(5)
    rough = cv2.resize(rng.random((36, 48), np.float32), (768, 576), interpolation=cv2.INTER_CUBIC)
    grey = np.clip(255 * rough, 0, 255).astype(np.uint8)
    cv2.imwrite(str(folder / "picture.png"), grey)
    (folder / "bench.toml").write_text(bench_text(Size(sensor=_SHAPE)))
    (folder / "scene.toml").write_text(_SCENE)
    with open_bench(BenchFiles(folder / "bench.toml", folder / "scene.toml")) as bench:
        yield bench.world


def spreading(world, focal_length):
    panel = world.camera.panel
    return phase_to_grey(panel, fresnel_lens(panel, focal_length, 550e-9), 550e-9).numpy()


@pytest.mark.parametrize("focal_length", some([math.inf, 40.0, -15.0, 8.0], 0, 3))
def test_a_coarse_picture_is_within_a_tenth_of_the_exact_one(world, focal_length):
    world.grey = (
        np.zeros(world.camera.panel.shape, np.uint8)
        if math.isinf(focal_length)
        else spreading(world, focal_length)
    )
    s = world.situation(0.1)
    coarse = CoarsePictures().predict(s)
    exact = world.imaging.electrons(s, world.imaging.plan(s).recipe)
    joined = pixels_joined(world.camera)
    assert joined == 2
    assert tuple(coarse.shape) == (288, 384)
    mean = exact.reshape(288, 2, 384, 2).mean(dim=(1, 3))
    assert float((coarse - mean).norm() / mean.norm()) < 0.1
    assert float(coarse.sum() / mean.sum()) == pytest.approx(1, abs=0.05)


def test_the_window_follows_the_slope_of_the_pattern(world):
    """A blazed grating of n pixels sends light to λ b / (n pitch) on the sensor."""
    camera = world.camera
    for period in (8, 16):
        ramp = torch.arange(camera.panel.shape[1]) % period * (2 * math.pi / period)
        phase = ramp.expand(camera.panel.shape)
        world.grey = phase_to_grey(camera.panel, phase, 550e-9).numpy()
        away = 550e-9 * float(camera.ray_matrix_b) / (period * camera.panel.pitch)
        wanted = 2 * away / camera.sensor.pitch
        margin = 0.3e-3 / camera.sensor.pitch
        assert psf_window(world.situation(0.1)) == pytest.approx(wanted + margin, rel=0.05)


def test_sensors_with_colour_filters_are_refused(world):
    s = world.situation(0.1)
    curves = {name: Spectrum((500e-9, 600e-9), (0.4, 0.4)) for name in "RGB"}
    sensor = replace(s.camera.sensor, colour=Mosaic(("RG", "GB"), curves))
    with pytest.raises(ValueError, match="colour filters"):
        CoarsePictures().predict(replace(s, camera=replace(s.camera, sensor=sensor)))
