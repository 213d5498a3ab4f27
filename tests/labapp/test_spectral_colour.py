"""Colours of spectral cubes, against the library's own integrals and closed forms; their scores."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from labapp.common.errors import UserError
from labapp.files.cubes import SpectralCube
from labapp.spectral.colour import (
    colour_difference,
    cube_to_lab,
    cube_to_linear_srgb,
    cube_to_xyz,
    describe_interpolation,
    xyz_matrix,
)
from labapp.spectral.lights import ViewingLight, find_light
from labapp.spectral.scores import score_cube
from labapp.spectral.typical_spectra import typical_reflectances
from optics.light import Spectrum

SIX = tuple(np.arange(450, 701, 50) / 1e9)
THIRTY_ONE = tuple(np.arange(400, 701, 10) / 1e9)

WHITES = {"D65": (0.9505, 1.0, 1.0891), "A": (1.0985, 1.0, 0.3558), "E": (1.0, 1.0, 1.0)}
"""X, Y and Z of the illuminants for the observer of 1931, from ASTM E308 and CIE 15."""


@pytest.fixture(scope="module", autouse=True)
def library():
    """What the library warns of when it is imported is no failure of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour.quality
    return colour


def grey(level, bands=SIX, pixels=12):
    return SpectralCube(np.full((len(bands), pixels, pixels), level), bands)


@pytest.mark.parametrize("bands", [SIX, THIRTY_ONE, (450e-9, 520e-9, 610e-9), (550e-9,)])
@pytest.mark.parametrize("name", WHITES)
def test_white_is_the_white_of_the_light(bands, name):
    light = find_light(name)
    assert cube_to_xyz(grey(1.0, bands), light)[0, 0] == pytest.approx(WHITES[name], abs=6e-4)
    assert cube_to_lab(grey(1.0, bands), light)[0, 0] == pytest.approx([100, 0, 0], abs=1e-6)
    assert cube_to_linear_srgb(grey(1.0, bands), light)[0, 0] == pytest.approx(1, abs=1e-3)
    assert cube_to_linear_srgb(grey(0.25, bands), light)[3, 4] == pytest.approx(0.25, abs=1e-3)


@pytest.mark.parametrize("name", ["D65", "A"])
@pytest.mark.parametrize(("bands", "mean", "most"), [(THIRTY_ONE, 0.05, 0.2), (SIX, 1.4, 4.5)])
def test_colours_of_a_chart_are_those_of_its_whole_spectra(library, name, bands, mean, most):
    """The library integrates the whole spectra by itself, in steps of 1 nm."""
    patches = library.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    shape = library.SpectralShape(380, 780, 1)
    light = library.SDS_ILLUMINANTS[name].copy().align(shape)
    observer = library.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = np.array(
            [library.sd_to_XYZ(one.copy().align(shape), observer, light) for one in patches]
        )
        white = library.sd_to_XYZ(library.sd_ones(shape), observer, light)
    nm = 1e9 * np.array(bands)
    values = np.array([np.interp(nm, one.wavelengths, one.values) for one in patches]).T
    seen = cube_to_lab(SpectralCube(values[:, None], bands), find_light(name))[0]
    known = library.XYZ_to_Lab(whole / 100, library.XYZ_to_xy(white))
    apart = library.delta_E(seen, known, method="CIE 2000")
    assert apart.mean() < mean
    assert apart.max() < most


def test_interpolation_is_said():
    assert "Sprague" in describe_interpolation(SIX)
    assert "straight" in describe_interpolation(SIX[:5])
    assert "straight" in describe_interpolation((*SIX[:5], 710e-9))


def test_colour_difference_of_greys_follows_their_lightness():
    """By hand, for two greys: CIEDE2000 = ΔL / (1 + 0.015 (L - 50)² / √(20 + (L - 50)²))."""
    first, second = 0.4, 0.5
    l1, l2 = (116 * level ** (1 / 3) - 16 for level in (first, second))
    middle = ((l1 + l2) / 2 - 50) ** 2
    wanted = (l2 - l1) / (1 + 0.015 * middle / math.sqrt(20 + middle))
    found = colour_difference(grey(first), grey(second), find_light("D65"))
    assert found == pytest.approx(np.full((12, 12), wanted), abs=1e-4)


def test_a_light_of_a_file_is_as_good_as_a_named_one(tmp_path):
    path = tmp_path / "lamp.csv"
    path.write_text("nm,power\n380,1\n780,1\n")
    assert find_light(str(path)).name == "lamp"
    made = xyz_matrix(SIX, find_light(str(path)).spectrum)
    assert made == pytest.approx(xyz_matrix(SIX, find_light("E").spectrum), abs=1e-6)


def test_lights_and_bands_without_colour_are_refused_in_words(tmp_path):
    with pytest.raises(UserError, match=r"--light D56: is neither.*Did you mean 'D"):
        find_light("D56")
    with pytest.raises(UserError, match="are invisible"):
        xyz_matrix((900e-9, 950e-9), find_light("D65").spectrum)
    infrared = ViewingLight("infrared", Spectrum((850e-9, 900e-9), (1.0, 1.0)))
    with pytest.raises(UserError, match="light is dark"):
        cube_to_xyz(grey(1.0), infrared)


def test_typical_reflectances_are_the_samples_of_the_standard(library):
    found = typical_reflectances(SIX)
    assert found.shape == (99, 6)
    assert found.min() >= 0
    assert found.max() <= 1
    samples = library.quality.cfi2017.load_TCS_CIE2017(library.SpectralShape(380, 780, 5))
    at = list(samples.wavelengths).index(550)
    assert found[:, 2] == pytest.approx(samples.values[at])
    with pytest.raises(UserError, match="450, 800 nm: typical reflectances are known from 380 to"):
        typical_reflectances((450e-9, 800e-9))


def test_scores_of_a_cube_are_those_of_its_bands():
    """By hand: an error of 0.1 in one band, 0.01 in the other five; angles by their cosine."""
    truth = grey(0.5)
    values = truth.values + 0.01
    values[0] += 0.09
    found = score_cube(SpectralCube(values, SIX), truth, find_light("D65"))
    assert found.bands[0].psnr == pytest.approx(20, abs=1e-4)
    assert found.bands[1].psnr == pytest.approx(40, abs=1e-3)
    assert found.psnr == pytest.approx((20 + 5 * 40) / 6, abs=1e-3)
    cosine = (0.6 + 5 * 0.51) / math.sqrt(6) / math.sqrt(0.6**2 + 5 * 0.51**2)
    assert found.angle == pytest.approx(math.degrees(math.acos(cosine)), rel=1e-4)
    assert found.difference == pytest.approx(found.largest_difference)
    said = found.as_data
    assert said["peak"] == 1
    assert said["crop"] == "full frame"
    assert said["light"] == "D65"
    assert len(said["bands"]) == 6


def test_equal_cubes_have_no_error_and_dark_ones_no_angle():
    same = score_cube(grey(0.5), grey(0.5), find_light("A"))
    assert math.isinf(same.psnr)
    assert same.as_data["psnr_db"] is None
    assert same.ssim == pytest.approx(1)
    assert same.difference == pytest.approx(0, abs=1e-6)
    dark = score_cube(grey(0.01), grey(0.02), find_light("A"))
    assert math.isnan(dark.angle)
    assert dark.as_data["spectral_angle_deg"] is None


@pytest.mark.parametrize(
    ("truth", "words"),
    [
        (grey(0.5, pixels=13), r"is 6 x 13 x 13 \(bands, rows, columns\); it must be 6 x 12 x 12"),
        (grey(0.5, tuple(one + 5e-9 for one in SIX)), "bands at 455, 505"),
        (SpectralCube(grey(0.5).values, SIX, "volts"), "in 'volts'"),
    ],
)
def test_cubes_of_another_kind_arent_compared(truth, words):
    with pytest.raises(UserError, match=words):
        score_cube(grey(0.5), truth, find_light("D65"))
