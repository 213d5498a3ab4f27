"""Measures for focusing and aligning, on pictures for which they are known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from optics.camera import Sensor
from optics.light.spectrum import Spectrum
from optics.measuring import (
    Region,
    exposure_for_level,
    focus_score,
    line_profile,
    peak_level,
    region_statistics,
    star_shape,
)
from optics.sensor import Mosaic

SENSOR = Sensor(
    shape=(64, 64), bits=16, full_well=40000.0, black_level=64.0, gain=0.5, read_noise=2.0
)
TO_FWHM = 2 * math.sqrt(2 * math.log(2))


def gaussian(sigmas, place, *, angle=0.0, amplitude=20000.0, size=64):
    """A Gaussian on the black level. sigmas: long axis, short axis; angle: of the long one."""
    y, x = np.indices((size, size))
    dy, dx = y - place[0], x - place[1]
    along = dx * math.cos(angle) + dy * math.sin(angle)
    beside = dy * math.cos(angle) - dx * math.sin(angle)
    return 64 + amplitude * np.exp(-((along / sigmas[0]) ** 2 + (beside / sigmas[1]) ** 2) / 2)


def exposed(light, seed=0):
    """With shot noise and read noise of SENSOR, rounded and clipped as by its converter."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson((light - 64) * SENSOR.gain) + rng.normal(0, 2.0, light.shape)
    numbers = np.rint(electrons / SENSOR.gain + 64)
    return np.clip(numbers, 0, SENSOR.full_scale).astype(np.uint16)


@pytest.mark.parametrize(
    ("sigmas", "angle"),
    [
        ((0.5, 0.5), 0.0),
        ((1.0, 0.5), 0.1),
        ((1.0, 1.0), 0.0),
        ((3.0, 1.5), 0.4),
        ((6.0, 4.0), -1.2),
    ],
)
def test_a_gaussian_star_has_its_own_widths(sigmas, angle):
    found = star_shape(exposed(gaussian(sigmas, (30.3, 33.6), angle=angle)), SENSOR)
    assert (found.y, found.x) == pytest.approx((30.3, 33.6), abs=0.02)
    assert found.fwhm_major == pytest.approx(TO_FWHM * sigmas[0], rel=0.02)
    assert found.fwhm_minor == pytest.approx(TO_FWHM * sigmas[1], rel=0.02)
    assert found.background == pytest.approx(64, abs=2)
    if sigmas[0] > sigmas[1]:
        assert found.angle == pytest.approx(angle, abs=0.01)


def test_pixels_add_their_own_variance():
    """Integrals of the Gaussian over the pixels, by the error function."""
    sigma, edges = 1.2, np.arange(65) - 0.5
    row = np.diff(erf((edges - 31.7) / (sigma * math.sqrt(2)))) / 2
    found = star_shape(64 + 1e5 * np.outer(row, row), SENSOR)
    assert found.fwhm == pytest.approx(TO_FWHM * math.sqrt(sigma**2 + 1 / 12), rel=5e-3)


def test_a_disc_of_defocus_has_the_width_that_its_fixed_point_gives():
    """Of a uniform disc, w = R²/2σ² solves exp(w) = 1 + 2w, where the window matches the star."""
    radius = 15.0
    y, x = np.indices((96, 96))
    share = np.clip(radius + 0.5 - np.hypot(y - 47.5, x - 48.2), 0, 1)
    w = brentq(lambda w: math.exp(w) - 1 - 2 * w, 0.5, 3)
    found = star_shape(64 + 5000 * share, SENSOR)
    assert found.fwhm == pytest.approx(TO_FWHM * radius / math.sqrt(2 * w), rel=0.01)
    assert (found.y, found.x) == pytest.approx((47.5, 48.2), abs=0.05)


def test_hot_pixels_are_no_stars():
    numbers = exposed(gaussian((2.0, 2.0), (30, 30), amplitude=3000))
    numbers[10, 50] = 40000
    found = star_shape(numbers, SENSOR)
    assert (found.y, found.x) == pytest.approx((30, 30), abs=0.05)
    assert found.peak == pytest.approx(3000, rel=0.1)
    assert peak_level(numbers, SENSOR).level == pytest.approx(3000 / (65535 - 64), rel=0.1)


def test_colour_filters_do_not_change_place_or_width():
    """A star of one colour: three of four pixels see none of it."""
    flat = Spectrum.flat(0.5)
    colour = Mosaic(("RG", "GB"), {"R": flat, "G": flat, "B": flat})
    light = gaussian((3.0, 2.0), (30.3, 33.6))
    seen = np.full_like(light, 64.0)
    seen[::2, ::2] = light[::2, ::2]
    found = star_shape(exposed(seen), replace(SENSOR, colour=colour))
    assert (found.y, found.x) == pytest.approx((30.3, 33.6), abs=0.1)
    assert found.fwhm_major == pytest.approx(TO_FWHM * 3.0, rel=0.03)
    assert found.fwhm_minor == pytest.approx(TO_FWHM * 2.0, rel=0.03)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        (np.zeros((7, 40)), "8 x 8 at least"),
        (exposed(np.full((64, 64), 100.0)), "no spot stands out"),
        (gaussian((30.0, 30.0), (32, 32)), "wider than a region"),
    ],
)
def test_no_star_is_said_to_be_none(numbers, words):
    with pytest.raises(ValueError, match=words):
        star_shape(numbers, SENSOR)


@pytest.mark.parametrize("k", [0.2, 0.7])
@pytest.mark.parametrize("exposure", [1, 8])
def test_the_score_of_a_cosine_is_that_of_its_formula(k, exposure):
    """m² sin²(k) / 2, whatever the exposure, and whatever noise it is under."""
    across = np.cos(2 * math.pi * round(256 * k / (2 * math.pi)) / 256 * np.arange(256))
    k = 2 * math.pi * round(256 * k / (2 * math.pi)) / 256
    light = 64 + exposure * 800 * (1 + 0.3 * np.tile(across, (256, 1)))
    found = focus_score(exposed(light), SENSOR)
    assert found == pytest.approx(0.3**2 * math.sin(k) ** 2 / 2, rel=0.02)


def test_the_score_of_a_star_falls_with_the_fourth_power_of_its_width():
    """A / 4πσ⁴ for a Gaussian in A pixels, where it is wide enough for central differences."""
    for sigma in (4.0, 6.0):
        found = focus_score(gaussian((sigma, sigma), (32, 32)), replace(SENSOR, read_noise=0.0))
        # Pixels have no noise here, and the shot noise that is subtracted is below 1e-3 of it.
        assert found == pytest.approx(64**2 / (4 * math.pi * sigma**4), rel=0.08)


def test_noise_alone_has_no_score():
    found = focus_score(exposed(np.full((256, 256), 1064.0)), SENSOR)
    # The pixels' relative variance is 2.1e-3: without the correction this would be the score.
    assert abs(found) < 5e-5


@pytest.mark.parametrize(
    ("numbers", "words"),
    [(np.zeros((2, 9)), "3 x 3 at least"), (exposed(np.full((64, 64), 64.0)), "too dark to judge")],
)
def test_a_score_is_refused_where_there_is_none(numbers, words):
    with pytest.raises(ValueError, match=words):
        focus_score(numbers, SENSOR)


def test_a_profile_is_bilinear_on_any_line():
    """On a + b y + c x + d y x, bilinear interpolation is exact."""

    def plane(y, x):
        return 5 + 2 * y + 3 * x + 0.5 * y * x

    numbers = plane(*np.indices((20, 30)))
    found = line_profile(numbers, (1.25, 2.5), (17.5, 28.75))
    length = math.hypot(16.25, 26.25)
    assert found.distances[[0, -1]] == pytest.approx([0, length])
    assert len(found.values) == math.ceil(length) + 1
    share = found.distances / length
    assert found.values == pytest.approx(plane(1.25 + 16.25 * share, 2.5 + 26.25 * share))
    still = line_profile(numbers.astype(np.uint16), (3, 4), (3, 4))
    assert still.values == pytest.approx([5 + 6 + 12 + 6])


def test_a_profile_ends_within_the_picture():
    with pytest.raises(ValueError, match=r"end is row 20, column 0; the picture has 20 x 30"):
        line_profile(np.zeros((20, 30)), (0, 0), (20, 0))


def test_a_region_is_counted_on_all_of_its_pixels():
    numbers = np.zeros((10, 12), dtype=np.uint16)
    numbers[2:4, 3:6] = [[100, 200, 4095], [300, 0, 4095]]
    found = region_statistics(numbers, Region(2, 3, 2, 3), 4095)
    seen = np.array([100, 200, 4095, 300, 0, 4095.0])
    assert (found.pixels, found.saturated, found.at_zero) == (6, 2, 1)
    assert (found.lowest, found.highest) == (0, 4095)
    assert found.mean == pytest.approx(seen.mean())
    assert found.deviation == pytest.approx(seen.std())
    # Of a region at the rim, the part within the picture counts.
    assert region_statistics(numbers, Region(8, 10, 9, 9), 4095).pixels == 4


def test_regions_stay_in_the_picture():
    with pytest.raises(ValueError, match="outside the picture of 40 x 50"):
        Region(40, 0, 3, 3).within((40, 50))
    with pytest.raises(ValueError, match="give 1 at least"):
        Region(0, 0, 0, 3)


def test_an_exposure_brings_the_light_to_its_level():
    sensor = replace(SENSOR, bits=12, gain=2.0, dark_current=10.0)
    time = exposure_for_level(0.6, 990.0, sensor)
    # (4095 - 64) DN of 2 electrons; light and dark current are 1000 electrons a second.
    assert time == pytest.approx(0.6 * 4031 * 2 / 1000)
    with pytest.raises(ValueError, match="above 0 and below 1"):
        exposure_for_level(1.0, 990.0, sensor)
    with pytest.raises(ValueError, match="must be positive"):
        exposure_for_level(0.5, 0.0, sensor)
