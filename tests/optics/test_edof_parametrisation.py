"""Parametrisations of patterns against loops, dense splines and finite differences."""

import math

import numpy as np
import pytest
import torch
from scipy.interpolate import make_lsq_spline

from optics.camera import Panel
from optics.edof.parametrisation import (
    PARAMETRISATIONS,
    FreePhase,
    QuarterPhase,
    RadialPhase,
    SeparablePhase,
    SumOfParts,
    depth_of_field_parts,
    make_parametrisation,
)
from optics.patterns import fresnel_lens, multi_focus_rings

SHAPES = [(10, 12), (11, 12), (10, 13), (11, 13)]
COUNTS = {
    "free": lambda rows, columns: rows * columns,
    "quarter": lambda rows, columns: math.ceil(rows / 2) * math.ceil(columns / 2),
    "radial": lambda rows, columns: math.ceil(math.hypot(rows, columns) / 2),
    "separable": lambda rows, columns: rows + columns,
    "separable-mirrored": lambda rows, columns: math.ceil(rows / 2) + math.ceil(columns / 2),
}
EVERY = pytest.mark.parametrize("name", PARAMETRISATIONS)
ANY_SHAPE = pytest.mark.parametrize("shape", SHAPES)


def parts(shape: tuple[int, int]) -> SumOfParts:
    """A plane wave along each axis, and a bump: not mirrored."""
    y, x = np.indices(shape) / 10.0
    return SumOfParts({k: torch.from_numpy(v) for k, v in (("y", y), ("x", x), ("b", y * x**2))})


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def radii(shape: tuple[int, int]) -> np.ndarray:
    """From the centre of the pixels, in pixels."""
    y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    return np.hypot(y[:, None], x)


@EVERY
@ANY_SHAPE
def test_the_number_of_parameters_is_that_of_the_kind(name, shape):
    kind = make_parametrisation(name, shape)
    assert kind.count == COUNTS[name](*shape)
    assert kind.phase(random(kind.count)).shape == shape


@EVERY
@ANY_SHAPE
def test_the_phase_is_linear_in_the_parameters(name, shape):
    kind = make_parametrisation(name, shape)
    one, other = random(kind.count), random(kind.count, seed=1)
    assert torch.allclose(
        kind.phase(2 * one - 3 * other), 2 * kind.phase(one) - 3 * kind.phase(other), atol=1e-12
    )
    assert not kind.phase(torch.zeros(kind.count, dtype=torch.float64)).any()


@EVERY
@ANY_SHAPE
def test_the_gradient_is_the_adjoint_of_the_phase(name, shape):
    """Against the matrix, column by column; and of a sum of cosines by finite differences."""
    kind = make_parametrisation(name, shape)
    columns = [kind.phase(one).reshape(-1) for one in torch.eye(kind.count, dtype=torch.float64)]
    weights = random(*shape)
    at = random(kind.count, seed=2).requires_grad_()
    (kind.phase(at) * weights).sum().backward()
    assert torch.allclose(at.grad, torch.stack(columns) @ weights.reshape(-1), atol=1e-12)
    assert torch.autograd.gradcheck(lambda one: torch.cos(kind.phase(one)).sum(), at)


def test_the_gradient_of_parts_is_that_of_finite_differences():
    at = random(3).requires_grad_()
    assert torch.autograd.gradcheck(lambda one: torch.sin(parts((6, 8)).phase(one)).sum(), at)


@pytest.mark.parametrize("name", ["quarter", "radial", "separable-mirrored"])
@ANY_SHAPE
def test_mirrored_kinds_equal_their_mirror_images_bit_for_bit(name, shape):
    kind = make_parametrisation(name, shape)
    phase = kind.phase(random(kind.count))
    assert kind.mirrored
    assert torch.equal(phase, phase.flip(0))
    assert torch.equal(phase, phase.flip(1))
    quarter = kind.quarter_phase(random(kind.count))
    assert torch.equal(quarter, phase[shape[0] // 2 :, shape[1] // 2 :])


@pytest.mark.parametrize("kind", [FreePhase((6, 8)), SeparablePhase((6, 8)), parts((6, 8))])
def test_kinds_that_are_not_mirrored_have_no_quarter(kind):
    assert not kind.mirrored
    with pytest.raises(ValueError, match=r"doesn't mirror .* take phase\(\)"):
        kind.quarter_phase(random(kind.count))


@EVERY
@ANY_SHAPE
def test_the_short_form_is_that_of_the_symmetry(name, shape):
    kind = make_parametrisation(name, shape)
    at = random(kind.count)
    short, phase = kind.symmetric_phase(at).numpy(), kind.phase(at).numpy()
    if kind.symmetry == "separable":
        rows = short[: shape[0]]
        truth = np.add.outer(rows, short[shape[0] :])
    elif kind.symmetry == "quarter":
        down, right = (np.floor(abs(np.arange(n) - (n - 1) / 2)).astype(int) for n in shape)
        truth = short[np.ix_(down, right)]
    else:
        truth = short
    assert np.array_equal(phase, truth)


@EVERY
@ANY_SHAPE
def test_a_fit_finds_the_phase_that_the_parameters_make(name, shape):
    kind = make_parametrisation(name, shape)
    phase = kind.phase(random(kind.count))
    again = kind.fit(phase)
    assert again.shape == (kind.count,)
    assert torch.allclose(kind.phase(again), phase, atol=1e-6)


@pytest.mark.parametrize(
    "kind", [FreePhase((7, 8)), QuarterPhase((7, 8)), RadialPhase((60, 81), 20), parts((7, 8))]
)
def test_a_fit_finds_the_parameters_where_pixels_decide_them(kind):
    parameters = random(kind.count)
    assert torch.allclose(kind.fit(kind.phase(parameters)), parameters, atol=1e-9)


@pytest.mark.parametrize(
    "kind",
    [
        QuarterPhase((7, 8)),
        RadialPhase((7, 8), 4),
        SeparablePhase((7, 8)),
        SeparablePhase((7, 8), (False, True)),
        SeparablePhase((7, 8), (True, True)),
        parts((7, 8)),
    ],
)
def test_a_fit_has_the_least_squares(kind):
    """Against NumPy's solution with the dense matrix."""
    matrix = np.stack(
        [kind.phase(one).reshape(-1).numpy() for one in torch.eye(kind.count, dtype=torch.float64)]
    ).T
    phase = random(7, 8)
    best = matrix @ np.linalg.lstsq(matrix, phase.reshape(-1).numpy(), rcond=None)[0]
    found = kind.phase(kind.fit(phase)).reshape(-1).numpy()
    assert np.allclose(found, best, atol=1e-8)


def test_a_radial_phase_is_the_spline_of_scipy():
    """A smooth round phase, fitted by SciPy's least squares in one dimension."""
    shape, values = (90, 121), 12
    r = radii(shape)
    corner = math.hypot(*shape) / 2
    phase = np.cos(4 * (r / corner) ** 2)
    order = np.argsort(r, axis=None)
    knots = np.concatenate([np.zeros(3), np.linspace(0, corner, values - 2), np.full(3, corner)])
    spline = make_lsq_spline(r.ravel()[order], phase.ravel()[order], knots, 3)
    kind = RadialPhase(shape, values)
    parameters = kind.fit(torch.from_numpy(phase))
    assert np.allclose(parameters.numpy(), spline.c, atol=1e-7)
    assert np.allclose(kind.phase(parameters).numpy(), spline(r), atol=1e-7)


def test_a_radial_phase_holds_a_lens():
    """Its phase goes as the square of the radius, which a cubic spline has exactly."""
    panel = Panel(shape=(90, 120), pitch=40e-6)
    lens = fresnel_lens(panel, 0.5, 520e-9, (-20e-6, -20e-6))
    kind = RadialPhase(panel.shape)
    assert float((kind.phase(kind.fit(lens)) - lens).abs().max()) < 1e-6 * float(lens.abs().max())


def test_a_value_a_pixel_of_radius_holds_rings_that_jump():
    """The share of the light in step with the rings, by the mean over the pixels."""
    panel = Panel(shape=(180, 320), pitch=48e-6)
    rings = multi_focus_rings(panel, (0.6, 0.3, 0.0), 520e-9, 12)

    def share(values: int | None) -> float:
        kind = RadialPhase(panel.shape, values)
        error = kind.phase(kind.fit(rings)) - rings
        return float(torch.exp(1j * error).mean().abs() ** 2)

    assert share(20) < share(None) < share(800)
    assert share(None) > 0.98


@EVERY
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_types_stay_and_arrays_become_arrays(name, dtype):
    kind = make_parametrisation(name, (6, 9))
    parameters = random(kind.count).to(dtype)
    phase = kind.phase(parameters)
    assert phase.dtype == dtype
    assert kind.fit(phase).dtype == dtype
    array = kind.phase(parameters.numpy())
    assert isinstance(array, np.ndarray)
    assert np.array_equal(array, phase.numpy())
    assert isinstance(kind.fit(array), np.ndarray)


def test_parts_of_a_depth_of_field_make_a_pattern_with_their_weights():
    panel = Panel(shape=(96, 129), pitch=60e-6)
    found = depth_of_field_parts(panel, 0.6, 0.1, 520e-9)
    kind = SumOfParts(found)
    assert kind.names == ("lens", "quartic", "focal-sweep", "multi-focus", "cubic")
    assert kind.symmetry == "none"
    weights = torch.tensor([0.3, -1.0, 0.5, 0.25, 2.0], dtype=torch.float64)
    truth = sum(
        float(weight) * found[name] for name, weight in zip(kind.names, weights, strict=True)
    )
    assert torch.allclose(kind.phase(weights), truth)
    lens = fresnel_lens(panel, 1.0, 520e-9, (-30e-6, 0.0))
    assert torch.allclose(found["lens"], lens)
    assert found["quartic"].max() == pytest.approx(2 * math.pi)


def test_parts_that_are_all_mirrored_make_a_mirrored_pattern():
    panel = Panel(shape=(96, 129), pitch=60e-6)
    found = depth_of_field_parts(panel, 0.6, 0.1, 520e-9)
    del found["cubic"]
    kind = SumOfParts(found)
    assert kind.symmetry == "quarter"
    weights = random(4)
    assert torch.equal(kind.phase(weights), kind.phase(weights).flip(1))
    assert torch.allclose(kind.fit(kind.phase(weights)), weights, atol=1e-9)


ONES = torch.ones(4, 5)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda: make_parametrisation("round", (4, 5)), "name is 'round'; choose free, quarter"),
        (lambda: FreePhase((0, 5)), r"shape \(0, 5\) must be at least 1"),
        (lambda: QuarterPhase((4, 5, 6)), r"shape is \(4, 5, 6\); give \(rows, columns\)"),
        (lambda: RadialPhase((4, 5), 3), "values is 3; choose 4 to 6"),
        (lambda: RadialPhase((4, 5), 7), "values is 7; choose 4 to 6"),
        (
            lambda: QuarterPhase((4, 5)).phase(torch.zeros(7)),
            r"parameters is \(7,\); quarter has \(6,\) for a panel of 5 x 4 pixels",
        ),
        (lambda: FreePhase((4, 5)).fit(torch.zeros(5, 4)), r"phase is \(5, 4\) pixels; the panel"),
        (lambda: FreePhase((4, 5)).fit(ONES * math.nan), "phase has 20 NaN or infinite values"),
        (lambda: SumOfParts({}), "parts is empty"),
        (lambda: SumOfParts({"a": ONES, "b": ONES.T}), r"part b is \(5, 4\) pixels and a \(4, 5\)"),
        (lambda: SumOfParts({"a": ONES * math.inf}), "part a has 20 NaN or infinite values"),
        (lambda: SumOfParts({"a": ONES, "b": 2 * ONES}), "part b is zero or a sum of the parts"),
        (lambda: SumOfParts({"a": 0 * ONES}), "part a is zero"),
        (
            lambda: SumOfParts({"a": torch.ones(1, 1), "b": torch.ones(1, 1)}),
            "parts has 2 patterns of 1 pixels",
        ),
        (lambda: depth_of_field_parts(Panel(), 0.0, 1.0, 520e-9), "near is 0 dioptres"),
    ],
)
def test_what_cannot_be_is_refused_by_name(ask, words):
    with pytest.raises(ValueError, match=words):
        ask()


def test_anything_but_numbers_is_refused():
    with pytest.raises(TypeError, match="parameters is a list"):
        FreePhase((1, 2)).phase([1.0, 2.0])
