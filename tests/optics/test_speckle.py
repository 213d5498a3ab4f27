"""Degrees of freedom of speckle against formulas and sums, and what is drawn."""

import math

import numpy as np
import pytest

from optics.speckle import RoughSurface, SpeckleGrain, draw_speckle, spectral_variance

LEVER = 550e-9 * 0.1


def square_pupil(cells: int = 21, cell: float = 1e-3) -> SpeckleGrain:
    """A square of 9 mm; a grain is 6.1 µm wide."""
    light = np.zeros((cells, cells))
    light[6:15, 6:15] = 1.0
    return SpeckleGrain(light, cell, LEVER)


@pytest.mark.parametrize("roughness", [2e-6, 20e-6])
def test_a_gaussian_line_speckles_by_its_coherence_length(roughness):
    """Goodman: 1/M = 1/√(1 + (8π σ w / λ²)²)."""
    width = 3e-9
    waves = 550e-9 + width * np.linspace(-6, 6, 601)
    weights = np.exp(-(((waves - 550e-9) / width) ** 2) / 2)
    wanted = 1 / math.sqrt(1 + (8 * math.pi * roughness * width / 550e-9**2) ** 2)
    assert spectral_variance(waves, weights, roughness) == pytest.approx(wanted, rel=3e-3)


def test_a_smooth_surface_does_not_speckle():
    """Of heights h, 1 - exp(-2 (4π h/λ)²) is left, as for a phasor beside many small ones."""
    for height in (1e-9, 2e-8, 1e-7):
        wanted = 1 - math.exp(-2 * (4 * math.pi * height / 550e-9) ** 2)
        found = spectral_variance(np.array([550e-9]), np.ones(1), height)
        assert found == pytest.approx(wanted, rel=1e-9)


def test_polarisations_and_patterns_average():
    assert RoughSurface(1e-6).surface_variance(0.5) == 0.5
    assert RoughSurface(1e-6).surface_variance(0.1) == pytest.approx(0.82)
    assert RoughSurface(1e-6, depolarises=False).surface_variance(0.5) == 1
    assert RoughSurface(1e-6, patterns=4).surface_variance(0.0) == 0.25


@pytest.mark.parametrize("pitch", [1e-6, 6e-6, 25e-6])
def test_a_pixel_averages_grains(pitch):
    """By the double integral of |sinc|² over the pixel, of a square pupil (Goodman 4.7.1)."""
    at = (np.arange(400) + 0.5) / 400 * pitch
    apart = at[:, None] - at
    along = float((np.sinc(9e-3 * apart / LEVER) ** 2).mean())
    assert square_pupil().pixel_variance(pitch) == pytest.approx(along**2, rel=0.02)


def test_a_moving_object_averages_more():
    still, moved = (square_pupil().pixel_variance(3e-6, (0.0, path)) for path in (0.0, 30e-6))
    assert moved < 0.3 * still


@pytest.mark.parametrize(("share", "pitch"), [(1.0, 3e-6), (0.4, 3e-6), (0.02, 3e-6), (0.3, 60e-6)])
def test_what_is_drawn_has_its_mean_and_variance(share, pitch):
    grain = square_pupil()
    pixel = grain.pixel_variance(pitch)
    rng = np.random.default_rng(3)
    drawn = draw_speckle(rng, (150, 160), pitch, grain, share * pixel, pixel, 4)
    assert drawn.min() >= 0
    assert drawn.mean() == pytest.approx(1, abs=0.03)
    assert drawn.var() == pytest.approx(share * pixel, rel=0.06)


def test_neighbours_share_a_grain():
    """The covariance of pixels, by the same integral over two of them."""
    grain, pitch = square_pupil(), 3e-6
    at = (np.arange(100) + 0.5) / 100 * pitch
    one, next_ = (
        float((np.sinc(9e-3 * (at[:, None] - at + away) / LEVER) ** 2).mean())
        for away in (0.0, pitch)
    )
    rng, pixel = np.random.default_rng(5), grain.pixel_variance(pitch)
    drawn = draw_speckle(rng, (200, 220), pitch, grain, pixel, pixel, 4) - 1
    shared = (drawn[:, 1:] * drawn[:, :-1]).mean() / drawn.var()
    assert shared == pytest.approx(next_ / one, abs=0.03)


@pytest.mark.parametrize(
    ("data", "name"),
    [((0.0,), "roughness"), ((5.0,), "roughness"), ((1e-6, True, 0.5), "patterns")],
)
def test_data_that_cannot_be_are_refused(data, name):
    with pytest.raises(ValueError, match=name):
        RoughSurface(*data)
