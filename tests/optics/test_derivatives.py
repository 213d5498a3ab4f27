"""Derivatives of periodic pictures against their adjoints, spectra and a known polynomial."""

import math

import pytest
import torch

from optics.inverse.priors import CURVATURE, GRADIENT

SHAPES = [(6, 7), (5, 5), (1, 8), (9, 2)]


def numbers(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def derivative_of(derivative, x):
    parts = [torch.zeros_like(x) for _ in range(derivative.parts)]
    derivative.add(x, parts)
    return parts


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("derivative", [GRADIENT, CURVATURE])
def test_the_adjoint_and_the_spectrum_are_the_derivatives_own(derivative, shape):
    x, d = numbers(3, *shape), [numbers(3, *shape, seed=k + 1) for k in range(derivative.parts)]
    there = sum(float((a * b).sum()) for a, b in zip(derivative_of(derivative, x), d, strict=True))
    back = derivative.adjoint(d, torch.empty_like(x))
    assert there == pytest.approx(float((x * back).sum()))
    twice = derivative.adjoint(derivative_of(derivative, x), torch.empty_like(x))
    square = torch.fft.irfft2(torch.fft.rfft2(x) * derivative.gram_spectrum(shape), s=shape)
    assert torch.allclose(twice, square)


def test_derivatives_of_a_polynomial_are_known():
    """Of (y² + 3 x y) / 2, inside: 1 down twice, 0 along twice, and 3/2 across, twice counted."""
    y, x = torch.meshgrid(torch.arange(6.0), torch.arange(7.0), indexing="ij")
    polynomial = ((y**2 + 3 * y * x) / 2)[None]
    bent = [float(part[0, 2, 3]) for part in derivative_of(CURVATURE, polynomial)]
    assert bent == pytest.approx([1.0, 0.0, 1.5 * math.sqrt(2)])
    steep = [float(part[0, 2, 3]) for part in derivative_of(GRADIENT, polynomial)]
    assert steep == pytest.approx([(5 + 9) / 2, 3.0])


def test_what_is_added_comes_on_top():
    x = numbers(1, 4, 5)
    parts = [torch.ones_like(x) for _ in range(2)]
    GRADIENT.add(x, parts)
    assert torch.allclose(parts[1], 1 + x.roll(-1, -1) - x)
