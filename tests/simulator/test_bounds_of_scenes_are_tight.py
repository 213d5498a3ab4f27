"""Bounds of what follows from target and pixels alone are not much larger than what they do.

Each effect in a situation that comes near the worst that its bound knows of, at every level; what
a bound may be larger by stands with its reason.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sensor_situations
import torch
from scene_situations import (
    ACROSS,
    LENS,
    PITCH,
    SIDE,
    at,
    at_depths,
    blurred,
    camera,
    frame,
    psf,
    seen_and_transparent,
    situation,
)

from optics.camera import Camera, Lens, Sensor
from optics.light import Band, Spectrum, Waveform
from optics.sensor import Mosaic
from simulator.effects.depths import DepthLayers, Occlusion
from simulator.effects.depths import _gain as depths_gain
from simulator.effects.pixel_effects import ColourFilters, PixelAperture
from simulator.effects.time_effects import LampFlicker, Motion, RollingShutter
from simulator.probing.picture_probe import electron_rates
from simulator.scene import Flat, Sheet, Sheets, Star
from simulator.scene.polygons import Polygons, rectangle

SHARP = np.zeros((ACROSS, ACROSS))
"""A panel that does nothing: a spot of six pixels in focus, which no bound counts on."""


def near(bound: float, measured: float, slack: float) -> None:
    assert measured * (1 - 1e-3) <= bound <= slack * measured


def thing(distance: float, pixels: float, middle: float = 0.0) -> Sheet:
    """An opaque white square, by its side and its place along x on the sensor."""
    each = PITCH * distance / LENS.image_distance
    shape = Polygons((rectangle((0.0, middle * each), (pixels * each, pixels * each)),), (1.0,))
    return Sheet(distance, ((None, shape),), shape)


def depths(distances, pixels: float):
    places = np.linspace(-8, 8, len(distances))
    things = (thing(float(d), pixels, x) for d, x in zip(distances, places, strict=True))
    return situation(Sheets(tuple(things), 1e7))


@pytest.mark.parametrize(("distances", "pixels", "slack"), [
    # |1 - H| is 2 at most, and about 1 of what is far out of focus; of light, and of what it hides.
    ((1.2, 6.0), 20, {0: 9}),
    # Between two depths PSFs differ by the square of the step; light of many cycles a blur only
    # by a first power is known to.
    (1 / np.linspace(1, 1 / 8, 9), 6, {0: 13, 1: 12, 2: 55, 3: 230}),
])  # fmt: skip
def test_depth_layers(distances, pixels, slack):
    s, effect = depths(distances, pixels), DepthLayers()
    exact = at_depths(s, SHARP, 33)
    for level, most in slack.items():
        found = at_depths(s, SHARP, int(effect.levels[level]))
        near(effect.error_bound(s, level).mean, np.linalg.norm(found - exact), most)
    bounds = [effect.error_bound(s, level).mean for level in range(effect.finest_level(s) + 1)]
    assert bounds == sorted(bounds, reverse=True)


def displaced(one: float, other: float) -> float:
    """By how much rays of two points on the axis, both through a corner of the panel, miss each
    other on the sensor: each goes straight to where the lens images its point."""
    corner = math.hypot(ACROSS, ACROSS) / 2 * camera().panel.pitch
    images = (1 / (1 / LENS.focal_length - 1 / d) for d in (one, other))
    first, second = (corner * (1 - LENS.image_distance / image) for image in images)
    return abs(first - second)


def test_depths_differ_by_what_the_panels_corners_send_elsewhere():
    """Two points of light in opposite corners make fringes: a depth turns them by 2π k ρ, and
    between two depths as the chord of that turn, instead of its arc."""
    k, wide = np.array([1.0, 10.0, 100.0]), replace(LENS, f_number=40.0)
    turn = 2 * np.pi * k * displaced(1.5, 2.4)
    gain = depths_gain(camera(), 1.5, [(2.4, 1.0)])
    np.testing.assert_allclose(gain(k), turn, rtol=1e-9)
    assert gain(np.array([1e9])) == 2
    # Half a turn of the defocus lies between both.
    middle = 2 / (1 / 1.5 + 1 / 2.4)
    between = depths_gain(camera(), middle, [(1.5, 0.5), (2.4, 0.5)])
    np.testing.assert_allclose(between(k), 1 - np.cos(turn / 2), rtol=1e-3)
    # A smaller stop leaves less of the panel.
    radius = LENS.focal_length / 40.0 / 2
    stopped = depths_gain(replace(camera(), lens=wide), 1.5, [(2.4, 1.0)])
    corner = math.hypot(ACROSS, ACROSS) / 2 * camera().panel.pitch
    assert radius < corner
    np.testing.assert_allclose(stopped(k), turn * radius / corner, rtol=1e-9)


@pytest.mark.parametrize(("things", "slack"), [
    # All of what is behind is hidden.
    ((thing(1.95, 40), thing(2.0, 6)), 3),
    # Half of it: light counts as far as PSFs of both reach.
    ((thing(1.95, 16, 10), thing(2.0, 24)), 4.5),
])  # fmt: skip
def test_occlusion(things, slack):
    spreads = [psf(one.distance, SHARP) for one in things]

    def reach(share):
        away = np.abs(np.arange(len(spreads[0])) - len(spreads[0]) // 2)
        square = np.maximum(away[:, None], away)
        beyond = [1 - np.cumsum(np.bincount(square.ravel(), one.ravel())) for one in spreads]
        return float(np.argmax(np.max(beyond, axis=0) <= share) + 1) * PITCH

    s = situation(Sheets(things, 1e7), reach=reach)
    seen, transparent = seen_and_transparent(s, spreads)
    near(Occlusion().error_bound(s, 0).mean, np.linalg.norm(transparent - seen), slack)


EXPOSURE, COUNT = 4e-3, 64
TIMES = (np.arange(COUNT) + 0.5) / COUNT * EXPOSURE


def smeared(s, weights, times):
    """Electrons of a star on its way, in focus: what each time weighs, and where it counts."""
    spread = psf(2.0, SHARP)
    parts = (w * frame(blurred(at(s, t), spread)) for w, t in zip(weights, times, strict=True))
    return sum(parts) * s.exposure / len(times)


def star(speed: float, lamp=None) -> Star:
    return Star(1e-3, 2.0, 1e8, velocity=(0.0, speed), lamp=lamp)


def test_motion_in_steady_light():
    """Of 21 pixels: 1 - sinc of any frequency along the path, as if all were along it."""
    s = situation(star(0.4), exposure=EXPOSURE)
    moved = smeared(s, np.ones(COUNT), TIMES) - smeared(s, [1.0], [EXPOSURE / 2])
    near(Motion().error_bound(s, 0).mean, np.linalg.norm(moved), 5)


@pytest.mark.parametrize(("level", "slack"), [(1, 32), (2, 34), (3, 38), (4, 45)])
def test_motion_in_parts_under_a_lamp(level, slack):
    """It's on in the first half of each part. Of a star's edge, light that is finer than the
    spot counts for most of the bound, and a spot in focus leaves little of it."""
    lamp = Waveform("square", 2**level / EXPOSURE, 1.0, 0.0, duty=0.5)
    s = situation(star(0.02, lamp), exposure=EXPOSURE)
    weights = lamp.at(TIMES)
    parts = np.repeat(weights.reshape(2**level, -1).mean(1), COUNT // 2**level)
    changed = smeared(s, weights - parts, TIMES)
    near(Motion().error_bound(s, level).mean, np.linalg.norm(changed), slack)


def test_a_path_takes_from_a_fringe_what_its_sinc_does():
    """Of its contrast, 1 - sinc(k path); under a lamp, whose halves weigh 2 and 0, half of the
    light counts a quarter of the path from where the other half would."""
    k, path = np.array([1.0, 30.0]), 1e-3
    lamp = Waveform("square", 1 / EXPOSURE, 1.0, 0.0, duty=0.5)
    steady, lit = (situation(star(0.02, one), exposure=EXPOSURE) for one in (None, lamp))
    smear = 1 - np.sinc(k * path)
    np.testing.assert_allclose(Motion()._gain(steady, path, 0)(k), smear, rtol=1e-2)
    halves = (np.exp(0.5j * np.pi * k * path * side) for side in (-1, 1))
    off = np.abs(np.subtract(*halves)) * np.sinc(k * path / 2) / 2
    for level in (0, 1):
        told = Motion()._gain(lit, path * 2**level, level)(k)
        told = told - (smear if level == 0 else 0)
        assert np.all(off <= told * 1.001)
        assert np.all(told <= 2.1 * off)


def test_motion_past_rows_that_are_exposed_in_turn():
    cam = camera(shutter="rolling", line_time=4e-5)
    s = situation(star(0.1), cam, exposure=EXPOSURE)
    starts, spread = 4e-5 * np.arange(SIDE), psf(2.0, SHARP)
    lasts, count = EXPOSURE + starts[-1], 64
    exact = np.zeros((SIDE, SIDE))
    for time in (np.arange(count) + 0.5) * lasts / count:
        rows = (starts <= time) & (time < starts + EXPOSURE)
        exact += frame(blurred(at(s, time), spread)) * rows[:, None] * lasts / count
    still = frame(blurred(at(s, EXPOSURE / 2), spread)) * EXPOSURE
    near(Motion().error_bound(s, 0).mean, np.linalg.norm(exact - still), 30)


def test_lamp_flicker_is_its_mean_over_the_exposure():
    lamp = Waveform("sine", 100.0, 0.3, 0.4)
    s = situation(Flat(2.0, 1e8, lamp=lamp), exposure=7.3e-3, moment=0.123)
    instants = 0.123 + (np.arange(20_000) + 0.5) / 20_000 * 7.3e-3
    light = np.linalg.norm(frame(s.picture_probe.sharp_picture.double().numpy())) * 7.3e-3
    near(LampFlicker().error_bound(s, 0).mean, abs(lamp.at(instants).mean() - 1) * light, 1.02)


def test_a_lamp_that_is_off_for_every_other_picture_of_a_video():
    """Twice one and none of the other, instead of both: two discs of the same light apart, which
    are less than the bound by √2, and by as much as they are blurred."""
    lamp = Waveform("square", 30.0, 1.0, 0.0, duty=0.5)
    s = situation(Star(1e-3, 2.0, 1e8, lamp=lamp), exposure=1 / 30, moves=True)
    tilt = np.linspace(-3.85, 3.85, ACROSS)
    pictures = [
        frame(blurred(s.picture_probe.lights[0], psf(2.0, side * tilt + SHARP))) for side in (-1, 1)
    ]
    change = np.linalg.norm(pictures[0] - pictures[1]) * s.exposure / 2
    near(LampFlicker().error_bound(s, 0).mean, change, 1.6 * math.sqrt(2))


BAND = Band(550e-9, 20e-9)


@pytest.mark.parametrize("length", [8, 16, 32, 96])
def test_pixels_that_average_a_fringe(length):
    """1 + cos: a fringe of as many pixels loses 1 - sinc(1 / length), half of the light's norm."""
    x = torch.arange(96, dtype=torch.float64)
    light = (1 + torch.cos(2 * math.pi * x / length)).expand(96, 96).clone()
    s = sensor_situations.situation(light, Sensor(shape=(96, 96)), 1.0, band=BAND)
    s.camera = replace(s.camera, lens=Lens(0.05, 11.0))
    fringe = math.sqrt(0.5) * 96 * (1 / np.sinc(1 / length) - 1)
    near(PixelAperture().error_bound(s, 0).mean, fringe, 1.3)


def test_filters_of_even_light():
    """The filter that differs most counts for all pixels."""
    curves = {
        "R": Spectrum((500e-9, 620e-9, 720e-9), (0.01, 0.4, 0.1)),
        "G": Spectrum((450e-9, 540e-9, 640e-9), (0.0, 0.5, 0.05)),
        "B": Spectrum((400e-9, 460e-9, 560e-9), (0.1, 0.4, 0.02)),
    }
    bayer = Sensor(shape=(12, 12), colour=Mosaic(("RG", "GB"), curves))
    part = SimpleNamespace(spectrum=Spectrum.flat(5.0))
    rates = np.array(electron_rates(part.spectrum, BAND, Camera(sensor=bayer), 2.0))
    even = torch.full((12, 12), float(rates.max())).double()
    s = sensor_situations.situation(even, bayer, 1.0, band=BAND)
    layer = SimpleNamespace(distance=2.0, parts=(part,), cover=None)
    s.target = SimpleNamespace(speckle=None, lamp=None, is_moving=False, layers=(layer,))
    channels = bayer.colour.channel_map((12, 12)).numpy()
    apart = rates[channels] - rates @ np.array([0.25, 0.5, 0.25])
    near(ColourFilters().error_bound(s, 0).mean, np.linalg.norm(apart), 2.5)


def rolling(exposure: float, lamp=None, moves=False):
    one = Sensor(shape=(40, 12), shutter="rolling", line_time=50e-6, dark_current=0.0)
    s = sensor_situations.situation(torch.full((40, 12), 100.0), one, exposure)
    s.target = SimpleNamespace(speckle=None, lamp=lamp, is_moving=moves, layers=())
    return s


def test_rows_that_see_a_lamp_rise():
    """A fifth of its period: the last row differs most, and counts for all."""
    s = rolling(0.3e-3, Waveform("sine", 100.0, 0.4))
    starts = 50e-6 * np.arange(40)
    rise = 0.4 * np.cos(2 * math.pi * 100 * np.stack([starts, starts + 0.3e-3])) / (200 * math.pi)
    rows = 100 * (rise[0] - rise[1])
    near(RollingShutter().error_bound(s, 0).mean, np.linalg.norm(np.repeat(rows - rows[0], 12)), 3)


def test_rows_that_share_half_of_their_time():
    """Something shines in the first row's time alone, twice as bright: what later rows don't see
    of it, and as much that they alone might see instead, in all rows as in the last."""
    s = rolling(4e-3, moves=True)
    missed = 50e-6 * np.arange(40) / 4e-3
    rows = 100.0 * 4e-3 * np.minimum(missed, 1.0)
    near(RollingShutter().error_bound(s, 0).mean, np.linalg.norm(np.repeat(rows, 12)), 4)
