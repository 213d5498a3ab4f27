"""Bounds of pixel aperture, colour filters and rolling shutter against direct computation."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from sensor_situations import situation
from sweeps import some

from optics.camera import Camera, Lens, Sensor
from optics.light import Band, Spectrum, Waveform
from optics.sensor import Mosaic
from simulator.effects.pixel_effects import ColourFilters, PixelAperture
from simulator.effects.time_effects import RollingShutter
from simulator.probing.picture_probe import electron_rates

FINER = 16
SIDE = 24
BAND = Band(550e-9, 20e-9)


def scene(rng):
    """Light on samples that are sixteen times finer than pixels."""
    fine = np.zeros((SIDE * FINER,) * 2)
    kind = rng.integers(4)
    if kind == 0:
        fine[tuple(rng.integers(fine.shape[0], size=2))] = 1e4
    elif kind == 1:
        angle, place = rng.uniform(0, math.pi), rng.uniform(0.3, 0.7)
        y, x = np.mgrid[0 : 1 : 1j * fine.shape[0], 0 : 1 : 1j * fine.shape[1]]
        fine[(x - place) * math.cos(angle) + (y - place) * math.sin(angle) > 0] = 5.0
    elif kind == 2:
        y, x = np.mgrid[0 : fine.shape[0], 0 : fine.shape[1]] / FINER
        fine += 1 + np.cos(2 * math.pi * (rng.uniform(0, 0.5) * y + rng.uniform(0, 0.5) * x))
    else:
        fine += np.kron(rng.random((SIDE // 2,) * 2), np.ones((2 * FINER,) * 2))
    return fine


def blurred(fine, rng, cutoff):
    """By a lens that passes no more than `cutoff` cycles a pixel, and is as blurred as may be."""
    fy = np.fft.fftfreq(fine.shape[0], 1 / FINER)[:, None]
    fx = np.fft.rfftfreq(fine.shape[1], 1 / FINER)[None, :]
    radius = np.minimum(np.hypot(fy, fx) / cutoff, 1)
    clear = 2 / math.pi * (np.arccos(radius) - radius * np.sqrt(1 - radius**2))
    blur = np.exp(-(np.hypot(fy, fx) ** 2) * rng.uniform(0, 10))
    return np.fft.irfft2(np.fft.rfft2(fine) * clear * blur, s=fine.shape)


def averaged(fine):
    """Over pixels around every FINER-th sample, periodic, by Simpson-like halves at the ends."""
    kernel = np.ones(FINER + 1)
    kernel[[0, -1]] = 0.5
    for axis in (0, 1):
        fine = sum(
            weight * np.roll(fine, shift, axis)
            for weight, shift in zip(kernel, range(-FINER // 2, FINER // 2 + 1), strict=True)
        )
    return fine[::FINER, ::FINER]


@pytest.mark.parametrize("seed", some(range(40), *range(0, 40, 2)))
def test_pixels_take_no_more_than_is_told(seed):
    """The light at pixels' middles against its mean over them, whatever the blur."""
    rng = np.random.default_rng(seed)
    fine = scene(rng)
    one = Sensor(shape=(SIDE, SIDE), dark_current=0.0)
    lens = Lens(focal_length=0.05, f_number=float(rng.choice([1.4, 2.8, 5.6, 11.0])))
    s = situation(torch.from_numpy(averaged(fine)), one, 1.0, band=BAND)
    s.camera = Camera(sensor=one, lens=lens)
    cutoff = 2 * lens.image_numerical_aperture / BAND.support[0] * one.pitch
    light = blurred(fine, rng, cutoff)
    difference = light[::FINER, ::FINER] * FINER**2 - averaged(light)
    assert np.linalg.norm(difference) <= PixelAperture().error_bound(s, 0).mean


def test_smooth_pictures_lose_nothing_to_pixels():
    """A cosine of 100 pixels' length: (π/100)²/6 of its contrast, which is half of the light."""
    x = torch.arange(100, dtype=torch.float64)
    light = (1 + torch.cos(2 * math.pi * x / 100)).expand(100, 100).clone()
    s = situation(light, Sensor(shape=(100, 100)), 1.0, band=BAND)
    s.camera = replace(s.camera, lens=Lens(focal_length=0.05, f_number=5.6))
    norm = math.sqrt(0.5) * 100
    told = PixelAperture().estimated_error(s, 0) * s.picture_probe.norm_bound
    assert told == pytest.approx((math.pi / 100) ** 2 / 6 * norm, rel=0.2)
    assert PixelAperture().error_bound(s, 1).mean == 0


CURVES = {
    "R": Spectrum((500e-9, 620e-9, 720e-9), (0.01, 0.4, 0.1)),
    "G": Spectrum((450e-9, 540e-9, 640e-9), (0.0, 0.5, 0.05)),
    "B": Spectrum((400e-9, 460e-9, 560e-9), (0.1, 0.4, 0.02)),
}
BAYER = Sensor(shape=(12, 12), colour=Mosaic(("RG", "GB"), CURVES))


@pytest.mark.parametrize("seed", range(12))
def test_filters_differ_from_the_mean_pixel_by_no_more_than_is_told(seed):
    """Each pixel's electrons by direct integrals over wavelengths, of two parts of two colours."""
    rng = np.random.default_rng(seed)
    camera = Camera(sensor=BAYER)
    band = Band(float(rng.uniform(450e-9, 650e-9)), float(rng.uniform(10e-9, 120e-9)))
    parts = [
        SimpleNamespace(spectrum=Spectrum((400e-9, 720e-9), tuple(rng.uniform(1, 9, 2))))
        for _ in range(2)
    ]
    pictures = rng.random((2, 12, 12))
    rates = [electron_rates(part.spectrum, band, camera, 2.0) for part in parts]
    area = BAYER.pitch**2
    light = sum(area * max(rate) * one for rate, one in zip(rates, pictures, strict=True))
    s = situation(torch.from_numpy(light), BAYER, 1.0, band=band)
    s.camera = camera
    s.target = SimpleNamespace(
        speckle=None,
        lamp=None,
        is_moving=False,
        layers=(SimpleNamespace(distance=2.0, parts=tuple(parts), cover=None),),
    )
    channel = BAYER.colour.channel_map((12, 12)).numpy()
    filtered = sum(
        area * np.array(rate)[channel] * one for rate, one in zip(rates, pictures, strict=True)
    )
    shares = np.array([0.25, 0.5, 0.25])
    even = sum(
        area * (shares @ np.array(rate)) * one for rate, one in zip(rates, pictures, strict=True)
    )
    measured = np.linalg.norm(filtered - even)
    assert 0 < measured <= ColourFilters().error_bound(s, 0).mean


def rolling(exposure, lamp=None, is_moving=False, moment=0.0):
    one = Sensor(shape=(40, 12), shutter="rolling", line_time=50e-6, dark_current=0.0)
    s = situation(torch.full((40, 12), 100.0), one, exposure, exposure_start=moment)
    s.target = SimpleNamespace(speckle=None, lamp=lamp, is_moving=is_moving, layers=())
    return s


@pytest.mark.parametrize("exposure", [0.3e-3, 4e-3, 10e-3])
@pytest.mark.parametrize("moment", [0.0, 3.3e-3])
def test_rows_see_a_lamp_as_its_integral_over_their_time(exposure, moment):
    """Sine by its antiderivative."""
    lamp = Waveform("sine", 100.0, 0.4)
    s = rolling(exposure, lamp, moment=moment)
    starts = moment + 50e-6 * np.arange(40)

    def integral(t):
        return t - 0.4 * np.cos(2 * math.pi * 100 * t) / (2 * math.pi * 100)

    rows = (integral(starts + exposure) - integral(starts)) * 100
    measured = np.linalg.norm(np.repeat(rows - rows[0], 12))
    bound = RollingShutter().error_bound(s, 0).mean
    assert measured <= bound
    assert bound <= 40 * max(measured, 1e-9) or exposure == 10e-3
    if exposure == 10e-3:
        assert bound == pytest.approx(0, abs=1e-9)


def test_something_that_moves_may_be_elsewhere_in_the_time_that_rows_dont_share():
    """A light that is on only after the first row has ended: nothing for it, all for the last."""
    s = rolling(1e-3, is_moving=True)
    assert RollingShutter().error_bound(s, 0).mean >= np.linalg.norm(
        np.full((40, 12), 100.0 * 1e-3)
    )
    assert RollingShutter().estimated_error(s, 0) == 2.0


def test_a_rolling_shutter_before_what_stands_still_is_in_no_plan():
    assert not RollingShutter().is_present(rolling(1e-3))
    assert not RollingShutter().is_present(rolling(1e-3, Waveform("constant")))
    assert RollingShutter().is_present(rolling(1e-3, is_moving=True))
    still = situation(torch.ones(12, 12), Sensor(shape=(12, 12)))
    still.target.is_moving = True
    assert not RollingShutter().is_present(still)


@pytest.mark.parametrize("effect", [PixelAperture(), ColourFilters(), RollingShutter()])
def test_they_say_what_they_are(effect):
    s = rolling(1e-3, is_moving=True)
    fine = torch.from_numpy(np.random.default_rng(0).random((40, 12)))
    s.picture_probe = situation(fine, s.camera.sensor).picture_probe
    s.band = BAND
    s.camera = replace(s.camera, sensor=replace(s.camera.sensor, colour=BAYER.colour))
    part = SimpleNamespace(spectrum=Spectrum.flat(1.0))
    s.target.layers = (SimpleNamespace(distance=2.0, parts=(part,), cover=None),)
    assert effect.is_present(s)
    assert effect.explain(s)
    assert effect.added_operations(s, {effect.name: 0}) == 0
    assert effect.added_operations(s, {effect.name: 1}) > 0
    assert effect.error_bound(s, 1).mean == 0 < effect.error_bound(s, 0).mean
