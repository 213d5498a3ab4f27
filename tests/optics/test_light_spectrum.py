import numpy as np
import pytest

from optics.light import Spectrum

TENT = Spectrum((400e-9, 500e-9, 700e-9), (0.0, 1.0, 0.5))


def test_a_spectrum_is_linear_between_its_nodes_and_nothing_beyond():
    asked = [399e-9, 400e-9, 450e-9, 500e-9, 600e-9, 700e-9, 701e-9]
    assert TENT.at(asked) == pytest.approx([0, 0, 0.5, 1, 0.75, 0.5, 0])
    assert TENT.at(600e-9).shape == ()
    assert (TENT.low, TENT.high, TENT.peak) == (400e-9, 700e-9, 1.0)


def test_integrals_are_areas_of_trapezia():
    assert TENT.integral() == pytest.approx(0.5 * 100e-9 + 0.75 * 200e-9)
    # From 450 to 600: trapezia 0.5-1 over 50 nm and 1-0.75 over 100 nm.
    assert TENT.integral(450e-9, 600e-9) == pytest.approx(0.75 * 50e-9 + 0.875 * 100e-9)
    assert TENT.integral(100e-9, 300e-9) == 0
    assert TENT.integral(100e-9, 2000e-9) == pytest.approx(TENT.integral())
    assert Spectrum.flat(3.0).integral() == pytest.approx(3.0 * 800e-9)


def test_a_product_is_exact_at_the_nodes_of_both():
    other = Spectrum((450e-9, 550e-9, 900e-9), (2.0, 4.0, 0.0))
    product = TENT.times(other)
    nodes = [450e-9, 500e-9, 550e-9, 700e-9]
    assert product.wavelengths == tuple(nodes)
    assert product.values == pytest.approx(TENT.at(nodes) * other.at(nodes))
    assert product == other.times(TENT)


def test_the_product_of_two_that_do_not_meet_is_nothing():
    assert TENT.times(Spectrum.flat(1.0, 800e-9, 900e-9)).integral() == 0


def test_the_error_between_nodes_is_the_parabolas():
    """Largest difference of a product of lines from its chord: (a₂-a₁)(b₂-b₁)/4."""
    a, b = Spectrum((400e-9, 500e-9), (0.0, 1.0)), Spectrum((400e-9, 500e-9), (1.0, 3.0))
    x = np.linspace(400e-9, 500e-9, 1001)
    assert np.abs(a.times(b).at(x) - a.at(x) * b.at(x)).max() == pytest.approx(0.5, rel=1e-6)


def test_equal_spectra_are_one_key():
    again = Spectrum([400e-9, 500e-9, 700e-9], np.array([0.0, 1.0, 0.5]))
    assert again == TENT
    assert hash(again) == hash(TENT)
    assert TENT.with_scale(2.0).values == (0.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Spectrum((5e-7,), (1.0,)), "1 wavelengths and 1 values.*two or more"),
        (lambda: Spectrum((5e-7, 6e-7), (1.0,)), "2 wavelengths and 1 values"),
        (lambda: Spectrum((6e-7, 5e-7), (1.0, 1.0)), "don't rise"),
        (lambda: Spectrum((5e-7, 5e-7), (1.0, 1.0)), "don't rise"),
        (lambda: Spectrum((-5e-7, 5e-7), (1.0, 1.0)), "isn't positive"),
        (lambda: Spectrum((5e-7, float("nan")), (1.0, 1.0)), "isn't positive"),
        (lambda: Spectrum((5e-7, 6e-7), (1.0, -0.1)), "a value is -0.1"),
        (lambda: Spectrum((5e-7, 6e-7), (1.0, float("nan"))), "a value is nan"),
        (lambda: TENT.with_scale(-1.0), "a value is -1"),
        (lambda: TENT.integral(6e-7, 5e-7), "the shorter first"),
    ],
)
def test_a_spectrum_that_cannot_be_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()
