import numpy as np
import pytest
from scipy.constants import Wien, c, h, k, sigma

from optics.light import Spectrum, blackbody, broadband, halogen, lamp_from_table, monochromatic


def planck(wavelength, temperature):
    """Radiance by wavelength, W/(sr m² m), from the constants of nature."""
    return 2 * h * c**2 / wavelength**5 / np.expm1(h * c / (wavelength * k * temperature))


@pytest.mark.parametrize("temperature", [2000.0, 2856.0, 3200.0, 6500.0, 12000.0])
def test_a_black_body_is_plancks(temperature):
    x = np.linspace(400e-9, 1100e-9, 1777)
    visible = np.linspace(400e-9, 720e-9, 100_001)
    expected = planck(x, temperature) / planck(visible, temperature).max()
    assert blackbody(temperature).at(x) == pytest.approx(expected, rel=2e-4)


def test_wiens_law_of_the_peak():
    """5000 K is brightest at 579.55 nm."""
    body = blackbody(5000.0)
    peak = body.wavelengths[int(np.argmax(body.values))]
    assert peak == pytest.approx(Wien / 5000.0, abs=1e-9)


def test_stefan_and_boltzmanns_law_of_the_whole():
    """π times the radiance over all wavelengths is σ T⁴; what lies beyond 30 µm is 2e-4 of it."""
    body = blackbody(4000.0, 50e-9, 30e-6)
    visible = np.linspace(400e-9, 720e-9, 100_001)
    whole = np.pi * body.integral() * planck(visible, 4000.0).max()
    assert whole == pytest.approx(sigma * 4000.0**4, rel=5e-4)


def test_a_halogen_lamp_is_redder_than_daylight():
    assert halogen() == blackbody(3200.0)
    blue_to_red = [
        b.at(450e-9) / b.at(650e-9) for b in (halogen(2800.0), halogen(), blackbody(6500.0))
    ]
    assert blue_to_red == sorted(blue_to_red)
    assert halogen().at(720e-9) == pytest.approx(1.0)


def test_a_line_has_its_width_and_an_even_lamp_none():
    line = monochromatic(532e-9, 2e-9)
    assert line.at([531e-9, 532e-9, 533e-9]) == pytest.approx([0.5, 1.0, 0.5])
    assert broadband(400e-9, 700e-9).at([400e-9, 555e-9, 700e-9]).tolist() == [1, 1, 1]


def test_a_table_is_made_relative_to_its_visible_peak():
    table = Spectrum((300e-9, 500e-9, 900e-9), (9.0, 3.0, 7.0))
    # Brightest of the visible is 400 nm: halfway from 9 to 3.
    assert lamp_from_table(table).at(400e-9) == pytest.approx(1.0)
    assert lamp_from_table(table).at(500e-9) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: blackbody(300.0), "temperature is 300 K.*1000 K or more"),
        (lambda: blackbody(float("nan")), "temperature is nan"),
        (lambda: blackbody(float("inf")), "temperature is inf"),
        (lambda: blackbody(3000.0, 7e-7, 4e-7), "the shorter first"),
        (lambda: monochromatic(0.0), "wavelength is 0 m"),
        (lambda: monochromatic(5e-7, -1e-9), "width is -1e-09 m"),
        (lambda: monochromatic(5e-7, 6e-7), "narrower than its wavelength"),
        (lambda: lamp_from_table(Spectrum.flat(1.0, 800e-9, 900e-9)), "0 from 400 to 720 nm"),
    ],
)
def test_a_source_that_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
