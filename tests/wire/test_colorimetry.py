"""Colour values of spectra, against values that the CIE has published."""

import numpy as np
import pytest

from simulator.machines.colorimetry import (
    chromaticity,
    colour_matching_functions,
    colour_temperature,
    dominant_wavelength,
    tristimulus,
    uniform_chromaticity,
)

NM = np.arange(380, 781)
WAVELENGTHS = NM * 1e-9


def planck(kelvins, c2=1.4388e-2):
    return WAVELENGTHS**-5 / (np.exp(c2 / (WAVELENGTHS * kelvins)) - 1)


def laser(nm, width=2.0):
    return np.exp(-0.5 * ((NM - nm) / width) ** 2)


# CIE 018:2019, table of the 1931 observer at a few wavelengths.
@pytest.mark.parametrize(
    ("nm", "x", "y", "z"),
    [
        (450, 0.3362, 0.0380, 1.77211),
        (500, 0.0049, 0.3230, 0.2720),
        (555, 0.5121, 1.0000, 0.0057),
        (600, 1.0622, 0.6310, 0.0008),
        (650, 0.2835, 0.1070, 0.0000),
    ],
)
def test_matching_functions_of_1931(nm, x, y, z):
    assert colour_matching_functions(np.array([nm * 1e-9]))[:, 0] == pytest.approx(
        [x, y, z], abs=0.03
    )


def test_the_observer_of_1964_at_550_nm():
    assert colour_matching_functions(np.array([550e-9]), 10)[:, 0] == pytest.approx(
        [0.529, 0.9918, 0.0040], abs=0.03
    )


def test_illuminant_a_has_its_published_colour_and_temperature():
    # CIE illuminant A: a black body at 2856 K with c2 = 1.435e-2 in 1931's scale.
    xyz = tristimulus(WAVELENGTHS, planck(2848, 1.435e-2))
    assert chromaticity(xyz) == pytest.approx((0.4476, 0.4074), abs=2e-3)
    assert uniform_chromaticity(xyz) == pytest.approx((0.2560, 0.5243), abs=2e-3)
    kelvins, off = colour_temperature(WAVELENGTHS, xyz)
    assert kelvins == pytest.approx(2856, abs=2)
    assert abs(off) < 1e-4


@pytest.mark.parametrize("kelvins", [2000, 4000, 6500, 15000])
@pytest.mark.parametrize("observer", [2, 10])
def test_a_black_body_has_its_own_temperature(kelvins, observer):
    xyz = tristimulus(WAVELENGTHS, planck(kelvins), observer)
    assert colour_temperature(WAVELENGTHS, xyz, observer)[0] == pytest.approx(kelvins, rel=1e-3)


def test_green_light_is_above_the_locus_and_has_no_temperature_far_away():
    xyz = tristimulus(WAVELENGTHS, planck(5000) / planck(5000).max() + 0.05 * laser(545, 10))
    assert colour_temperature(WAVELENGTHS, xyz)[1] > 0
    assert np.isnan(colour_temperature(WAVELENGTHS, tristimulus(WAVELENGTHS, laser(532)))).all()


def test_luminance_of_one_watt_at_555_nm():
    # 683 lm/W at the greatest efficacy.
    light = np.where(NM == 555, 1e9, 0.0)
    assert tristimulus(WAVELENGTHS, light)[1] == pytest.approx(683, rel=0.02)


@pytest.mark.parametrize("nm", [470, 500, 532, 560, 590, 610])
def test_a_laser_is_its_own_dominant_wavelength_and_pure(nm):
    found, purity = dominant_wavelength(WAVELENGTHS, tristimulus(WAVELENGTHS, laser(nm)))
    assert found == pytest.approx(nm, abs=1.5)
    assert purity == pytest.approx(100, abs=3)


def test_purple_has_the_wavelength_of_its_complement():
    purple = laser(450, 8) + laser(640, 8)
    found, purity = dominant_wavelength(WAVELENGTHS, tristimulus(WAVELENGTHS, purple))
    assert -570 < found < -550
    assert 80 < purity < 105


def test_darkness_has_no_colour():
    xyz = tristimulus(WAVELENGTHS, np.zeros(401))
    for values in (
        chromaticity(xyz),
        uniform_chromaticity(xyz),
        colour_temperature(WAVELENGTHS, xyz),
        dominant_wavelength(WAVELENGTHS, xyz),
    ):
        assert np.isnan(values).all()
