"""Every transform against the sum that it claims to compute, written out in judges.py."""

import numpy as np
import pytest
import torch
from judges import direct_transform, relative

from optics.accuracy import Budget, ToleranceError
from optics.fourier import (
    ChirpTransform,
    Geometry,
    MatrixTransform,
    PrunedTransform,
    plan_transform,
    transforms,
)
from optics.plane import Plane

SCALE = 550e-9 * 0.125
METHODS = [MatrixTransform, ChirpTransform, PrunedTransform]
PRECISION = [(torch.complex64, 2e-6), (torch.complex128, 1e-11)]


def padded(pupil: Plane, shape: tuple[int, int], lengths: tuple[int, int]) -> Geometry:
    """The geometry of an FFT that is padded to `lengths`."""
    pitch = tuple(SCALE / (n * p) for n, p in zip(lengths, pupil.pitch, strict=True))
    return Geometry(pupil, Plane(shape, pitch), SCALE)


ON_FFT_GRID = {
    "even": padded(Plane((6, 8), (8e-6, 8e-6)), (4, 10), (12, 16)),
    "odd": padded(Plane((7, 9), (8e-6, 5e-6)), (5, 11), (15, 11)),
    "mixed": padded(Plane((6, 9), (8e-6, 5e-6)), (7, 8), (13, 18)),
    "line": padded(Plane((1, 9), (8e-6, 5e-6)), (1, 8), (4, 18)),
}
ANY_GRID = {
    **ON_FFT_GRID,
    "anywhere": Geometry(
        Plane((7, 10), (8e-6, 6e-6), (1e-4, -3e-4)),
        Plane((9, 6), (3.45e-6, 5e-6), (2e-3, 1e-3)),
        SCALE,
    ),
    "coarse": Geometry(Plane((8, 5), (4e-4, 3e-4)), Plane((5, 8), (3e-4, 1e-4)), SCALE),
}
CASES = [
    pytest.param(method, geometry, id=f"{method.name}, {name}")
    for method in METHODS
    for name, geometry in (ON_FFT_GRID if method is PrunedTransform else ANY_GRID).items()
]


def random_field(shape, seed=0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_a_transform_equals_the_direct_sum(method, geometry, dtype, bound):
    field = random_field(geometry.pupil.shape)
    truth = direct_transform(field, geometry.pupil, geometry.image, geometry.scale)
    value = method(geometry, dtype)(torch.from_numpy(field))
    assert value.dtype == dtype
    assert relative(value.numpy(), truth) <= bound


@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_a_batch_is_transformed_field_by_field(method, geometry):
    fields = random_field((2, 3, *geometry.pupil.shape))
    value = method(geometry, torch.complex128)(torch.from_numpy(fields))
    truth = direct_transform(fields[1, 2], geometry.pupil, geometry.image, geometry.scale)
    assert value.shape == (2, 3, *geometry.image.shape)
    assert relative(value[1, 2].numpy(), truth) <= 1e-11


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_the_adjoint_passes_the_dot_test(method, geometry, dtype, bound):
    """<A x, y> = <x, A* y> defines the adjoint."""
    x = torch.from_numpy(random_field(geometry.pupil.shape, 1))
    y = torch.from_numpy(random_field(geometry.image.shape, 2))
    transform = method(geometry, dtype)
    left = torch.sum(transform(x).to(torch.complex128).conj() * y)
    right = torch.sum(x.conj() * transform.adjoint(y).to(torch.complex128))
    size = transform(x).norm() * y.norm()
    assert abs(complex(left - right)) <= bound * float(size)


@pytest.mark.parametrize("method", METHODS)
def test_gradients_pass_both_ways(method):
    """Finite differences, by torch.autograd.gradcheck."""
    geometry = padded(Plane((2, 3), (8e-6, 8e-6)), (3, 2), (5, 4))
    transform = method(geometry, torch.complex128)
    x = torch.from_numpy(random_field((2, 3))).requires_grad_()
    y = torch.from_numpy(random_field((3, 2))).requires_grad_()
    assert torch.autograd.gradcheck(transform, (x,))
    assert torch.autograd.gradcheck(transform.adjoint, (y,))


@pytest.mark.parametrize("method", [MatrixTransform, ChirpTransform])
def test_single_precision_holds_on_a_long_line(method):
    """2,236 panel pixels reach phases of hundreds of waves; the direct sum judges."""
    geometry = Geometry(Plane((1, 2236), (8e-6, 8e-6)), Plane((1, 512), (3.45e-6, 3.45e-6)), SCALE)
    rng = np.random.default_rng(3)
    field = np.exp(2j * np.pi * rng.random((1, 2236)))
    truth = direct_transform(field, geometry.pupil, geometry.image, SCALE)
    value = method(geometry, torch.complex64)(torch.from_numpy(field))
    assert relative(value.numpy(), truth) <= 1e-6


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize("method", [MatrixTransform, ChirpTransform])
def test_a_window_far_off_axis_keeps_its_precision(method, dtype, bound):
    """A centre 60 mm off the axis turns phases by thousands of waves."""
    geometry = Geometry(
        Plane((12, 9), (8e-4, 8e-4), (5e-3, 0.0)),
        Plane((7, 8), (3e-6, 3e-6), (60e-3, -55e-3)),
        SCALE,
    )
    field = random_field(geometry.pupil.shape, 4)
    truth = direct_transform(field, geometry.pupil, geometry.image, SCALE)
    value = method(geometry, dtype)(torch.from_numpy(field))
    # Coordinates themselves are rounded at 1e-16 of thousands of waves.
    assert relative(value.numpy(), truth) <= max(bound, 1e-10)


def test_all_valid_transforms_are_offered_and_agree():
    for geometry in ON_FFT_GRID.values():
        found = transforms(geometry, torch.complex128)
        assert {type(t) for t in found} == set(METHODS)
    found = transforms(ANY_GRID["anywhere"], torch.complex128)
    assert {type(t) for t in found} == {MatrixTransform, ChirpTransform}


def test_the_pruned_fft_refuses_a_grid_that_is_not_its_own():
    with pytest.raises(ValueError, match="no padded length; use the chirp-Z"):
        PrunedTransform(ANY_GRID["anywhere"], torch.complex64)


def test_a_grid_that_almost_fits_an_fft_is_not_taken_for_one():
    """A padded length of 16.0005 is no 16: the last sample would be off by a percent of a turn."""
    pupil = Plane((8, 8), (8e-6, 8e-6))
    pitch = SCALE / (16.0005 * 8e-6)
    geometry = Geometry(pupil, Plane((16, 16), (pitch, pitch)), SCALE)
    field = random_field((8, 8))
    truth = direct_transform(field, pupil, geometry.image, SCALE)
    for transform in transforms(geometry, torch.complex128):
        assert relative(transform(torch.from_numpy(field)).numpy(), truth) <= 1e-11


def test_the_pruned_fft_refuses_a_length_shorter_than_the_window():
    geometry = padded(Plane((6, 6), (8e-6, 8e-6)), (9, 9), (8, 8))
    with pytest.raises(ValueError, match="no padded length"):
        PrunedTransform(geometry, torch.complex64)


def test_the_plan_is_the_cheapest_that_fits_the_memory():
    geometry = Geometry(Plane((1080, 1920), (8e-6, 8e-6)), Plane((2, 2), (3.45e-6, 3.45e-6)), SCALE)
    assert isinstance(plan_transform(geometry), MatrixTransform)


def test_without_memory_the_plan_names_what_it_needs():
    geometry = Geometry(
        Plane((1080, 1920), (8e-6, 8e-6)), Plane((512, 512), (3.45e-6, 3.45e-6)), SCALE
    )
    least = min(t.bytes for t in transforms(geometry, torch.complex64))
    with pytest.raises(ToleranceError, match=rf"needs {least / 1e6:.0f} MB at least and 1 MB"):
        plan_transform(geometry, budget=Budget(memory=1_000_000))
    assert plan_transform(geometry, budget=Budget(memory=least)).bytes == least


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_not_positive_is_refused(scale):
    plane = Plane((2, 2), (1.0, 1.0))
    with pytest.raises(ValueError, match=r"scale .* must be positive"):
        Geometry(plane, plane, scale)


@pytest.mark.parametrize("method", METHODS)
def test_a_field_of_another_shape_is_refused(method):
    """(6, 1) would broadcast silently."""
    transform = method(ON_FFT_GRID["even"], torch.complex64)
    with pytest.raises(ValueError, match=r"field is \(6, 1\).*\(6, 8\)"):
        transform(torch.ones(6, 1))
    with pytest.raises(ValueError, match=r"field is \(1, 10\).*\(4, 10\)"):
        transform.adjoint(torch.ones(1, 10))


def test_a_transform_can_be_named_and_an_unknown_one_is_refused():
    plane = Plane((8, 8), (1e-3, 1e-3))
    geometry = Geometry(plane, Plane((4, 4), (1e-5, 1e-5)), 1e-7)
    for name in ("matrix DFT", "chirp-Z"):
        assert plan_transform(geometry, method=name).name == name
    with pytest.raises(ValueError, match=r"method is 'magic'; for a transform .* choose one of"):
        plan_transform(geometry, method="magic")
