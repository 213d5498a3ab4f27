"""Targets that are turned, against the integral over the source at each turned point."""

import math

import numpy as np
import pytest
import torch
from judges import relative
from judges.free_space_sums import cell_matrix, gauss, turned
from sweeps import some

from optics.accuracy import ToleranceError
from optics.plane import Plane
from optics.propagation import FreeSpace
from optics.propagation.angular_spectrum import ScaledAngularSpectrum, TiltedAngularSpectrum
from optics.propagation.span import FreeSpaceSpan

BLUE = 0.5e-6
SOURCE = Plane((6, 5), (2e-6, 2.5e-6), (1e-6, 2e-6))
CELLS = (1.8e-6, 2.4e-6)
TARGET = Plane((5, 6), (1.5e-6, 1.3e-6), (4e-6, -3e-6))
TILTS = [(0.3, -0.2), (-0.5, 0.0), (0.0, 0.7), (1e-3, 1e-3)]


def matrix(method) -> np.ndarray:
    n = math.prod(method.span.source.shape)
    eye = torch.eye(n, dtype=torch.complex128).reshape(n, *method.span.source.shape)
    return method.forward(eye).reshape(n, -1).numpy().T


def worst(method, truth: np.ndarray) -> float:
    target = method.span.target.pitch
    weight = math.sqrt(target[0] * target[1] / method.span.sample_area)
    return float(np.linalg.norm(matrix(method) - truth, 2)) * weight


@pytest.mark.parametrize("tilt", TILTS)
def test_span_places_samples_as_two_turns_do(tilt):
    span = FreeSpaceSpan(SOURCE, TARGET, -2e-4, BLUE, tilt=tilt)
    own = Plane(TARGET.shape, TARGET.pitch)
    places = torch.broadcast_tensors(*span.target_position(*own.mesh()))
    for value, expected in zip(places, turned(TARGET, tilt, -2e-4), strict=True):
        assert np.allclose(value.numpy().ravel(), expected, rtol=0, atol=1e-18)
    corners = np.array(span.target_corners)
    assert corners[:, 2].min() == pytest.approx(places[2].min())
    assert corners[:, 1].max() == pytest.approx(places[1].max())


@pytest.mark.parametrize("z", some([2e-4, -2e-4, 3e-3], 0, 1))
@pytest.mark.parametrize("tilt", TILTS)
def test_a_turned_plane_keeps_every_tolerance(tilt, z):
    truth = cell_matrix(SOURCE, CELLS, TARGET, z, BLUE, tilt=tilt)
    for tol in (1e-1, 1e-3, 1e-5, 1e-8):
        method = TiltedAngularSpectrum(
            FreeSpaceSpan(SOURCE, TARGET, z, BLUE, CELLS, tilt=tilt, tol=tol)
        )
        assert worst(method, truth) <= method.error.value + method.arithmetic <= tol


@pytest.mark.parametrize("z", [2e-4, -2e-4])
def test_a_turned_plane_of_the_paraxial_model(z):
    """Fresnel's integral at each point's own depth."""
    tilt = (0.1, -0.2)
    truth = cell_matrix(SOURCE, CELLS, TARGET, z, BLUE, tilt=tilt, paraxial=True)
    span = FreeSpaceSpan(SOURCE, TARGET, z, BLUE, CELLS, tilt=tilt, paraxial=True, tol=1e-6)
    assert worst(TiltedAngularSpectrum(span), truth) <= 1e-6


def test_the_paraxial_model_has_no_grazing_waves():
    """Far off the axis its frequencies are beyond one over the wavelength, and count."""
    target = Plane((3, 2), (20e-6, 15e-6), (0.0, 250e-6))
    truth = cell_matrix(SOURCE, CELLS, target, 2e-4, BLUE, nodes=30, paraxial=True)
    span = FreeSpaceSpan(SOURCE, target, 2e-4, BLUE, CELLS, paraxial=True, tol=1e-5)
    assert worst(TiltedAngularSpectrum(span), truth) <= 1e-5


def test_a_smooth_beam_on_a_steep_plane():
    """A paraxial Gaussian beam in its closed form at each point's depth."""
    source, waist, tilt = Plane((90, 91), (5e-6, 5e-6)), 50e-6, (0.9, 0.4)
    target = Plane((40, 41), (6e-6, 5e-6), (20e-6, 10e-6))
    y, x, z = (v.reshape(target.shape) for v in turned(target, tilt, 0.02))
    q = 1 / (1 + 1j * z * BLUE / (math.pi * waist**2))
    truth = q * np.exp(-(x**2 + y**2) * q / waist**2 + 2j * np.pi / BLUE * (z - 0.02))
    operator = FreeSpace(source, target, 0.02, BLUE, tilt=tilt, paraxial=True, tol=1e-7)
    answer = operator(gauss(source, waist, 0.0, BLUE))
    assert relative(answer, truth) <= 1e-7


def test_no_tilt_is_the_same_as_a_plane_that_faces_the_source():
    span = FreeSpaceSpan(SOURCE, TARGET, 2e-4, BLUE, CELLS, tol=1e-8)
    facing, turned_ = matrix(ScaledAngularSpectrum(span)), matrix(TiltedAngularSpectrum(span))
    assert relative(turned_, facing) < 1e-7


@pytest.mark.parametrize("shape", [(5, 6), (1, 1), (4, 1)])
def test_the_adjoint_is_the_conjugate_transpose(shape):
    target = Plane(shape, TARGET.pitch, TARGET.centre)
    method = TiltedAngularSpectrum(
        FreeSpaceSpan(SOURCE, target, 2e-4, BLUE, CELLS, tilt=(0.3, -0.2), tol=1e-9)
    )
    n = math.prod(shape)
    eye = torch.eye(n, dtype=torch.complex128).reshape(n, *shape)
    back = method.adjoint(eye).reshape(n, -1).resolve_conj().numpy().T
    assert relative(back, matrix(method).conj().T) < 1e-11


@pytest.mark.parametrize("paraxial", [False, True])
def test_derivatives_in_field_and_lengths(paraxial):
    generator = torch.Generator().manual_seed(0)
    field = torch.randn(2, 3, dtype=torch.complex128, generator=generator)
    lengths = [torch.tensor(v, dtype=torch.float64) for v in (2.0, 0.5, 4.0, -3.0)]
    source = Plane((2, 3), (2e-6, 2e-6))

    def answer(u, z, wavelength, y, x):
        target = Plane((2, 2), (1.5e-6, 1.3e-6), (1e-6 * y, 1e-6 * x))
        operator = FreeSpace(
            source,
            target,
            1e-4 * z,
            1e-6 * wavelength,
            cells=(2e-6, 2e-6),
            tilt=(0.2, -0.3),
            paraxial=paraxial,
            tol=1e-6,
            method="tilted angular spectrum",
        )
        return torch.view_as_real(operator(u))

    inputs = tuple(value.requires_grad_() for value in (field, *lengths))
    assert torch.autograd.gradcheck(answer, inputs, eps=1e-5, atol=1e-4, rtol=1e-4)


def test_a_target_that_cuts_the_source_is_refused():
    wide = Plane((400, 10), (2e-6, 2e-6))
    with pytest.raises(ValueError, match=r"through the source's plane.* to .* on the other side"):
        TiltedAngularSpectrum(FreeSpaceSpan(SOURCE, wide, 2e-4, BLUE, CELLS, tilt=(0.8, 0.0)))
    with pytest.raises(ValueError, match="face the source"):
        FreeSpaceSpan(SOURCE, wide, 2e-4, BLUE, CELLS, tilt=(1.6, 0.0))


def test_a_turned_target_that_grazes_is_refused():
    tall = Plane((180, 10), (2e-6, 2e-6))
    with pytest.raises(ToleranceError, match="graze"):
        TiltedAngularSpectrum(
            FreeSpaceSpan(SOURCE, tall, 1.3e-4, BLUE, CELLS, tilt=(0.75, 0.0), tol=1e-6)
        )
