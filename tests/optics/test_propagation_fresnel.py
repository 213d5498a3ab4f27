"""Fresnel's integral by matrices, by one transform and by two, against closed forms."""

import itertools
import math
from functools import cache

import numpy as np
import pytest
import torch
from scipy.special import fresnel
from sweeps import some

from optics.accuracy import Budget, MachineSpeed, ToleranceError
from optics.plane import Plane
from optics.propagation.chirped import envelope_error
from optics.propagation.fresnel_matrix import FresnelMatrices, mean_chirp
from optics.propagation.fresnel_steps import SingleFresnel, TwoStepFresnel
from optics.propagation.rayleigh_sommerfeld import DirectQuadrature, upsample, upsample_adjoint
from optics.propagation.span import FreeSpaceSpan

WAVELENGTH = 500e-9
METHODS = (FresnelMatrices, SingleFresnel, TwoStepFresnel)
TOLERANCES = (1e-1, 1e-3, 1e-5, 1e-8)


def random_field(shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(shape, dtype=torch.complex128, generator=generator)


def error_of(answer, expected, span, field):
    """L2 error on the target over the light of the source."""
    wrong = np.sum(np.abs(answer.numpy() - expected) ** 2) * math.prod(span.target.pitch)
    return math.sqrt(wrong / float((field.abs() ** 2).sum() * span.sample_area))


def slit(x, side, scale):
    """What a slit sends along an axis, by scipy's Fresnel integrals (Goodman 4.5.1)."""
    root = math.sqrt(2 / abs(scale))
    low, high = (fresnel(root * (x + sign * side / 2)) for sign in (-1, 1))
    integral = ((high[1] - low[1]) + 1j * (high[0] - low[0])) / math.sqrt(2)
    answer = integral * np.exp(-0.25j * math.pi)
    return answer if scale > 0 else answer.conj()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [0.01, 0.2, -0.03])
def test_a_rectangular_aperture_in_the_near_field(method, distance):
    side = (0.5e-3, 0.4e-3)
    source = Plane((1, 1), side, (0.1e-3, -0.05e-3))
    target = Plane((40, 61), (12e-6, 9e-6), (0.2e-3, 0.0))
    span = FreeSpaceSpan(source, target, distance, WAVELENGTH, cells=side, paraxial=True, tol=1e-7)
    y, x = (
        slit(target.coordinates(a).numpy() - source.centre[a], side[a], distance * WAVELENGTH)
        for a in (0, 1)
    )
    field = torch.ones(1, 1)
    found = method(span)
    assert error_of(found.forward(field), y[:, None] * x, span, field) < 1e-7


def test_a_knife_edge():
    # A half-plane's edge: the slit's other edge is so far away that its ripples are below 1e-3
    # of the light, and taken along in the closed form.
    side, scale = 0.04, 0.5 * WAVELENGTH
    source = Plane((1, 1), (side, side), (0.0, side / 2))
    target = Plane((1, 200), (1e-5, 5e-6))
    span = FreeSpaceSpan(
        source, target, 0.5, WAVELENGTH, cells=(side, side), paraxial=True, tol=1e-8
    )
    got = FresnelMatrices(span).forward(torch.ones(1, 1))[0]
    x = target.coordinates(1).numpy()
    edge = slit(x - side / 2, side, scale) * slit(np.zeros(1), side, scale)
    assert np.abs(got.numpy() - edge).max() < 1e-10
    # A quarter of the light in the edge's geometric shadow (Born and Wolf 8.7.3).
    assert abs(abs(got[100].item()) ** 2 - 0.25) < 0.02


def gaussian(waist, carrier=(0.0, 0.0), centre=(0.0, 0.0)):
    """A beam's field at a way along the axis, in Fresnel's approximation."""

    def field(plane, scale):
        answer = 1.0
        for axis in (0, 1):
            x = plane.coordinates(axis).numpy() - centre[axis]
            q = 1 + 1j * scale / (math.pi * waist**2)
            turns = carrier[axis] * x - scale * carrier[axis] ** 2 / 2
            wave = np.exp(-((x - scale * carrier[axis]) ** 2) / (waist**2 * q))
            wave = wave * np.exp(2j * math.pi * turns) / np.sqrt(q)
            answer = answer * (wave if axis else wave[:, None])
        return answer

    return field


SMOOTH = Plane((96, 81), (10e-6, 12e-6), (30e-6, -0.1e-3))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [1.0, 0.04, 1e-3, -0.04])
@pytest.mark.parametrize("tol", TOLERANCES)
def test_a_gaussian_beam_keeps_every_tolerance(method, distance, tol):
    beam = gaussian(90e-6, (5e3, -4e3), SMOOTH.centre)
    target = Plane((33, 50), (9e-6, 7e-6), (60e-6, -0.12e-3))
    span = FreeSpaceSpan(SMOOTH, target, distance, WAVELENGTH, paraxial=True, tol=tol)
    field = torch.from_numpy(beam(SMOOTH, 0.0))
    if method is SingleFresnel and abs(distance) < (0.02 if tol == 1e-1 else 0.05):
        with pytest.raises(ToleranceError, match="copies of the field"):
            method(span)
        return
    found = method(span)
    wrong = error_of(found.forward(field), beam(target, distance * WAVELENGTH), span, field)
    assert wrong <= found.error.value + found.arithmetic <= tol


@pytest.mark.parametrize("method", METHODS)
def test_bandpass_samples_beyond_their_nyquist_rate(method):
    # The carrier is 1.6 times what the samples would resolve, and known.
    carrier = (0.0, 0.8 / 12e-6)
    beam = gaussian(90e-6, carrier, SMOOTH.centre)
    distance = 0.06
    target = Plane((20, 24), (9e-6, 8e-6), (0.0, carrier[1] * distance * WAVELENGTH - 0.1e-3))
    span = FreeSpaceSpan(SMOOTH, target, distance, WAVELENGTH, carrier=carrier, band=(1.7e4, 1.7e4),
                paraxial=True, tol=1e-6)  # fmt: skip
    field = torch.from_numpy(beam(SMOOTH, 0.0))
    expected = beam(target, distance * WAVELENGTH)
    assert float(np.abs(expected).max()) > 0.3
    assert error_of(method(span).forward(field), expected, span, field) < 1e-6


def cells_by_numpy(span, field):
    """Fresnel's integral over every cell, in plain numpy."""
    nodes, weights = np.polynomial.legendre.leggauss(60)
    scale, sides = span.distance * span.wavelength, span.cells
    matrices = []
    for axis in (0, 1):
        inside = nodes * sides[axis] / 2
        x = span.source.coordinates(axis).numpy()[:, None] + inside
        way = span.target.coordinates(axis).numpy()[:, None, None] - x
        kernel = np.exp(1j * math.pi * way**2 / scale) * weights
        phase = np.exp(-0.25j * math.pi * np.sign(scale)) / math.sqrt(abs(scale))
        matrices.append(kernel.sum(-1) * sides[axis] / 2 * phase)
    return matrices[0] @ field.numpy() @ matrices[1].T


def span_from_cells(distance, shapes, tol):
    source = Plane(shapes[0], (10e-6, 12e-6), (30e-6, -0.1e-3))
    target = Plane(shapes[1], (13e-6, 8e-6), (0.1e-3, 50e-6))
    return FreeSpaceSpan(
        source, target, distance, WAVELENGTH, cells=(9e-6, 12e-6), paraxial=True, tol=tol
    )


@cache
def light_of_cells(distance, shapes):
    return cells_by_numpy(span_from_cells(distance, shapes, 1e-8), random_field(shapes[0]))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [2.0, 0.03, -0.03])
@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("shapes", [((24, 17), (15, 20)), ((1, 9), (6, 1)), ((5, 1), (1, 1))])
def test_cells_keep_every_tolerance(method, distance, tol, shapes):
    span, field = span_from_cells(distance, shapes, tol), random_field(shapes[0])
    if method is SingleFresnel and tol == 1e-8 and distance < 1 and shapes[0] == (24, 17):
        with pytest.raises(ToleranceError, match="outermost cells"):
            method(span)
        return
    found = method(span)
    wrong = error_of(found.forward(field), light_of_cells(distance, shapes), span, field)
    assert wrong <= found.error.value + found.arithmetic <= tol


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cells", [None, (8e-6, 9e-6)])
@pytest.mark.parametrize("distance", [0.2, -0.2])
@pytest.mark.parametrize(("tol", "exact"), [(1e-3, 1e-6), (1e-8, 1e-12)])
def test_the_adjoint_is_the_conjugate_transpose(method, cells, distance, tol, exact):
    source = Plane((24, 31), (10e-6, 12e-6), (30e-6, -0.1e-3))
    target = Plane((15, 10), (13e-6, 8e-6), (0.1e-3, 50e-6))
    span = FreeSpaceSpan(source, target, distance, WAVELENGTH, cells=cells, paraxial=True, tol=tol)
    found = method(span)
    there, back = random_field((2, 24, 31)), random_field((2, 15, 10), 1)
    sent = found.forward(there).to(torch.complex128)
    one = (sent * back.conj()).sum()
    other = (there * found.adjoint(back).to(torch.complex128).conj()).sum()
    assert abs(one - other) < exact * (sent.abs() * back.abs()).sum()


@pytest.mark.parametrize(
    ("method", "cells", "sign"),
    some(itertools.product(METHODS, [None, (8e-6, 9e-6)], [1.0, -1.0]), 0, 3, 5, 6, 8, 11),
)
def test_derivatives_in_every_length(method, cells, sign):
    source = Plane((5, 4) if cells else (32, 33), (10e-6, 12e-6), (30e-6, -0.1e-3))
    smooth = torch.from_numpy(gaussian(35e-6, (0.0, 0.0), source.centre)(source, 0.0))
    field = random_field(source.shape) if cells else smooth

    def sent(distance, wavelength, y, x):
        target = Plane((3, 2), (13e-6, 8e-6), (1e-5 * y, 1e-5 * x))
        span = FreeSpaceSpan(source, target, sign * 0.01 * distance, 1e-7 * wavelength, cells=cells,
                    paraxial=True, tol=1e-6)  # fmt: skip
        return method(span).forward(field)

    lengths = [
        torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (6.0, 5.0, 6.0, -6.0)
    ]
    # Long steps: the plan of another length is another one, by its tolerance.
    assert torch.autograd.gradcheck(sent, lengths, eps=1e-3, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [0.06, -0.06])
def test_derivatives_in_the_field_both_ways(method, distance):
    source = Plane((4, 3), (10e-6, 12e-6), (30e-6, -0.1e-3))
    target = Plane((2, 3), (13e-6, 8e-6))
    span = FreeSpaceSpan(
        source, target, distance, WAVELENGTH, cells=(9e-6, 9e-6), paraxial=True, tol=1e-6
    )
    found = method(span)
    assert torch.autograd.gradcheck(found.forward, random_field((4, 3)).requires_grad_())
    assert torch.autograd.gradcheck(found.adjoint, random_field((2, 3)).requires_grad_())


@pytest.mark.parametrize("method", METHODS)
def test_numbers_and_tensors_give_the_same(method):
    target = Plane((15, 20), (13e-6, 8e-6))
    distance = torch.tensor(0.2, dtype=torch.float64, requires_grad=True)
    numbers, tensors = (
        method(
            FreeSpaceSpan(
                SMOOTH, target, z, WAVELENGTH, cells=(9e-6, 9e-6), paraxial=True, tol=1e-6
            )
        )
        for z in (0.2, distance)
    )
    field = random_field(SMOOTH.shape)
    expected = numbers.forward(field)
    answer = tensors.forward(field)
    assert answer.requires_grad
    with torch.no_grad():
        again = tensors.forward(field)
    for one in (answer, again):
        assert (one - expected).norm() < 2e-6 * expected.norm()


def test_a_scalar_wave_is_served_where_it_is_paraxial():
    source = Plane((24, 17), (10e-6, 12e-6))
    target = Plane((9, 8), (30e-6, 30e-6))
    far = FreeSpaceSpan(source, target, 0.05, WAVELENGTH, cells=(9e-6, 12e-6), tol=1e-3)
    field = random_field(source.shape)
    exact = DirectQuadrature(far).forward(field).numpy()
    for method in METHODS:
        found = method(far)
        assert 0 < found.error.value < far.tol
        assert error_of(found.forward(field), exact, far, field) < far.tol
    steep = FreeSpaceSpan(source, Plane((9, 8), (30e-6, 30e-6), (0.05, 0.0)), 0.2, WAVELENGTH,
                 cells=(9e-6, 12e-6), tol=1e-3)  # fmt: skip
    for method in METHODS:
        with pytest.raises(ToleranceError, match="paraxial method"):
            method(steep)


def test_what_cannot_be_kept_is_refused():
    target = Plane((9, 8), (30e-6, 30e-6))

    def span(**changes):
        return FreeSpaceSpan(**{
            "source": SMOOTH, "target": target, "distance": 0.2, "wavelength": WAVELENGTH,
            "paraxial": True, **changes,
        })  # fmt: skip

    for method in METHODS:
        with pytest.raises(ValueError, match="parallel planes"):
            method(span(tilt=(0.1, 0.0)))
        with pytest.raises(ToleranceError, match="tol 1e-15 can't be kept"):
            method(span(tol=1e-15, cells=(1e-6, 1e-6)))
    # Without a gap in the spectrum there is no telling copies from the field.
    nyquist = (0.5 / 10e-6, 0.5 / 12e-6)
    with pytest.raises(ToleranceError, match="copies"):
        SingleFresnel(span(band=nyquist))
    with pytest.raises(ToleranceError, match="copies"):
        TwoStepFresnel(span(band=nyquist))
    assert FresnelMatrices(span(band=nyquist)).error.value == 0
    with pytest.raises(ToleranceError, match="outermost cells"):
        SingleFresnel(span(cells=(9e-6, 9e-6), distance=1e-3))


@pytest.mark.parametrize("method", METHODS)
def test_an_offer_makes_nothing_large(method):
    large = Plane((40_000, 40_000), (8e-6, 8e-6))
    span = FreeSpaceSpan(large, large, 1e3, WAVELENGTH, cells=(8e-6, 8e-6), paraxial=True, tol=1e-3,
                budget=Budget(1 << 50, seconds=math.inf))  # fmt: skip
    offer = method(span)
    assert offer.bytes > 2e10
    assert offer.cpu_seconds(MachineSpeed()) > 10
    small = method(FreeSpaceSpan(SMOOTH, SMOOTH, 0.3, WAVELENGTH, cells=(8e-6, 8e-6), paraxial=True,
                        tol=1e-3))  # fmt: skip
    assert small.bytes < 1e8
    assert small.cpu_seconds(MachineSpeed()) < 0.1


def half_turns_integral(t, width):
    """The mean over the interval by scipy's Fresnel integrals."""
    ends = [math.sqrt(2) * (t + sign * width / 2) for sign in (-1, 1)]
    (s0, c0), (s1, c1) = (fresnel(end) for end in ends)
    integral = ((c1 - c0) + 1j * (s1 - s0)) / math.sqrt(2)
    return integral / width * np.exp(-1j * math.pi * t**2)


@pytest.mark.parametrize("width", [0.2, 1.0, 6.0, 50.0])
def test_the_fresnel_integral_is_that_of_scipy(width):
    t = np.linspace(-70, 70, 3001)
    got = mean_chirp(torch.from_numpy(t), torch.tensor(width, dtype=torch.float64)).numpy()
    assert np.abs(got - half_turns_integral(t, width)).max() < 1e-12


def test_the_fresnel_integral_of_tiny_and_huge_arguments():
    t = np.array([0.0, 1e-9, 0.3, 1e3, 1e6])
    tiny = mean_chirp(torch.from_numpy(t), torch.tensor(1e-8, dtype=torch.float64)).numpy()
    assert np.abs(tiny - np.sinc(1e-8 * t)).max() < 1e-13
    # Far out, an integral is that of its ends: exp(i pi v²) / (2 pi i v) (1 + O(1 / v²)).
    # These numbers and their products have few digits: no phase is rounded.
    t, width = np.array([2.0**21 + 0.125, 2.0**24 + 0.375]), 0.75
    huge = mean_chirp(torch.from_numpy(t), torch.tensor(width, dtype=torch.float64)).numpy()
    ends = 0.0
    for sign in (-1, 1):
        turns = np.mod(sign * width * t + width**2 / 4, 2)
        ends = ends + sign * np.exp(1j * math.pi * turns) / (2j * math.pi * (t + sign * width / 2))
    assert np.abs(huge - ends / width).max() < 1e-12 * np.abs(huge).max()
    # All of the line.
    whole = mean_chirp(torch.zeros(1, dtype=torch.float64), torch.tensor(1e9, dtype=torch.float64))
    assert abs(whole.item() * 1e9 - np.exp(0.25j * math.pi)) < 1e-8


@pytest.mark.parametrize("width", [0.02, 0.5, 3.0, 20.0])
def test_derivatives_of_the_fresnel_integral(width):
    t = torch.tensor([-30.0, -2.0, -0.1, 0.0, 0.7, 9.0], dtype=torch.float64, requires_grad=True)
    w = torch.tensor(width, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(mean_chirp, (t, w), atol=1e-6)
    assert torch.autograd.gradgradcheck(mean_chirp, (t, w), atol=1e-5)


@pytest.mark.parametrize("turn", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("nodes", [1, 2, 3, 5])
def test_cells_envelopes_between_nodes(turn, nodes):
    at = turn * np.cos((2 * np.arange(nodes) + 1) * math.pi / (2 * nodes))
    inside = np.linspace(-0.5, 0.5, 401)
    worst = 0.0
    for u in np.linspace(-turn, turn, 41):
        shares = [np.prod([(u - b) / (a - b) for b in at if b != a]) for a in at]
        made = sum(s * np.exp(1j * a * inside) for s, a in zip(shares, at, strict=True))
        off = np.abs(made - np.exp(1j * u * inside)) ** 2
        worst = max(worst, math.sqrt(np.mean(off)))
    assert 0.3 * envelope_error(turn, nodes) < worst + 1e-15
    assert worst < 1.02 * envelope_error(turn, nodes) + 1e-15


@pytest.mark.parametrize("n", [8, 9])
@pytest.mark.parametrize("factor", [1, 2, 3])
def test_samples_between_samples(n, factor):
    # Fringes below the Nyquist rate about a carrier far above it.
    carrier = 2.3
    cycles = np.array([-3, 0, 2]) / n + carrier
    x = np.arange(n * factor) / factor
    fine = np.exp(2j * math.pi * np.outer(cycles, x))
    coarse = torch.from_numpy(fine[:, ::factor].copy())
    assert np.abs(upsample(coarse, factor, carrier).numpy() - fine).max() < 1e-12
    there, back = random_field((2, n)), random_field((2, n * factor), 1)
    one = (upsample(there, factor, carrier) * back.conj()).sum()
    assert abs(one - (there * upsample_adjoint(back, factor, carrier).conj()).sum()) < 1e-12
