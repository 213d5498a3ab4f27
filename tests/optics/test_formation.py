import math

import numpy as np
import pytest
import torch
from judges import binned, gaussian_psf, positions, relative
from scipy.signal import convolve2d

from optics.formation import form_image, frequencies, spectrum_of_disc, spectrum_of_samples
from optics.plane import Plane


@pytest.mark.parametrize("shape", [(12, 15), (13, 14)])
@pytest.mark.parametrize("side", [4, 5])
def test_the_image_is_the_convolution_of_object_and_psf(shape, side, rng):
    """scipy's direct convolution, with the origin of the PSF at n // 2."""
    plane = Plane(shape, (1e-6, 2e-6))
    light = np.zeros(shape)
    light[3:-3, 3:-3] = rng.random((shape[0] - 6, shape[1] - 6))
    psf = rng.random((side, side))
    full = convolve2d(light, psf)
    truth = full[side // 2 : side // 2 + shape[0], side // 2 : side // 2 + shape[1]]
    image = form_image(
        spectrum_of_samples(torch.from_numpy(light)), torch.from_numpy(psf), plane, 1, shape,
        pixel_aperture=False,
    )  # fmt: skip
    assert relative(image.numpy(), truth) <= 1e-12


@pytest.mark.parametrize("pixels", [(8, 9), (9, 8)])
def test_pixels_gather_what_falls_on_them(pixels):
    """Fringes: the integral over a pixel of 1 + cos is analytic, F² samples each."""
    factor = 3
    plane = Plane((pixels[0] * factor, pixels[1] * factor), (1e-6, 1e-6))
    f = 2 / pixels[1]  # cycles a pixel, periodic on the plane
    x = positions(plane.shape[1], 1 / factor)
    light = torch.from_numpy(1 + np.cos(2 * np.pi * f * x + 0.4)).expand(plane.shape).clone()
    point = torch.zeros(3, 3, dtype=torch.float64)
    point[1, 1] = 1
    image = form_image(spectrum_of_samples(light), point, plane, factor, pixels)
    truth = 1 + np.sinc(f) * np.cos(2 * np.pi * f * positions(pixels[1], 1.0) + 0.4)
    assert np.allclose(image.numpy(), factor**2 * truth, atol=1e-12)
    sampled = form_image(
        spectrum_of_samples(light), point, plane, factor, pixels, pixel_aperture=False
    )
    at_centres = 1 + np.cos(2 * np.pi * f * positions(pixels[1], 1.0) + 0.4)
    assert np.allclose(sampled.numpy(), factor**2 * at_centres, atol=1e-12)


@pytest.mark.parametrize("aperture", [True, False])
def test_all_light_that_the_psf_passes_arrives(aperture, rng):
    """Sum of the picture = sum of the object x sum of the PSF, the plane being periodic."""
    light, psf = rng.random((12, 16)), gaussian_psf(9, 1.5) * 0.7
    image = form_image(
        spectrum_of_samples(torch.from_numpy(light)), torch.from_numpy(psf),
        Plane((12, 16), (1e-6, 1e-6)), 1, (12, 16), pixel_aperture=aperture,
    )  # fmt: skip
    assert float(image.sum()) == pytest.approx(0.7 * light.sum(), rel=1e-12)


@pytest.mark.parametrize("shape", [(64, 64), (63, 61)])
def test_a_disc_has_the_spectrum_of_many_small_samples(shape):
    """A disc drawn on a 40 times finer grid, its DFT at the plane's frequencies."""
    plane = Plane(shape, (2e-6, 2e-6))
    diameter = 13.3e-6
    fine = positions(401, 0.05e-6)
    disc = (fine[:, None] ** 2 + fine[None, :] ** 2 <= (diameter / 2) ** 2) * 1.0
    disc *= 5.0 / disc.sum()
    fy, fx = (f.numpy() for f in frequencies(plane))
    truth = (
        np.exp(-2j * np.pi * fy * fine[None, :]) @ disc @ np.exp(-2j * np.pi * fine[:, None] * fx)
    )
    spectrum = spectrum_of_disc(plane, diameter, 5.0).numpy()
    assert spectrum[0, 0] == pytest.approx(5.0)
    assert relative(spectrum, truth) <= 2e-3


@pytest.mark.parametrize("diameter", [0.0, 1e-12, 1e-7])
def test_a_disc_below_a_sample_is_a_point(diameter):
    """All frequencies alike; J1(x) / x falls by x²/8."""
    plane = Plane((8, 9), (1e-6, 1e-6))
    assert np.allclose(spectrum_of_disc(plane, diameter).numpy(), 1, atol=0.03)


def test_a_point_gives_back_the_psf():
    psf = torch.from_numpy(gaussian_psf(9, 1.3))
    plane = Plane((16, 17), (1e-6, 1e-6))
    image = form_image(spectrum_of_disc(plane, 0.0), psf, plane, 1, (9, 9), pixel_aperture=False)
    assert relative(image.numpy(), psf.numpy()) <= 1e-12


def test_a_blurred_disc_looks_like_one_drawn_on_a_finer_grid():
    """No inverse crime: the judge convolves on a 5 times finer grid and bins."""
    sigma, diameter, n = 1.2, 4.6, 25
    plane = Plane((2 * n, 2 * n), (0.5, 0.5))
    image = form_image(
        spectrum_of_disc(plane, diameter), torch.from_numpy(gaussian_psf(50, 2 * sigma)),
        plane, 2, (n, n),
    )  # fmt: skip
    fine = positions(5 * n, 0.2)
    disc = (fine[:, None] ** 2 + fine[None, :] ** 2 <= (diameter / 2) ** 2) * 1.0
    truth = binned(convolve2d(disc / disc.sum(), gaussian_psf(61, 5 * sigma), mode="same"), 5)
    assert relative(image.numpy(), truth) <= 0.01


def test_single_precision_follows_the_psf():
    light = torch.rand(8, 8, dtype=torch.float64)
    psf = torch.rand(3, 3)
    plane = Plane((8, 8), (1e-6, 1e-6))
    image = form_image(spectrum_of_samples(light), psf, plane, 1, (8, 8))
    truth = form_image(spectrum_of_samples(light), psf.double(), plane, 1, (8, 8))
    assert image.dtype == torch.float32
    assert relative(image.numpy(), truth.numpy()) <= 1e-6


def test_a_psf_or_sensor_larger_than_the_plane_is_refused():
    plane = Plane((8, 8), (1e-6, 1e-6))
    spectrum = spectrum_of_samples(torch.ones(8, 8))
    with pytest.raises(ValueError, match=r"cannot pad \(9, 9\) to the smaller shape \(8, 8\)"):
        form_image(spectrum, torch.ones(9, 9), plane, 1, (4, 4))
    with pytest.raises(ValueError, match=r"cannot crop \(4, 4\) to the larger shape \(5, 4\)"):
        form_image(spectrum, torch.ones(3, 3), plane, 2, (5, 4))


def test_a_spectrum_of_another_plane_is_refused():
    """A row of frequencies would broadcast silently."""
    with pytest.raises(ValueError, match=r"spectrum is \(1, 5\); .*\(8, 5\)"):
        form_image(
            torch.ones(1, 5, dtype=torch.complex64), torch.ones(3, 3),
            Plane((8, 8), (1e-6, 1e-6)), 1, (4, 4),
        )  # fmt: skip


@pytest.mark.parametrize("diameter", [-1e-6, math.nan])
def test_a_negative_disc_is_refused(diameter):
    with pytest.raises(ValueError, match=r"diameter is .* m; it can't be negative"):
        spectrum_of_disc(Plane((8, 8), (1e-6, 1e-6)), diameter)
