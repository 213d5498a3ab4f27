"""Every transform against the sum that it claims to compute, written out in judges.py."""

import numpy as np
import pytest
import torch
from judges import direct_transform, relative
from sweeps import some

from optics.accuracy import Budget, ToleranceError
from optics.fourier import (
    ChirpTransform,
    CommensurateTransform,
    FourierGeometry,
    GriddedTransform,
    MatrixTransform,
    NonuniformTransform,
    fast_fft_length,
    plan_transform,
    valid_transforms,
)
from optics.plane import Plane

SCALE = 550e-9 * 0.125
METHODS = [MatrixTransform, ChirpTransform, CommensurateTransform, GriddedTransform]
PRECISION = [(torch.complex64, 2e-6), (torch.complex128, 1e-11)]


def padded(pupil: Plane, shape: tuple[int, int], lengths: tuple[int, int]) -> FourierGeometry:
    """The geometry of an FFT that is padded to `lengths`."""
    pitch = tuple(SCALE / (n * p) for n, p in zip(lengths, pupil.pitch, strict=True))
    return FourierGeometry(pupil, Plane(shape, pitch), SCALE)


ON_FFT_GRID = {
    "even": padded(Plane((6, 8), (8e-6, 8e-6)), (4, 10), (12, 16)),
    "odd": padded(Plane((7, 9), (8e-6, 5e-6)), (5, 11), (15, 11)),
    "mixed": padded(Plane((6, 9), (8e-6, 5e-6)), (7, 8), (13, 18)),
    "line": padded(Plane((1, 9), (8e-6, 5e-6)), (1, 8), (4, 18)),
    "folded": padded(Plane((16, 19), (8e-6, 5e-6)), (5, 6), (6, 7)),
    "folded thrice, and wider than its period": padded(
        Plane((20, 19), (8e-6, 5e-6)), (9, 10), (6, 7)
    ),
    "off the axis": padded(Plane((6, 9), (8e-6, 5e-6), (1e-4, -3e-4)), (7, 8), (13, 18)),
}
ANY_GRID = {
    **ON_FFT_GRID,
    "anywhere": FourierGeometry(
        Plane((7, 10), (8e-6, 6e-6), (1e-4, -3e-4)),
        Plane((9, 6), (3.45e-6, 5e-6), (2e-3, 1e-3)),
        SCALE,
    ),
    "coarse": FourierGeometry(Plane((8, 5), (4e-4, 3e-4)), Plane((5, 8), (3e-4, 1e-4)), SCALE),
}
CASES = [
    pytest.param(method, geometry, id=f"{method.name}, {name}")
    for method in METHODS
    for name, geometry in (ON_FFT_GRID if method is CommensurateTransform else ANY_GRID).items()
]


def made(method, geometry: FourierGeometry, dtype: torch.dtype):
    """A transform whose own error, if it has one, stays below that of rounding."""
    if method is GriddedTransform:
        return method(geometry, dtype, 1e-7 if dtype == torch.complex64 else 1e-13)
    return method(geometry, dtype)


def random_field(shape, seed=0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_a_transform_equals_the_direct_sum(method, geometry, dtype, bound):
    field = random_field(geometry.pupil.shape)
    truth = direct_transform(field, geometry.pupil, geometry.image, geometry.scale)
    value = made(method, geometry, dtype)(torch.from_numpy(field))
    assert value.dtype == dtype
    assert relative(value.numpy(), truth) <= bound


@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_a_batch_is_transformed_field_by_field(method, geometry):
    fields = random_field((2, 3, *geometry.pupil.shape))
    value = made(method, geometry, torch.complex128)(torch.from_numpy(fields))
    truth = direct_transform(fields[1, 2], geometry.pupil, geometry.image, geometry.scale)
    assert value.shape == (2, 3, *geometry.image.shape)
    assert relative(value[1, 2].numpy(), truth) <= 1e-11


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize(("method", "geometry"), CASES)
def test_the_adjoint_passes_the_dot_test(method, geometry, dtype, bound):
    """<A x, y> = <x, A* y> defines the adjoint."""
    x = torch.from_numpy(random_field(geometry.pupil.shape, 1))
    y = torch.from_numpy(random_field(geometry.image.shape, 2))
    transform = made(method, geometry, dtype)
    left = torch.sum(transform(x).to(torch.complex128).conj() * y)
    right = torch.sum(x.conj() * transform.adjoint(y).to(torch.complex128))
    size = transform(x).norm() * y.norm()
    assert abs(complex(left - right)) <= bound * float(size)


@pytest.mark.parametrize("method", some(METHODS, 1, 3))
def test_gradients_pass_both_ways(method):
    """Finite differences, by torch.autograd.gradcheck."""
    geometry = padded(Plane((2, 3), (8e-6, 8e-6)), (3, 2), (5, 4))
    transform = made(method, geometry, torch.complex128)
    x = torch.from_numpy(random_field((2, 3))).requires_grad_()
    y = torch.from_numpy(random_field((3, 2))).requires_grad_()
    assert torch.autograd.gradcheck(transform, (x,))
    assert torch.autograd.gradcheck(transform.adjoint, (y,))


@pytest.mark.parametrize("method", [MatrixTransform, ChirpTransform, GriddedTransform])
def test_single_precision_holds_on_a_long_line(method):
    """2,236 panel pixels reach phases of hundreds of waves; the direct sum judges."""
    geometry = FourierGeometry(
        Plane((1, 2236), (8e-6, 8e-6)), Plane((1, 512), (3.45e-6, 3.45e-6)), SCALE
    )
    rng = np.random.default_rng(3)
    field = np.exp(2j * np.pi * rng.random((1, 2236)))
    truth = direct_transform(field, geometry.pupil, geometry.image, SCALE)
    value = made(method, geometry, torch.complex64)(torch.from_numpy(field))
    assert relative(value.numpy(), truth) <= 1e-6


@pytest.mark.parametrize(("dtype", "bound"), PRECISION)
@pytest.mark.parametrize("method", [MatrixTransform, ChirpTransform, GriddedTransform])
def test_a_window_far_off_axis_keeps_its_precision(method, dtype, bound):
    """A centre 60 mm off the axis turns phases by thousands of waves."""
    geometry = FourierGeometry(
        Plane((12, 9), (8e-4, 8e-4), (5e-3, 0.0)),
        Plane((7, 8), (3e-6, 3e-6), (60e-3, -55e-3)),
        SCALE,
    )
    field = random_field(geometry.pupil.shape, 4)
    truth = direct_transform(field, geometry.pupil, geometry.image, SCALE)
    value = made(method, geometry, dtype)(torch.from_numpy(field))
    # Coordinates themselves are rounded at 1e-16 of thousands of waves.
    assert relative(value.numpy(), truth) <= max(bound, 1e-10)


def test_all_valid_transforms_are_offered_and_agree():
    for geometry in ON_FFT_GRID.values():
        found = valid_transforms(geometry, torch.complex128, 1e-6)
        assert {type(t) for t in found} == set(METHODS)
    found = valid_transforms(ANY_GRID["anywhere"], torch.complex128)
    assert {type(t) for t in found} == {MatrixTransform, ChirpTransform}


def test_the_fft_refuses_a_grid_that_is_not_its_own():
    with pytest.raises(ValueError, match="isn't a whole number; use the chirp-Z"):
        CommensurateTransform(ANY_GRID["anywhere"], torch.complex64)


def test_a_grid_that_almost_fits_an_fft_is_not_taken_for_one():
    """A padded length of 16.0005 is no 16: the last sample would be off by a percent of a turn."""
    pupil = Plane((8, 8), (8e-6, 8e-6))
    pitch = SCALE / (16.0005 * 8e-6)
    geometry = FourierGeometry(pupil, Plane((16, 16), (pitch, pitch)), SCALE)
    field = random_field((8, 8))
    truth = direct_transform(field, pupil, geometry.image, SCALE)
    for transform in valid_transforms(geometry, torch.complex128):
        assert relative(transform(torch.from_numpy(field)).numpy(), truth) <= 1e-11


def test_the_plan_is_the_cheapest_that_fits_the_memory():
    geometry = FourierGeometry(
        Plane((1080, 1920), (8e-6, 8e-6)), Plane((2, 2), (3.45e-6, 3.45e-6)), SCALE
    )
    assert isinstance(plan_transform(geometry), MatrixTransform)


def test_without_memory_the_plan_names_what_it_needs():
    geometry = FourierGeometry(
        Plane((1080, 1920), (8e-6, 8e-6)), Plane((512, 512), (3.45e-6, 3.45e-6)), SCALE
    )
    least = min(t.bytes for t in valid_transforms(geometry, torch.complex64))
    with pytest.raises(ToleranceError, match=rf"needs {least / 1e6:.0f} MB at least and 1 MB"):
        plan_transform(geometry, budget=Budget(memory=1_000_000))
    assert plan_transform(geometry, budget=Budget(memory=least)).bytes == least


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_that_is_not_positive_is_refused(scale):
    plane = Plane((2, 2), (1.0, 1.0))
    with pytest.raises(ValueError, match=r"scale .* must be positive"):
        FourierGeometry(plane, plane, scale)


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
    geometry = FourierGeometry(plane, Plane((4, 4), (1e-5, 1e-5)), 1e-7)
    for name in ("matrix DFT", "chirp-Z"):
        assert plan_transform(geometry, method=name).name == name
    with pytest.raises(ValueError, match=r"method is 'magic'; for a transform .* choose one of"):
        plan_transform(geometry, method="magic")


@pytest.mark.parametrize("error", [1e-1, 1e-3, 1e-5, 1e-8, 1e-12])
@pytest.mark.parametrize("samples", [(40, 33), (7, 90)])
def test_gridding_keeps_its_error(samples, error):
    geometry = FourierGeometry(
        Plane(samples, (9e-5, 7e-5), (1e-4, 0.0)), Plane((21, 24), (4e-6, 3e-6)), SCALE
    )
    field = random_field(samples)
    truth = direct_transform(field, geometry.pupil, geometry.image, SCALE)
    value = GriddedTransform(geometry, torch.complex128, error)(torch.from_numpy(field))
    assert relative(value.numpy(), truth) <= error


@pytest.mark.parametrize(
    ("error", "few"), [(1e-3, False), (1e-6, False), (1e-12, False), (1e-3, True), (1e-7, True)]
)
@pytest.mark.parametrize("shape", [(12, 9), (1, 8)])
def test_scattered_points_equal_the_direct_sum(shape, error, few):
    rng = np.random.default_rng(5)
    y, x = rng.uniform(-1e-2, 1e-2, (2, 300))
    field = random_field((300,))
    image = Plane(shape, (3e-6, 4e-6), (2e-5, -7e-5))
    v, u = (image.coordinates(axis).numpy() for axis in (0, 1))
    turns = (v[:, None, None] * y + u[None, :, None] * x) / SCALE
    truth = np.sum(field * np.exp(-2j * np.pi * turns), axis=-1)
    transform = NonuniformTransform(
        torch.from_numpy(y), torch.from_numpy(x), image, SCALE, error, few_points=few
    )
    assert relative(transform(torch.from_numpy(field)).numpy(), truth) <= 3 * error
    back = torch.from_numpy(random_field(shape, 6))
    left = torch.sum(transform(torch.from_numpy(field)).conj() * back)
    right = torch.sum(torch.from_numpy(field).conj() * transform.adjoint(back))
    assert abs(complex(left - right)) <= 5 * error * np.linalg.norm(truth) * float(back.norm())


def test_few_points_are_not_for_the_smallest_errors():
    with pytest.raises(ValueError, match=r"error is 1e-10; for few points it is 1e-08 or more"):
        NonuniformTransform(
            *torch.zeros(2, 3), Plane((4, 4), (1.0, 1.0)), 1.0, 1e-10, few_points=True
        )


@pytest.mark.parametrize("kind", ["plane", "points"])
def test_stretch_and_shift_have_the_derivatives_of_the_integral(kind):
    """Against the sum with moved images, by central differences."""
    image = Plane((5, 4), (3e-6, 4e-6), (1e-5, -2e-5))
    pupil = Plane((3, 4), (3e-3, 2e-3), (1e-3, 0.0))
    field = torch.from_numpy(random_field(pupil.shape, 7))
    weight = torch.from_numpy(random_field(image.shape, 8))
    if kind == "plane":
        transform, samples = (
            MatrixTransform(FourierGeometry(pupil, image, SCALE), torch.complex128),
            field,
        )
    else:
        y, x = (p.expand(pupil.shape).ravel() for p in pupil.mesh())
        transform, samples = NonuniformTransform(y, x, image, SCALE, 1e-13), field.ravel()

    def summed(stretch: float, dy: float, dx: float) -> float:
        moved = Plane(image.shape, image.pitch, (image.centre[0] + dy, image.centre[1] + dx))
        value = direct_transform(field.numpy(), pupil, moved, SCALE / stretch)
        return float((weight.numpy().conj() * value).sum().real)

    stretch, dy, dx = (torch.tensor(v, dtype=torch.float64) for v in (1.0, 0.0, 0.0))
    numbers = [number.requires_grad_() for number in (stretch, dy, dx)]
    value = transform(samples, stretch, (dy, dx))
    (weight.conj() * value).sum().real.backward()
    for place, number in enumerate(numbers):
        step = (1e-5, 1e-10, 1e-10)[place]
        at = [1.0, 0.0, 0.0]
        up, down = at.copy(), at.copy()
        up[place] += step
        down[place] -= step
        truth = (summed(*up) - summed(*down)) / (2 * step)
        assert float(number.grad) == pytest.approx(truth, rel=1e-6)


@pytest.mark.parametrize("least", [1, 2, 13, 97, 497, 1055])
def test_a_quick_length_is_no_shorter_little_longer_and_has_small_factors(least):
    length = fast_fft_length(least)
    assert least <= length <= 1.125 * least + 1
    left = length
    for factor in (2, 3, 5, 7, 11):
        while left % factor == 0:
            left //= factor
    assert left == 1 or length == least <= 13


def test_a_power_of_two_is_taken_where_it_is_near():
    assert fast_fft_length(500) == 512
    assert fast_fft_length(1024) == 1024
