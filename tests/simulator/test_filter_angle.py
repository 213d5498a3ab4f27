"""The filter's band off the axis, against filters that are tuned to what it is there."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, STAR, rendered, situation
from scipy.integrate import quad

from optics.caching import ByteCache
from optics.camera import Lens
from optics.light import Band, Spectrum
from simulator.effects.filter_angle import FilterAngle
from simulator.effects.picture_norms import minimum_norms
from simulator.imaging import Imaging
from simulator.scene import Flat, PhotographPrint

WIDE = replace(
    CAMERA,
    panel=replace(CAMERA.panel, shape=(96, 128), pitch=10e-6, fill_factor=1.0),
    lens=Lens(0.012, 20.0, 1.0),
    sensor=replace(CAMERA.sensor, pitch=100e-6, shape=(30, 36)),
)
"""11 degrees in the corner."""

FILM = Band(550e-9, 4e-9, effective_index=1.6)
LAMP = Spectrum((400e-9, 545e-9, 555e-9, 700e-9), (0.1, 0.1, 1.0, 1.0))
"""A steep edge within the band."""

LEVELS = {"diffraction": 1, "light sampling": 2, "PSF reach": 1, "pixel aperture": 1}
EFFECT = FilterAngle()


def squared_sine(y: float, x: float) -> float:
    tangent = math.hypot(y, x) / WIDE.lens.image_distance
    return math.sin(math.atan(tangent)) ** 2


def star(y: float, x: float):
    """With its image at so many metres on the sensor."""
    scale = WIDE.magnification(1.0)
    return replace(STAR, offset=(y / scale, x / scale), diameter=3e-3, radiance=1e9, light=LAMP)


def seen(target, band: Band, angles: int = 0, **more) -> np.ndarray:
    s = situation(target, WIDE, band)
    levels = LEVELS | {"filter bandwidth": 3, "filter angle": angles} | more
    return rendered(s, levels, ByteCache())


def printed(cover: float = 1.3) -> PhotographPrint:
    image = np.random.default_rng(5).random((30, 36, 3)).astype(np.float32)
    return PhotographPrint(torch.from_numpy(image), 1.0, 1e8, cover=cover)


def test_a_band_is_scaled_by_the_cosine_within_the_films():
    """By Snell's law, which Macleod's formula contains."""
    angle = math.radians(25)
    within = math.asin(math.sin(angle) / 1.6)
    tilted = FILM.at_angle(math.sin(angle) ** 2)
    assert tilted.centre == pytest.approx(550e-9 * math.cos(within))
    waves = np.linspace(500e-9, 560e-9, 50)
    assert tilted.transmission(waves) == pytest.approx(FILM.transmission(waves / math.cos(within)))
    table = Spectrum((540e-9, 550e-9, 565e-9), (0.0, 1.0, 0.0))
    measured = replace(Band.from_table(table), effective_index=1.6).at_angle(0.1)
    assert measured.support == pytest.approx(
        [math.sqrt(1 - 0.1 / 1.6**2) * one for one in (540e-9, 565e-9)]
    )
    assert not tilted.shifts_with_angle


@pytest.mark.parametrize("place", [(1.2e-3, 1.5e-3), (0.7e-3, -0.4e-3), (0.0, 1e-4)])
def test_a_star_off_the_axis_is_as_behind_a_filter_that_is_tuned_lower(place):
    tuned = FILM.at_angle(squared_sine(*place))
    wanted, found = seen(star(*place), tuned), seen(star(*place), FILM, 3)
    assert np.linalg.norm(found - wanted) <= 2e-3 * np.linalg.norm(wanted)
    if place[0] > 1e-3:
        still = seen(star(*place), FILM)
        assert np.linalg.norm(still - wanted) > 0.1 * np.linalg.norm(wanted)


def test_even_light_has_the_photons_that_pass_at_each_angle():
    even = Flat(1.0, 1e7, light=LAMP)
    lit, bare = seen(even, FILM, 4), seen(even, FILM)
    rows, columns = WIDE.sensor.shape

    def passed(within: float) -> float:
        def photons(wave: float) -> float:
            offset = 2 * (wave / within - 550e-9) / 4e-9
            sent = np.interp(wave, LAMP.wavelengths, LAMP.values)
            return float(sent) * wave * 0.5 ** (offset**2)

        return quad(photons, 530e-9, 565e-9, points=[545e-9, 555e-9], limit=200)[0]

    for i, j in ((0, 0), (3, 30), (15, 18), (20, 5)):
        place = (i - rows // 2) * 100e-6, (j - columns // 2) * 100e-6
        within = math.sqrt(1 - squared_sine(*place) / 1.6**2)
        wanted = passed(within) / passed(1.0)
        # What even light lacks is blurred, and some of it goes to the panel's orders.
        assert lit[i, j] / bare[i, j] == pytest.approx(wanted, abs=2e-3 + 0.03 * (1 - wanted))


@pytest.mark.parametrize(
    "target",
    [
        star(1.2e-3, 1.5e-3),
        Flat(1.0, 1e7, light=LAMP),
        pytest.param(printed(), marks=pytest.mark.sweep),
        pytest.param(replace(printed(), light=LAMP), marks=pytest.mark.sweep),
    ],
    ids=("star", "even light", "print", "print in steep light"),
)
def test_no_more_changes_than_the_bound_and_no_less_is_left(target):
    s = situation(target, WIDE, FILM)
    top = EFFECT.finest_level(s)
    pictures = [seen(target, FILM, level) for level in range(top + 1)]
    assert top > 0
    for level, one in enumerate(pictures):
        assert np.linalg.norm(one - pictures[-1]) <= EFFECT.error_bound(s, level).mean + 1e-9
    assert minimum_norms(s).mean <= np.linalg.norm(pictures[-1])


@pytest.mark.parametrize("level", [1, 2])
def test_a_stars_light_in_the_panels_orders_has_its_angle_too(level):
    """On cells, and by PSFs."""
    place = (1.2e-3, 1.5e-3)
    gaps = replace(WIDE, panel=replace(WIDE.panel, fill_factor=0.7))
    levels = LEVELS | {"filter bandwidth": 3, "panel orders": level}
    tuned = situation(star(*place), gaps, FILM.at_angle(squared_sine(*place)))
    wanted = rendered(tuned, levels, ByteCache())
    found = rendered(situation(star(*place), gaps, FILM), levels | {"filter angle": 3}, ByteCache())
    bare = rendered(tuned, levels | {"panel orders": 0}, ByteCache())
    assert np.linalg.norm(wanted - bare) > 0.02 * np.linalg.norm(wanted)
    assert np.linalg.norm(found - wanted) <= 2e-3 * np.linalg.norm(wanted)


def test_a_filter_that_does_not_shift_knows_nothing_of_angles():
    assert not EFFECT.is_present(situation())
    assert not EFFECT.is_present(situation(Flat(1.0, 0.0), band=FILM))
    assert EFFECT.is_present(situation(band=FILM))
    plain = Imaging(1e-3).plan(situation())
    assert plain.recipe.angles == 1


def test_a_large_index_shifts_so_little_that_plans_leave_it_out():
    s = situation(band=Band(550e-9, 20e-9, effective_index=2.0))
    assert Imaging(1e-3).plan(s).level("filter angle") == 0


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"effective_index": 0.9}, r"effective_index is 0\.9; thin films have 1 or more"),
        ({"effective_index": math.nan}, "effective_index is nan"),
        ({"effective_index": 2.0, "shape": "lyot"}, "a lyot filter has no thin films"),
    ],
)
def test_an_index_that_cannot_be_is_refused(data, words):
    with pytest.raises(ValueError, match=words):
        Band(550e-9, 10e-9, **data)


@pytest.mark.parametrize("squared", [-0.1, 1.1, math.nan])
def test_a_sine_that_cannot_be_is_refused(squared):
    with pytest.raises(ValueError, match="squared_sine"):
        FILM.at_angle(squared)
