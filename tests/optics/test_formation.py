import math

import numpy as np
import pytest
import torch
from judges import binned, gaussian_psf, positions, relative
from scipy.signal import convolve2d
from scipy.special import j1

from optics.formation import (
    form_coherent_image,
    form_image,
    rfft2_frequencies,
    spectrum_of_disc,
    spectrum_of_samples,
)
from optics.plane import Plane, centred_pad


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
    fy, fx = (f.numpy() for f in rfft2_frequencies(plane))
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


def random_wave(rng, *shape) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def airy_field(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """2 J1(v) / v; the first zero lies a unit, the Rayleigh distance, from the centre."""
    v = np.maximum(3.8317059702075125 * np.hypot(y, x), 1e-9)
    return 2 * j1(v) / v


@pytest.mark.parametrize("shape", [(12, 15), (13, 14), (1, 6)])
@pytest.mark.parametrize("side", [(4, 4), (5, 5), (4, 7), (16, 21), (1, 1)])
def test_the_coherent_image_is_the_convolution_of_fields_squared(shape, side, rng):
    """scipy's direct convolution; spreads larger than the field, and light up to its edges."""
    field, spread = random_wave(rng, *shape), random_wave(rng, *side)
    y, x = side[0] // 2, side[1] // 2
    wave = convolve2d(field, spread)[y : y + shape[0], x : x + shape[1]]
    image = form_coherent_image(field, spread)
    assert image.dtype == np.float64
    assert relative(image, np.abs(wave) ** 2) <= 1e-13


def test_a_coherent_point_gives_back_the_intensity_of_its_spread(rng):
    """Its light is the share sum |p|², wherever it lies; at the edge half is lost, none wraps."""
    spread = random_wave(rng, 5, 6)
    field = np.zeros((2, 15, 16), complex)
    field[0, 9, 5], field[1, 0, 15] = 1j, 1j
    inner, corner = form_coherent_image(field, spread)
    assert np.allclose(inner[7:12, 2:8], np.abs(spread) ** 2, rtol=1e-12)
    assert inner.sum() == pytest.approx((np.abs(spread) ** 2).sum(), rel=1e-12)
    assert np.allclose(corner[:3, 12:], np.abs(spread[2:, :4]) ** 2, rtol=1e-12)
    assert corner.sum() == pytest.approx((np.abs(spread[2:, :4]) ** 2).sum(), rel=1e-12)


@pytest.mark.parametrize(
    ("angle", "dip"), [(0.0, None), (np.pi / 2, 0.735), (np.pi, 0.0), (-np.pi / 2, 0.735)]
)
@pytest.mark.parametrize("n", [(48, 60), (49, 61)])
def test_two_coherent_points_at_the_rayleigh_distance(n, angle, dip):
    """In phase they are one, in quadrature they add in intensity, in antiphase they part.

    Goodman 6.5.2; 0.735 is the textbook's dip at Rayleigh's distance.
    """
    half, pitch = 5, 0.1
    field = np.zeros(n, complex)
    middle = (n[0] // 2, n[1] // 2)
    field[middle[0], middle[1] - half] = 1
    field[middle[0], middle[1] + half] = np.exp(1j * angle)
    fine = [positions(2 * side - 1, pitch) for side in n]
    image = form_coherent_image(field, airy_field(fine[0][:, None], fine[1][None, :]))
    y, x = positions(n[0], pitch)[:, None], positions(n[1], pitch)[None, :]
    truth = airy_field(y, x + half * pitch) + np.exp(1j * angle) * airy_field(y, x - half * pitch)
    assert relative(image, np.abs(truth) ** 2) <= 1e-12
    line = image[middle[0]]
    ratio = line[middle[1]] / line[middle[1] + half]
    if dip is None:
        assert ratio > 1
        assert line.argmax() == middle[1]
    else:
        assert ratio == pytest.approx(dip, abs=1e-3)


def test_a_tilt_of_the_object_matters_to_coherent_light_alone(rng):
    """A linear phase goes past a coherent lens, and does nothing to incoherent light."""
    plane = Plane((40, 41), (1.0, 1.0))
    y, x = plane.mesh()
    light = torch.zeros(40, 41, dtype=torch.float64)
    light[12:28, 12:28] = torch.from_numpy(rng.random((16, 16))) + 1
    # Passes up to 0.1 cycles a sample, to e^-4: a Gaussian has no side lobes.
    spread = torch.exp(-(math.pi**2) * 0.1**2 / 4 * (y**2 + x**2)).to(torch.complex128)
    tilted = torch.sqrt(light) * torch.exp(2j * math.pi * 0.4 * (x - y))

    def incoherent(field: torch.Tensor) -> torch.Tensor:
        spectrum = spectrum_of_samples(field.abs() ** 2)
        return form_image(
            spectrum, spread.abs() ** 2, plane, 1, (40, 41), pixel_aperture=False
        )  # fmt: skip

    straight = torch.sqrt(light).to(torch.complex128)
    assert relative(incoherent(tilted).numpy(), incoherent(straight).numpy()) <= 1e-13
    passed = form_coherent_image(tilted, spread).sum() / form_coherent_image(straight, spread).sum()
    assert float(passed) <= 1e-3


def test_incoherent_light_is_coherent_light_of_random_phases():
    """Eq. 2.17 from 2.16: the mean of 4000 pictures, each pixel to 5 standard errors.

    A speckled pixel's standard deviation is at most its mean.
    """
    generator, count = torch.Generator().manual_seed(5), 4000
    light = torch.zeros(12, 13, dtype=torch.float64)
    light[4:-4, 4:-4] = torch.rand(4, 5, generator=generator, dtype=torch.float64)
    spread = torch.randn(4, 5, generator=generator, dtype=torch.complex128)
    angle = 2 * math.pi * torch.rand(count, 12, 13, generator=generator, dtype=torch.float64)
    mean = form_coherent_image(torch.polar(torch.sqrt(light), angle), spread).mean(0)
    image = form_image(
        spectrum_of_samples(light), spread.abs() ** 2, Plane((12, 13), (1.0, 1.0)), 1, (12, 13),
        pixel_aperture=False,
    )  # fmt: skip
    assert float(((mean - image).abs() / image.abs().clamp(min=1e-9)).max()) <= 5 / count**0.5
    assert relative(mean.numpy(), image.numpy()) <= 3 / count**0.5


@pytest.mark.parametrize("shape", [(8, 9), (7, 8), (1, 1)])
@pytest.mark.parametrize("size", [(14, 15), (15, 14)])
def test_the_middle_of_a_coherent_image_keeps_its_origin(size, shape):
    """A point at the origin of the field lights the origin of what is answered."""
    field = torch.zeros(size, dtype=torch.complex64)
    field[size[0] // 2, size[1] // 2] = 1
    spread = torch.ones(1, 1)
    image = form_coherent_image(field, spread, shape)
    expected = torch.zeros(shape)
    expected[shape[0] // 2, shape[1] // 2] = 1
    assert torch.allclose(image, expected, atol=1e-6)


def test_a_margin_of_half_a_spread_brings_in_all_light(rng):
    """What shines in from the margin is there; further away nothing changes the picture."""
    spread, field = torch.from_numpy(random_wave(rng, 5, 6)), random_wave(rng, 20, 20)
    field = torch.from_numpy(field)
    middle = form_coherent_image(field, spread, (14, 14))
    elsewhere = centred_pad(field, (26, 28))
    elsewhere[:, :2] = 7
    assert relative(
        form_coherent_image(elsewhere, spread, (14, 14)).numpy(), middle.numpy()
    ) <= 1e-12  # fmt: skip
    assert relative(form_coherent_image(field[3:-3, 3:-3], spread).numpy(), middle.numpy()) > 0.01


@pytest.mark.parametrize("name", ["field", "amplitude_psf"])
def test_single_precision_stays_single_in_coherent_light(name, rng):
    waves = {"field": random_wave(rng, 3, 9, 8), "amplitude_psf": random_wave(rng, 4, 5)}
    truth = form_coherent_image(**waves)
    single = {n: torch.from_numpy(w).to(torch.complex64) for n, w in waves.items()}
    image = form_coherent_image(**single)
    assert image.dtype == torch.float32
    assert relative(image.numpy(), truth) <= 1e-6
    mixed = form_coherent_image(**single | {name: torch.from_numpy(waves[name])})
    assert mixed.dtype == torch.float64


def test_spreads_and_fields_may_come_in_batches(rng):
    fields, spreads = random_wave(rng, 3, 1, 6, 7), random_wave(rng, 2, 3, 3)
    images = form_coherent_image(fields, spreads)
    assert images.shape == (3, 2, 6, 7)
    assert relative(images[2, 1], form_coherent_image(fields[2, 0], spreads[1])) <= 1e-13


def test_gradients_pass_through_a_coherent_image(rng):
    """Finite differences; and no trouble where no light is."""
    field = torch.from_numpy(random_wave(rng, 4, 3)).requires_grad_()
    spread = torch.from_numpy(random_wave(rng, 2, 3)).requires_grad_()
    assert torch.autograd.gradcheck(form_coherent_image, (field, spread))
    dark = torch.zeros(4, 4, dtype=torch.complex64, requires_grad=True)
    form_coherent_image(dark, torch.ones(3, 3)).sum().backward()
    assert torch.isfinite(torch.view_as_real(dark.grad)).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"field": torch.ones(8)}, r"field is \(8,\); give \(..., rows, columns\)"),
        ({"amplitude_psf": torch.ones(0, 3)}, r"amplitude_psf is \(0, 3\); give"),
        (
            {"field": torch.ones(2, 8, 8), "amplitude_psf": torch.ones(3, 3, 3)},
            r"field is \(2, 8, 8\) and amplitude_psf is \(3, 3, 3\); "
            "their leading axes must be alike",
        ),
        ({"shape": (9, 8)}, r"cannot crop \(8, 8\) to the larger shape \(9, 8\)"),
        ({"field": torch.full((8, 8), math.nan)}, "field has 64 NaN or infinite values of 64"),
        ({"amplitude_psf": torch.full((3, 3), math.inf)}, "amplitude_psf has 9 NaN or infinite"),
    ],
)
def test_what_makes_no_coherent_image_is_refused(change, words):
    settings = {"field": torch.ones(8, 8), "amplitude_psf": torch.ones(3, 3)}
    with pytest.raises(ValueError, match=words):
        form_coherent_image(**settings | change)
