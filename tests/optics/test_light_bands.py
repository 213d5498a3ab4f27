import numpy as np
import pytest

from optics.light import Band, Spectrum

FINE = np.linspace(350e-9, 800e-9, 450_001)
"""A picometre apart."""


def width_by_search(band):
    above = FINE[band.transmission(FINE) >= 0.5]
    # The main band alone: side lobes of a Lyot filter stay below a half.
    return above[-1] - above[0]


@pytest.mark.parametrize("shape", ["gaussian", "lyot", "interference", "open"])
@pytest.mark.parametrize(("centre", "fwhm"), [(550e-9, 7e-9), (450e-9, 20e-9), (700e-9, 10e-9)])
def test_the_width_is_between_half_maxima_and_the_peak_is_one(shape, centre, fwhm):
    band = Band(centre, fwhm, shape)
    assert width_by_search(band) == pytest.approx(fwhm, abs=3e-12)
    assert band.transmission(centre) == pytest.approx(1.0)
    assert band.transmission(FINE).max() <= 1.0


@pytest.mark.parametrize("shape", ["gaussian", "lyot", "interference", "open"])
def test_beyond_the_support_less_than_a_millionth_passes(shape):
    band = Band(550e-9, 7e-9, shape)
    low, high = band.support
    x = np.linspace(300e-9, 1100e-9, 80_001)
    beyond = (x < low) | (x > high)
    assert not beyond.any() or band.transmission(x[beyond]).max() < 1e-6


def test_a_lyot_filter_is_the_product_of_its_stages():
    """Plates of thicknesses 1, 2, 4 … between polarisers: each passes cos²(π m λ₀/λ)."""
    band = Band(550e-9, 20e-9, "lyot")
    stages, order = band._stages
    assert 0.5 < order <= 1.0
    x = np.linspace(450e-9, 650e-9, 999)
    closed = np.pi * order * (550e-9 / x - 1)
    with np.errstate(invalid="ignore"):
        expected = (np.sin(2**stages * closed) / (2**stages * np.sin(closed))) ** 2
    assert band.transmission(x) == pytest.approx(np.nan_to_num(expected, nan=1.0), abs=1e-12)


def test_a_lyot_filter_has_side_lobes_where_a_gaussian_has_none():
    """The first is 4.7 % of the peak, as of any array of many equal beams (sinc²)."""
    x = np.linspace(550e-9 + 8.5e-9, 550e-9 + 14e-9, 5001)
    lobes = Band(550e-9, 7e-9, "lyot").transmission(x)
    assert lobes.max() == pytest.approx(0.0472, abs=0.001)
    assert Band(550e-9, 7e-9).transmission(x).max() < 0.02


def test_an_interference_filter_has_steeper_sides():
    edge = 550e-9 + 1.4 * 3.5e-9
    gaussian, films = Band(550e-9, 7e-9), Band(550e-9, 7e-9, "interference")
    assert films.transmission(edge) < 0.1 * gaussian.transmission(edge)
    assert films.transmission(552e-9) > gaussian.transmission(552e-9)


def test_the_leak_is_added_within_its_range():
    band = Band(550e-9, 7e-9, leak=1e-3, leak_range=(450e-9, 700e-9))
    assert band.total_transmission([440e-9, 460e-9, 550e-9, 710e-9]) == pytest.approx(
        [0, 1e-3, 1.001, 0]
    )
    assert band.transmission(460e-9) == pytest.approx(0, abs=1e-12)


def test_a_table_is_a_band_of_its_own_centre_and_width():
    """A triangle from 500 to 600 nm with its top of 0.8 at 530: its middle is the mean of the
    corners, and its half maxima are at 515 and 565 nm."""
    band = Band.from_table(Spectrum((500e-9, 530e-9, 600e-9), (0.0, 0.8, 0.0)))
    assert band.centre == pytest.approx((500e-9 + 530e-9 + 600e-9) / 3)
    assert band.fwhm == pytest.approx(50e-9)
    assert band.support == (500e-9, 600e-9)
    assert band.transmission(530e-9) == pytest.approx(1.0)
    assert hash(band) == hash(Band.from_table(Spectrum((500e-9, 530e-9, 600e-9), (0.0, 0.4, 0.0))))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Band(0.0, 1e-9), "centre is 0 m"),
        (lambda: Band(5e-7, -1e-9), "fwhm is -1e-09 m"),
        (lambda: Band(5e-7, 1.1e-6), "less than twice the centre"),
        (lambda: Band(5e-7, 2e-7, "lyot"), "a quarter of its centre"),
        (lambda: Band(5e-7, 1e-8, "round"), "shape is 'round'; choose"),
        (lambda: Band(5e-7, 1e-8, "table"), "a table goes with the shape 'table'"),
        (lambda: Band(5e-7, 1e-8, table=Spectrum.flat(1.0)), "a table goes with"),
        (lambda: Band(5e-7, 1e-8, leak=1.0), "leak is 1"),
        (lambda: Band(5e-7, 1e-8, leak=float("nan")), "leak is nan"),
        (lambda: Band(5e-7, 1e-8, leak_range=(7e-7, 4e-7)), "leak_range is"),
        (lambda: Band.from_table(Spectrum.flat(0.0)), "passes nothing"),
    ],
)
def test_a_band_that_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
