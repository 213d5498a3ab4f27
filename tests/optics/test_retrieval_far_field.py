"""The pruned transform between panel and window, against direct sums and whole FFTs."""

import numpy as np
import pytest
import torch
from judges import relative
from judges.retrieval import direct_sums, sums_back, whole_far_field, window_of

from optics.retrieval import far_field as module
from optics.retrieval.far_field import FarField, unit_modulus

# Odd and even, landscape and portrait, lengths that no side divides, windows as wide as they.
GRIDS = [
    ((5, 8), 16, (6, 7)),
    ((8, 5), 15, (15, 4)),
    ((7, 6), 25, (1, 1)),
    ((1, 9), 9, (1, 9)),
    ((12, 13), 27, (26, 27)),
    ((1, 1), 2, (2, 1)),
]
TOLS = {torch.complex64: 1e-6, torch.complex128: 1e-14}


def random(shape, dtype, seed=0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    return torch.from_numpy(values).to(dtype)


@pytest.mark.parametrize("dtype", TOLS)
@pytest.mark.parametrize(("shape", "length", "window"), GRIDS)
def test_there_and_back_are_direct_sums(shape, length, window, dtype):
    far_field = FarField(shape, length, window)
    field, image = random(shape, dtype), random(window, dtype, 1)
    there, back = far_field.forward(field), far_field.adjoint(image)
    assert there.dtype == back.dtype == dtype
    assert relative(there, direct_sums(field.numpy(), length, window)) < TOLS[dtype]
    y, x = (np.arange(n) for n in shape)
    assert relative(back, sums_back(image.numpy(), length, y, x)) < TOLS[dtype]


@pytest.mark.parametrize(("shape", "length", "window"), GRIDS)
def test_back_is_the_adjoint(shape, length, window):
    """<A f, g> = <f, A* g>."""
    far_field = FarField(shape, length, window)
    field, image = random(shape, torch.complex128), random(window, torch.complex128, 1)
    left = torch.vdot(far_field.forward(field).flatten(), image.flatten())
    right = torch.vdot(field.flatten(), far_field.adjoint(image).flatten())
    assert abs(left - right) < 1e-13 * float(field.norm() * image.norm()) * length


@pytest.mark.parametrize("dtype", TOLS)
@pytest.mark.parametrize("at_a_time", [1, 50, 1 << 17])
@pytest.mark.parametrize(("shape", "length", "window"), GRIDS)
def test_a_bounce_is_the_panel_between_two_transforms(
    shape, length, window, at_a_time, dtype, monkeypatch
):
    """By direct sums; in blocks of any number of rows; over batches; with light that is uneven."""
    monkeypatch.setattr(module, "_AT_A_TIME", at_a_time)
    far_field = FarField(shape, length, window)
    images = random((2, 3, *window), dtype)
    uneven = torch.from_numpy(np.random.default_rng(2).uniform(0.2, 1, shape)).to(torch.float32)
    y, x = (np.arange(n) for n in shape)
    for amplitude in (None, uneven):
        bounced = far_field.round_trip(images, amplitude)
        assert bounced.shape == images.shape
        assert bounced.dtype == dtype
        for index in np.ndindex(2, 3):
            panel = sums_back(images[index].numpy(), length, y, x)
            panel = panel / np.abs(panel) * (1 if amplitude is None else amplitude.numpy())
            truth = direct_sums(panel, length, window)
            # Where the panel's field almost vanishes, its direction is less well known.
            assert relative(bounced[index], truth) < 100 * TOLS[dtype]


def test_batches_are_transformed_one_by_one():
    far_field = FarField((6, 7), 16, (5, 4))
    fields, images = (random((2, 3, *s), torch.complex64) for s in ((6, 7), (5, 4)))
    there, back = far_field.forward(fields), far_field.adjoint(images)
    for index in np.ndindex(2, 3):
        assert relative(there[index], far_field.forward(fields[index])) < 1e-6
        assert relative(back[index], far_field.adjoint(images[index])) < 1e-6


@pytest.mark.parametrize(("shape", "length"), [((9, 6), 18), ((5, 8), 15)])
def test_all_light_arrives_somewhere(shape, length):
    """Parseval: length² times the field's; a window gets the same light as in a whole FFT."""
    field = random(shape, torch.complex128)
    total = length**2 * float((field.abs() ** 2).sum())
    light = FarField(shape, length, (length, length)).intensity(field)
    assert float(light.sum()) == pytest.approx(total, rel=1e-13)
    window = (7, 4)
    seen = FarField(shape, length, window).intensity(field)
    whole = np.abs(whole_far_field(field.numpy(), length)) ** 2
    assert relative(seen, window_of(whole, window)) < 1e-13


def test_the_work_is_counted_in_samples_of_ffts(monkeypatch):
    """What a bounce really transforms, against what it says."""
    counted = []

    def counting(x, length, *args, **options):
        counted.append(x.numel() // x.shape[-1] * length)
        return fft(x, length, *args, **options)

    fft = module.fft
    monkeypatch.setattr(module, "fft", counting)
    far_field = FarField((40, 30), 96, (20, 24))
    far_field.round_trip(random((20, 24), torch.complex64))
    assert sum(counted) == far_field.samples


def test_derivatives_pass_through():
    far_field = FarField((4, 5), 12, (5, 3))
    field = random((4, 5), torch.complex128).requires_grad_()
    assert torch.autograd.gradcheck(far_field.forward, (field,))
    assert torch.autograd.gradcheck(far_field.intensity, (field,))
    image = random((5, 3), torch.complex128).requires_grad_()
    assert torch.autograd.gradcheck(far_field.adjoint, (image,))


def test_a_field_of_zero_stays_and_has_finite_derivatives():
    far_field = FarField((4, 5), 12, (5, 3))
    for dtype in TOLS:
        assert not far_field.round_trip(torch.zeros(5, 3, dtype=dtype)).any()
    field = torch.zeros(4, 5, dtype=torch.complex64, requires_grad=True)
    (far_field.intensity(field).sum() + unit_modulus(field).abs().sum()).backward()
    assert torch.isfinite(torch.view_as_real(field.grad)).all()


@pytest.mark.parametrize(
    ("shape", "window"), [((5, 8), (3, 9)), ((9, 2), (3, 3)), ((2, 2), (9, 1))]
)
def test_a_length_that_holds_too_little_is_refused(shape, window):
    with pytest.raises(ValueError, match=r"length is 8; it must hold \(\d, \d\) and \(\d, \d\)"):
        FarField(shape, 8, window)
