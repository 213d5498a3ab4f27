"""Spectra interpolated from an FFT's grid, against direct sums; and the matrices that do it."""

import math

import numpy as np
import pytest
import torch

from optics.fourier import FourierGeometry
from optics.fourier.fitted_interpolation import BandedMatrix, FittedInterpolation
from optics.fourier.spectrum_grid import FullSpectrum, MirroredSpectrum
from optics.plane import Plane
from optics.psf.interpolated_pixels import InterpolatedPixelTransform
from optics.quarter_symmetry import mirror_quarter, quarter_shape


def random_complex(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize("count", [40, 41])
@pytest.mark.parametrize("length", [54, 60, 81])
@pytest.mark.parametrize("tol", [1e-2, 1e-4, 1e-7])
def test_samples_between_the_grid_keep_the_error_that_is_stated(count, length, tol):
    rng = np.random.default_rng(0)
    frequencies = np.sort(rng.uniform(-0.4, 0.4, 23))
    t = np.arange(count) - (count - 1) / 2

    def factor(places):
        return np.sinc(0.3 * places - frequencies[:, None]) * np.exp(0.1j * places**2)

    # Input of modulus one, for which the error is stated; its sum has a mean square of `count`.
    field = np.exp(2j * np.pi * rng.random((count, 50)))
    truth = (np.exp(-2j * np.pi * np.outer(frequencies, t)) * factor(t / (count / 2))) @ field
    found = FittedInterpolation(count, length, frequencies, tol, factor)
    spectrum = np.fft.fft(field * found.scaling[:, None], length, axis=0)
    on_grid = torch.from_numpy(spectrum[np.array(found.grid) % length])
    error = found.matrix(torch.complex128).forward(on_grid).numpy() - truth
    assert found.error <= tol
    assert np.sqrt((np.abs(error) ** 2).mean() / count) <= found.error


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_banded_matrix_multiplies_as_its_dense_one(mirrored):
    rng = np.random.default_rng(1)
    entries = torch.from_numpy(random_complex(rng, 37, 5))
    first = torch.from_numpy(np.sort(rng.integers(-12, 14, 37)))
    if not mirrored:
        first = first + 12
    columns = 19 if mirrored else 31
    dense = torch.zeros(37, columns, dtype=torch.complex128)
    for row in range(37):
        for k in range(5):
            column = int(first[row]) + k
            dense[row, abs(column) if mirrored else column] += entries[row, k]
    matrix = BandedMatrix(entries, first, columns, mirrored=mirrored)
    lines, other = (torch.from_numpy(random_complex(rng, n, 6)) for n in (columns, 37))
    assert torch.allclose(matrix.forward(lines), dense @ lines)
    assert torch.allclose(matrix.adjoint(other), dense.mH @ other)


@pytest.mark.parametrize("count", [12, 13])
@pytest.mark.parametrize("on_device", [False, True])
def test_a_mirrored_spectrum_is_that_of_the_whole_field(count, on_device):
    rng = np.random.default_rng(2)
    half = torch.from_numpy(random_complex(rng, (count + 1) // 2, 3))
    whole = torch.cat([half[count % 2 :].flip(0), half])
    one = MirroredSpectrum(count, 20, range(-3, 9))
    points, t = np.arange(9), np.arange(count) - (count - 1) / 2
    truth = torch.from_numpy(np.exp(-2j * np.pi / 20 * np.outer(points, t))) @ whole
    forward = one._forward_on_device if on_device else one.forward
    adjoint = one._adjoint_on_device if on_device else one.adjoint
    assert torch.allclose(forward(half, 0), truth)
    assert torch.allclose(forward(half.mT.contiguous(), 1), truth.mT)
    other = torch.from_numpy(random_complex(rng, 9, 3))
    dot = (forward(half, 0).conj() * other).sum()
    assert torch.allclose(dot, (half.conj() * adjoint(other, 0)).sum())


def test_a_spectrum_on_more_than_a_period_repeats():
    rng = np.random.default_rng(3)
    field = torch.from_numpy(random_complex(rng, 7, 2))
    one = FullSpectrum(7, 10, range(-8, 9))
    truth = (
        torch.from_numpy(np.exp(-2j * np.pi / 10 * np.outer(np.arange(-8, 9), np.arange(7))))
        @ field
    )
    assert torch.allclose(one.unfold(one.forward(field, 0)), truth)
    other = torch.from_numpy(random_complex(rng, 17, 2))
    dot = (truth.conj() * other).sum()
    assert torch.allclose(dot, (field.conj() * one.adjoint(one.fold(other), 0)).sum())


def direct_integral(plane, curvature, side, image, scale, field):
    """Sum over pixels the mean over each square of the wave and the kernel, by 12 x 12 nodes."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    kernels = []
    for axis in (0, 1):
        x, u = plane.coordinates(axis).numpy(), image.coordinates(axis).numpy()
        inside = x[:, None] + nodes * side / 2
        wave = np.exp(1j * curvature * inside**2) * weights / 2
        kernel = np.exp(-2j * np.pi / scale * u[:, None, None] * inside)
        kernels.append((kernel * wave).sum(-1))
    return kernels[0] @ field @ kernels[1].T


@pytest.mark.parametrize("shape", [(20, 30), (21, 31), (20, 31)])
@pytest.mark.parametrize("curvature", [0.0, 3e6, -9e6])
@pytest.mark.parametrize("error", [1e-3, 1e-6])
def test_pixels_are_integrated_by_ffts_as_by_sums(shape, curvature, error):
    rng = np.random.default_rng(4)
    plane, scale, side = Plane(shape, (40e-6, 40e-6)), 5e-8, 37e-6
    image = Plane((17, 14), (20e-6, 23e-6), (30e-6, -50e-6))
    geometry = FourierGeometry(plane, image, scale)
    quarter = random_complex(rng, *quarter_shape(shape))
    whole = mirror_quarter(torch.from_numpy(quarter), shape).numpy()
    truth = direct_integral(plane, curvature, side, image, scale, whole)
    for mirrored, field in ((False, whole), (True, quarter)):
        one = InterpolatedPixelTransform(
            geometry, torch.complex128, curvature, side, error, mirrored=mirrored
        )
        given = torch.from_numpy(field)
        found = one(given).numpy()
        assert one.fits
        # The light on this part of the image is less than a share of all that the error is of.
        assert np.linalg.norm(found - truth) <= 3 * error * np.linalg.norm(truth)
        other = torch.from_numpy(random_complex(rng, 17, 14))
        dot = (one(given).conj() * other).sum()
        assert torch.allclose(dot, (given.conj() * one._adjoint(other)).sum())


def test_the_intensity_has_the_derivatives_of_the_field():
    geometry = FourierGeometry(
        Plane((6, 9), (40e-6, 40e-6)), Plane((5, 4), (20e-6, 23e-6), (0.0, 3e-5)), 5e-8
    )
    one = InterpolatedPixelTransform(geometry, torch.complex128, 5e6, 37e-6, 1e-6, mirrored=True)
    field = torch.randn(2, *one.field_shape, dtype=torch.complex128, requires_grad=True)
    assert torch.allclose(one.intensity(field, 0.3), 0.3 * one(field).abs() ** 2)
    assert torch.autograd.gradcheck(lambda f: one.intensity(f, 0.3), (field,))


def test_a_field_of_another_shape_is_refused():
    geometry = FourierGeometry(Plane((6, 9), (4e-5, 4e-5)), Plane((5, 4), (2e-5, 2e-5)), 5e-8)
    one = InterpolatedPixelTransform(geometry, torch.complex128, 0.0, 37e-6, 1e-6, mirrored=True)
    with pytest.raises(ValueError, match=r"field is \(6, 9\); it has \(3, 5\) samples"):
        one(torch.ones(6, 9))


def test_a_wave_that_bends_much_inside_pixels_does_not_fit():
    geometry = FourierGeometry(Plane((6, 9), (4e-5, 4e-5)), Plane((5, 4), (2e-5, 2e-5)), 5e-8)
    curvature = 3.0 / (4.5 * 40e-6 * 37e-6)
    assert not InterpolatedPixelTransform(geometry, torch.complex64, curvature, 37e-6, 1e-4).fits
    assert math.isclose(curvature * 4.5 * 40e-6 * 37e-6, 3.0)
