"""Axial colour against lenses that are out of focus, and its spectrum by a sum."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from optical_situations import CAMERA, STAR, finest, rendered, situation

from optics.caching import ByteCache
from optics.camera import Camera, Lens
from optics.camera.pupil import pupil_phase
from optics.light import Band
from simulator.effects.band_effects import Bandwidth
from simulator.effects.lens_effects import AxialColour
from simulator.effects.picture_norms import minimum_norms
from simulator.focus import focus_range, focus_shifts
from simulator.imaging import Imaging
from simulator.mount import Mount
from simulator.scene import Flat
from simulator.situation import Situation

CURVE = ((400e-9, 3.5e-3), (450e-9, 3e-3), (550e-9, 0.0), (650e-9, 4e-3), (720e-9, 4.5e-3))
"""An achromat's, of a strong secondary spectrum."""

FAST = replace(CAMERA, lens=Lens(0.05, 40.0, 1.0, axial_colour=CURVE))
BANDS = [Band(460e-9, 1e-9), Band(620e-9, 1e-9)]
WIDE = Band(530e-9, 60e-9)


def seen(camera: Camera = FAST, band: Band = WIDE, **more) -> Situation:
    return situation(STAR, camera, band, **more)


def picture(s: Situation, **levels: int) -> np.ndarray:
    named = {name.replace("_", " "): level for name, level in levels.items()}
    return rendered(s, finest(s) | {"panel orders": 0} | named, ByteCache())


@cache
def whole_band() -> np.ndarray:
    return picture(seen())


def with_defocus_for(camera: Camera, wavelength: float) -> Camera:
    """A lens that isn't sharp by so much path at its edge: half of 1/z - 1/z' times r²."""
    lens = camera.lens
    behind = lens.image_distance + np.interp(wavelength, *np.array(CURVE).T)
    edge = (1 / lens.image_distance - 1 / behind) * (lens.stop_diameter / 2) ** 2 / 2
    # The Zernike polynomial √3 (2 ρ² - 1) goes from -√3 to √3.
    path = ((2, 0, edge / (2 * math.sqrt(3))),)
    return replace(camera, lens=replace(lens, axial_colour=(), aberrations=path))


@pytest.mark.parametrize("band", BANDS, ids=str)
@pytest.mark.parametrize("diffraction", [0, 1])
def test_each_wavelength_is_seen_by_a_lens_that_is_out_of_focus(band, diffraction):
    wanted = picture(seen(with_defocus_for(FAST, band.centre), band), diffraction=diffraction)
    found = picture(seen(FAST, band), diffraction=diffraction)
    sharp = picture(seen(FAST, band), diffraction=diffraction, axial_colour=0)
    assert np.linalg.norm(sharp - wanted) > 0.1 * np.linalg.norm(wanted)
    assert np.linalg.norm(found - wanted) <= 0.01 * np.linalg.norm(wanted)


def test_a_panel_that_is_shifted_and_turned_sees_the_same_lens():
    band, mount = BANDS[0], Mount(math.pi / 2, shift=(1e-4, -2e-4))
    wanted = picture(seen(with_defocus_for(FAST, band.centre), band, mount=mount))
    found = picture(seen(FAST, band, mount=mount))
    sharp = picture(seen(FAST, band, mount=mount), axial_colour=0)
    assert np.linalg.norm(sharp - wanted) > 0.1 * np.linalg.norm(wanted)
    assert np.linalg.norm(found - wanted) <= 0.01 * np.linalg.norm(wanted)


def test_a_lens_that_would_be_sharp_beyond_infinity_is_out_of_focus_as_much():
    near = Lens(0.05, 40.0, 1.0).defocused(1e-3)
    assert near.aberrations == ()
    assert near.image_distance == pytest.approx(Lens(0.05, 40.0, 1.0).image_distance)
    far = Lens(0.05, 40.0, 50.0).defocused(2e-3)
    assert far.aberrations
    edge = float(pupil_phase(far, math.inf, 500e-9, torch.tensor(0.0), torch.tensor(1.0)))
    middle = float(pupil_phase(far, math.inf, 500e-9, torch.tensor(0.0), torch.tensor(0.0)))
    z = far.image_distance
    path = (1 / z - 1 / (z + 2e-3) - 1 / 50.0) * (far.stop_diameter / 2) ** 2 / 2
    assert edge - middle == pytest.approx(2 * math.pi / 500e-9 * path, rel=1e-6)


def test_a_band_is_the_sum_of_its_wavelengths():
    """By the midpoint rule over many narrow bands, each with as much light as the wide one has."""
    low, high = WIDE.support
    middles = low + (high - low) * (np.arange(10) + 0.5) / 10
    narrow = [Band(float(one), 0.1e-9) for one in middles]
    shares = WIDE.transmission(middles) * middles
    wanted = 0.0
    for band, share in zip(narrow, shares / shares.sum(), strict=True):
        if share > 1e-5:
            light = picture(seen(band=band), filter_bandwidth=0)
            wanted = wanted + share * light / light.sum()
    found = whole_band()
    assert found / found.sum() == pytest.approx(wanted / wanted.sum(), abs=2e-3 * wanted.max())


@pytest.mark.parametrize("level", [0, 2])
def test_few_wavelengths_err_within_their_bound(level):
    s = seen()
    whole, few = whole_band(), picture(s, filter_bandwidth=level)
    bound = Bandwidth().error_bound(s, level).mean
    assert np.linalg.norm(few - whole) <= bound


@pytest.mark.parametrize("strength", [0.02, 1.0])
@pytest.mark.parametrize(
    "band",
    [BANDS[0], WIDE, pytest.param(replace(WIDE, leak=3e-3), marks=pytest.mark.sweep)],
    ids=str,
)
def test_no_more_changes_than_the_bound_and_no_less_is_left(strength, band):
    curve = tuple((one, strength * shift) for one, shift in CURVE)
    s = seen(replace(FAST, lens=replace(FAST.lens, axial_colour=curve)), band)
    found, sharp = picture(s), picture(s, axial_colour=0)
    assert np.linalg.norm(found - sharp) <= AxialColour().error_bound(s, 0).mean
    assert minimum_norms(s).mean <= np.linalg.norm(found)


def test_a_plan_takes_what_is_seen_and_nothing_else():
    assert not AxialColour().is_present(situation())
    assert Imaging(1e-2).plan(seen()).recipe.axial_colour
    weak = replace(FAST.lens, axial_colour=((450e-9, 1e-8), (650e-9, -1e-8)))
    plan = Imaging(1e-2).plan(seen(replace(FAST, lens=weak)))
    assert not plan.recipe.axial_colour
    even = situation(Flat(1.0, 1e7), FAST, WIDE)
    assert not Imaging(1e-2).plan(even).recipe.axial_colour


def test_points_are_probed_sharp_where_colour_makes_them_sharp():
    lens = FAST.lens
    away = 1 / (1 / lens.focal_length - 1 / (lens.image_distance - 1e-3))
    found = focus_shifts(lens, Band(500e-9, 30e-9), [away])
    assert any(one == pytest.approx(1e-3) for one in found)
    assert 0.0 in found


def test_a_curve_is_straight_between_its_pairs_and_beyond():
    lens = Lens(0.05, 40.0, 1.0, axial_colour=((450e-9, 2e-3), (550e-9, 0.0), (650e-9, 1.5e-3)))
    found = [lens.focus_shift(one * 1e-9) for one in (500, 400, 750)]
    assert found == pytest.approx([1e-3, 3e-3, 3e-3])
    assert focus_range(lens, 500e-9, 600e-9) == pytest.approx((0, 1e-3))
    assert Lens().focus_shift(500e-9) == 0


@pytest.mark.parametrize(
    ("curve", "words"),
    [
        (((550e-9, 1e-4),), "two pairs or more"),
        (((550e-9, 1e-4), (500e-9, 0.0)), "500 nm after 550 nm; wavelengths rise"),
        (((550.0, 1e-4), (650.0, 0.0)), "did you mean 550 nm"),
        (((500e-9, math.nan), (600e-9, 0.0)), "axial_colour is nan m at 500 nm"),
        (((500e-9, 0.02), (600e-9, 0.0)), r"axial_colour is 0.02 m .* between -0.005"),
    ],
)
def test_what_cannot_be_is_refused(curve, words):
    with pytest.raises(ValueError, match=words):
        Lens(0.05, 40.0, 1.0, axial_colour=curve)


def test_a_curve_that_goes_on_too_far_is_refused():
    lens = Lens(0.05, 40.0, 1.0, axial_colour=((500e-9, 0.0), (510e-9, 1e-3)))
    with pytest.raises(ValueError, match=r"at 700 nm, .* give its curve up to that"):
        lens.focus_shift(700e-9)


def test_a_band_in_which_all_foci_are_nearly_the_sensors_has_one():
    """Both ends were within rounding of it, and on one side."""
    lens = replace(CAMERA.lens, axial_colour=((400e-9, 1e-12), (700e-9, 2e-12)))
    assert focus_shifts(lens, Band(550e-9, 1e-9), (1.0,)) == (0.0,)
