"""Every operator keeps the laws of the contract; each is what its formula says, written out."""

import math

import numpy as np
import pytest
import torch

from optics.inverse import (
    Blur,
    CentredCrop,
    Mask,
    OperatorProduct,
    OperatorSum,
    SpectralMosaic,
    VaryingBlur,
    blur_operator,
    blur_shape,
    field_weights,
    filter_weights,
    layer_weights,
)

SIZES = [(8, 8), (9, 7), (12, 5), (7, 10)]


def numbers(*shape, seed=0):
    return torch.from_numpy(np.random.default_rng([seed, *shape]).standard_normal(shape))


def spread(*shape):
    psf = numbers(*shape, seed=1).abs()
    return psf / psf.sum((-2, -1), keepdim=True)


def operators(shape, dtype=torch.float64):
    """One of each kind, and some chains and sums."""
    rows, columns = shape
    psf, bands = spread(5, 4).to(dtype), spread(3, 4, 3).to(dtype)
    weights = numbers(3, rows, columns, seed=2).abs().to(dtype)
    blur = Blur(psf, shape)
    return {
        "blur": blur,
        "a PSF larger than the picture": Blur(spread(17, 20).to(dtype), shape),
        "a PSF for each band": Blur(bands, shape),
        "window": CentredCrop((rows + 3, columns + 2), shape),
        "mask": Mask((weights[0] > 0.5).to(dtype)),
        "unknown border": blur_operator(psf, shape, "unknown"),
        "dark border": blur_operator(psf, shape, "dark"),
        "bands, unknown border": blur_operator(bands, shape, "unknown"),
        "field": VaryingBlur(bands, weights),
        "mosaic": SpectralMosaic(weights),
        "bands blurred, then through a mosaic": SpectralMosaic(weights) @ Blur(bands, shape),
        "two blurs": Blur(spread(4, 3).to(dtype), shape) @ blur,
        "sum of blurs": blur + Blur(spread(4, 3).to(dtype), shape),
        "two masks": Mask(weights[0]) @ Mask(weights[1]),
        "masked bands through a mosaic": SpectralMosaic(weights) @ Mask(weights.flip(0)),
        "window on bands, then a mosaic": (
            SpectralMosaic(weights) @ CentredCrop((rows + 3, columns + 2), shape, (3,))
        ),
        "sum": blur + Mask(weights[0]),
        "transpose": (Mask(weights[1]) @ blur).T,
        "dead pixels of a sum": Mask(weights[0] > 0.3) @ (blur + VaryingBlur(bands, weights)),
    }


NAMES = list(operators((8, 8)))


def matrix(operator):
    """Column by column."""
    size = math.prod(operator.domain)
    unit = torch.eye(size, dtype=torch.float64).reshape(size, *operator.domain)
    return operator(unit).reshape(size, -1).T


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_the_adjoint_is_the_transpose(name, shape):
    a = operators(shape)[name]
    x, y = numbers(*a.domain, seed=3), numbers(*a.codomain, seed=4)
    there, back = float((a(x) * y).sum()), float((x * a.adjoint(y)).sum())
    scale = float(a(x).norm() * y.norm())
    assert abs(there - back) <= 1e-6 * scale
    assert torch.allclose(a.T(y), a.adjoint(y))
    assert torch.allclose(a.T.T(x), a(x))


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_it_is_linear_also_over_a_batch(name, shape):
    a = operators(shape)[name]
    x = numbers(2, *a.domain, seed=5)
    together = a(2 * x[0] - 3 * x[1])
    assert torch.allclose(together, 2 * a(x)[0] - 3 * a(x)[1], atol=1e-5)
    y = numbers(2, *a.codomain, seed=6)
    assert torch.allclose(a.adjoint(y)[1], a.adjoint(y[1]), atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_its_gradient_is_that_of_finite_differences(name):
    a = operators((5, 6))[name]
    x = numbers(*a.domain, seed=7).requires_grad_()
    assert torch.autograd.gradcheck(a, (x,), eps=1e-3, atol=1e-5)
    y = numbers(*a.codomain, seed=8).requires_grad_()
    assert torch.autograd.gradcheck(a.adjoint, (y,), eps=1e-3, atol=1e-5)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_single_precision_agrees_with_double(name, shape):
    a, b = operators(shape, torch.float32)[name], operators(shape)[name]
    x = numbers(*a.domain, seed=9)
    single = a(x.float())
    assert single.dtype == torch.float32
    assert float((single - b(x)).norm()) <= 1e-6 * float(b(x).norm())
    found = a(x.float().numpy())
    assert isinstance(found, np.ndarray)
    assert np.array_equal(found, single.numpy())


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_norm_and_gram_are_those_of_the_matrix(name, shape):
    a = operators(shape)[name]
    m = matrix(a)
    assert a.norm() == pytest.approx(float(torch.linalg.matrix_norm(m, 2)), rel=2e-2)
    assert a.bytes >= 0
    if a.gram is None:
        return
    x = numbers(*a.domain, seed=10)
    dense = (m.T @ m).reshape(math.prod(a.domain), -1)
    assert torch.allclose(a.gram(x).flatten(), dense @ x.flatten(), atol=1e-5)
    solved = torch.linalg.solve(dense + 0.3 * torch.eye(len(dense)).double(), x.flatten())
    assert torch.allclose(a.gram.inverse(0.3)(x).flatten(), solved, atol=1e-4)
    with pytest.raises(ValueError, match="penalty is 0"):
        a.gram.inverse(0.0)


@pytest.mark.parametrize("name", [
    "two blurs", "sum of blurs", "two masks", "masked bands through a mosaic",
    "window on bands, then a mosaic",
])  # fmt: skip
def test_products_and_sums_have_a_gram_where_there_is_one(name):
    assert operators((8, 8))[name].gram is not None


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("name", ["a PSF for each band", "mosaic"])
def test_a_gram_is_inverted_with_a_penalty_for_each_band_and_frequency(name, shape):
    """The solution times the matrix, written out, is the right-hand side again."""
    a = operators(shape)[name]
    x = numbers(*a.domain, seed=12)
    each = 0.2 + numbers(3, 1, 1, seed=13).abs()
    found = a.gram.inverse(each)(x)
    assert torch.allclose(a.adjoint(a(found)) + each * found, x, atol=1e-5)
    if name == "mosaic":
        return
    steep = 0.2 + numbers(3, shape[0], shape[1] // 2 + 1, seed=14).abs()
    # Conjugate frequencies of a real picture have the same penalty.
    steep[:, 1:, [0, -1]] = (steep + steep.roll(-1, 1).flip(1))[:, 1:, [0, -1]] / 2
    found = a.gram.inverse(steep)(x)
    penalty = torch.fft.irfft2(torch.fft.rfft2(found) * steep, s=shape)
    assert torch.allclose(a.adjoint(a(found)) + penalty, x, atol=1e-5)


@pytest.mark.parametrize("border", ["unknown", "dark", "periodic"])
@pytest.mark.parametrize("kernel", [(3, 3), (4, 5), (1, 6)])
def test_a_blur_is_the_sum_over_the_psf_written_out(border, kernel):
    frame = (6, 7)
    psf, a = spread(*kernel), blur_operator(spread(*kernel), frame, border)
    x = numbers(*a.domain, seed=11)
    rows, columns = a.domain
    top, left = (n // 2 - m // 2 for n, m in zip(a.domain, frame, strict=True))
    expected = torch.zeros(frame, dtype=torch.float64)
    for i in range(frame[0]):
        for j in range(frame[1]):
            for k in range(kernel[0]):
                for m in range(kernel[1]):
                    y = i + top - (k - kernel[0] // 2)
                    z = j + left - (m - kernel[1] // 2)
                    inside = 0 <= y < rows and 0 <= z < columns
                    if border != "dark" or inside:
                        expected[i, j] += psf[k, m] * x[y % rows, z % columns]
    assert torch.allclose(a(x), expected, atol=1e-12)


def test_no_light_comes_into_a_frame_from_its_opposite_side():
    """A point in the outermost place from which light gets to the frame, on either side."""
    for frame, kernel in [((6, 6), (3, 3)), ((7, 8), (4, 5))]:
        a = blur_operator(torch.ones(kernel, dtype=torch.float64), frame, "unknown")
        whole = blur_shape(frame, kernel)
        for edge in (0, -1):
            x = torch.zeros(whole, dtype=torch.float64)
            x[edge] = 1
            far = a(x)[kernel[0] :] if edge == 0 else a(x)[: -kernel[0]]
            assert float(far.abs().max()) <= 1e-9


def test_a_psf_larger_than_the_picture_winds_around_it():
    psf = spread(11, 9)
    small = Blur(psf, (4, 6))
    x = numbers(4, 6, seed=12)
    tiled = Blur(psf, (12, 12))(x.repeat(3, 2))[4:8, :6]
    assert torch.allclose(small(x), tiled, atol=1e-12)


def test_where_all_psfs_are_one_the_field_doesnt_matter():
    psf = spread(5, 5)
    weights = field_weights((9, 12), (0.0, 8.0), (1.0, 5.0, 11.0))
    varying = VaryingBlur(psf.expand(6, 5, 5), weights.double())
    x = numbers(9, 12, seed=13)
    assert torch.allclose(varying(x), Blur(psf, (9, 12))(x), atol=1e-6)


def test_a_point_is_spread_by_the_psf_of_its_place():
    """Also halfway between two places, by the mean of theirs."""
    psfs = spread(2, 3, 3)
    weights = field_weights((9, 9), (4.0,), (0.0, 8.0)).double()
    for column, share in ((0, 0.0), (4, 0.5), (8, 1.0)):
        x = torch.zeros(9, 9, dtype=torch.float64)
        x[4, column] = 1
        seen = VaryingBlur(psfs, weights)(x).roll(4 - column, 1)[3:6, 3:6]
        assert torch.allclose(seen, (1 - share) * psfs[0] + share * psfs[1], atol=1e-7)


def test_field_weights_add_up_to_one_everywhere_and_are_never_negative():
    weights = field_weights((20, 31), (3.0, 4.0, 17.5), (-5.0, 12.0))
    assert weights.shape == (6, 20, 31)
    assert torch.allclose(weights.sum(0), torch.ones(20, 31), atol=1e-6)
    assert float(weights.min()) >= 0


def test_layers_are_told_apart():
    layers = np.array([[0, 1], [2, 1]])
    assert layer_weights(layers, 3).argmax(0).tolist() == layers.tolist()
    assert layer_weights(layers, 3).sum(0).tolist() == [[1, 1], [1, 1]]
    with pytest.raises(ValueError, match="from 0 to 2; with 2"):
        layer_weights(layers, 2)
    with pytest.raises(ValueError, match="fractions"):
        layer_weights(np.array([[0.5]]), 2)


def test_each_pixel_sees_the_bands_through_its_own_filter():
    response = np.array([[0.9, 0.1], [0.3, 0.5], [0.0, 0.7]])
    weights = filter_weights(("RG", "GB"), response, "RGB", (3, 4))
    assert weights[:, 0, 0].tolist() == response[0].tolist()
    assert weights[:, 0, 3].tolist() == response[1].tolist()
    assert weights[:, 1, 1].tolist() == response[2].tolist()
    assert weights[:, 2, 2].tolist() == response[0].tolist()
    with pytest.raises(ValueError, match="pattern has W"):
        filter_weights(("RW",), response, "RGB", (3, 4))


@pytest.mark.parametrize(("make", "words"), [
    (lambda: Blur(torch.full((3, 3), math.nan), (8, 8)), "psf"),
    (lambda: blur_operator(torch.ones(3, 3), (8, 8), "mirror"), "border is 'mirror'"),
    (lambda: Blur(torch.ones(3, 3), (8, 8))(torch.ones(8, 9)), r"x is \(8, 9\)"),
    (lambda: Blur(torch.ones(3, 3), (8, 8)).adjoint(torch.ones(7, 8)), r"y is \(7, 8\)"),
    (lambda: CentredCrop((8, 8), (9, 8)), "no larger"),
    (lambda: Mask(torch.tensor([[math.inf]])), "weights"),
    (lambda: VaryingBlur(torch.ones(2, 3, 3), torch.ones(3, 8, 8)), "as many"),
    (lambda: SpectralMosaic(torch.ones(8, 8)), "bands"),
    (lambda: OperatorProduct(), "empty"),
    (lambda: OperatorSum(), "empty"),
    (lambda: OperatorProduct(*[CentredCrop((9, 9), (8, 8)) for _ in range(2)]), "don't fit"),
    (lambda: OperatorSum(Mask(torch.ones(8, 8)), Mask(torch.ones(8, 9))), "differ"),
    (lambda: field_weights((8, 8), (3.0, 3.0), (1.0,)), "rows are"),
])  # fmt: skip
def test_what_doesnt_fit_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
