"""The diffraction integral as a sum, against closed forms and dense sums in numpy."""

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from scipy.special import fresnel
from sweeps import some

from optics.accuracy import Budget, MachineSpeed, ToleranceError
from optics.plane import Plane
from optics.propagation import rayleigh_sommerfeld
from optics.propagation.paraxial import replicas_miss_target
from optics.propagation.rayleigh_sommerfeld import DirectQuadrature, gauss_nodes
from optics.propagation.span import FreeSpaceSpan

WAVELENGTH = 500e-9
K = 2 * math.pi / WAVELENGTH
WAIST = 1e-6
SOURCE = Plane((64, 61), (0.2e-6, 0.21e-6), (0.3e-6, -0.2e-6))
BAND = (1.4e6, 1.4e6)

SMALL = Plane((4, 3), (2e-6, 3e-6), (1e-6, 0.0))
ANY = Plane((3, 2), (1.5e-6, 2e-6), (-1e-6, 4e-6))


def complex_source(y, x, z):
    """A beam that solves Helmholtz's equation exactly: a spherical wave from a point at an
    imaginary depth (Deschamps 1971), of waist WAIST at z = 0; it keeps exp(i k z)."""
    depth = K * WAIST**2 / 2
    r = np.sqrt(y**2 + x**2 + (z - 1j * depth) ** 2 + 0j)
    return depth / r * np.exp(1j * K * r - K * depth)


def beam_on(span, start):
    """The beam on the source, which lies at `start`, and on the target."""
    y, x = (p.numpy() for p in span.source.mesh())
    source = torch.from_numpy(complex_source(y, x, start))
    n, target = span.numeric, span.target
    y, x = ((p - c).numpy() for p, c in zip(target.mesh(), target.centre, strict=True))
    places = n.target_position(*np.broadcast_arrays(y, x))
    there = complex_source(places[0], places[1], start + places[2])
    return source, there * np.exp(-1j * K * n.distance)


def error_of(answer, expected, span, field):
    """L2 error on the target over the light of the source."""
    wrong = np.sum(np.abs(answer.numpy() - expected) ** 2) * math.prod(span.target.pitch)
    return math.sqrt(wrong / float((field.abs() ** 2).sum() * span.sample_area))


def random_field(shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(shape, dtype=torch.complex128, generator=generator)


@pytest.mark.parametrize("distance", [3e-7, 2e-6, 3e-5, -1.5e-6])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.02, -0.015)])
def test_a_steep_beam_goes_where_helmholtz_says(distance, tilt):
    target = Plane((9, 12), (0.4e-6, 0.3e-6), (1e-6, -0.5e-6))
    span = FreeSpaceSpan(SOURCE, target, distance, WAVELENGTH, band=BAND, tilt=tilt, tol=1e-5)
    field, expected = beam_on(span, 2e-6)
    method = DirectQuadrature(span)
    assert method.error.value + method.arithmetic <= span.tol
    assert error_of(method.forward(field), expected, span, field) < 1e-6


def test_a_strongly_tilted_target():
    target = Plane((8, 9), (0.7e-6, 0.7e-6), (0.0, 0.5e-6))
    span = FreeSpaceSpan(SOURCE, target, 2e-5, WAVELENGTH, band=BAND, tilt=(0.9, -0.6), tol=1e-5)
    field, expected = beam_on(span, 1e-6)
    assert error_of(DirectQuadrature(span).forward(field), expected, span, field) < 1e-6


def test_a_tilt_through_the_source_is_refused():
    target = Plane((8, 9), (0.7e-6, 0.7e-6))
    span = FreeSpaceSpan(SOURCE, target, 2e-6, WAVELENGTH, band=BAND, tilt=(1.2, 0.0), tol=1e-5)
    with pytest.raises(ValueError, match="through the source's plane"):
        DirectQuadrature(span)


def cells_by_numpy(span, field, nodes):
    """Rayleigh and Sommerfeld's first integral over every cell, in plain numpy."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    z = span.distance
    total = np.zeros(span.target.shape, dtype=complex)
    ty, tx = (p.numpy() for p in span.target.mesh())
    for j, y in enumerate(span.source.coordinates(0).tolist()):
        for i, x in enumerate(span.source.coordinates(1).tolist()):
            for dy, wy in zip(points * span.cells[0] / 2, weights / 2, strict=True):
                for dx, wx in zip(points * span.cells[1] / 2, weights / 2, strict=True):
                    r = np.sqrt((ty - y - dy) ** 2 + (tx - x - dx) ** 2 + z**2)
                    h = abs(z) / (2 * np.pi * r**2) * (1 / r - 1j * K)
                    h = h * np.exp(1j * K * (r - abs(z)))
                    total += field[j, i].item() * wy * wx * (h if z > 0 else h.conj())
    return total * span.sample_area


def span_from_cells(distance, tol):
    source = Plane((5, 4), (2e-6, 3e-6), (1e-6, 0.0))
    target = Plane((6, 3), (1.5e-6, 2e-6), (-1e-6, 4e-6))
    return FreeSpaceSpan(source, target, distance, WAVELENGTH, cells=(2e-6, 2.5e-6), tol=tol)


@cache
def light_of_cells(distance):
    span = span_from_cells(distance, 1e-8)
    return cells_by_numpy(span, random_field(span.source.shape), 30)


@pytest.mark.parametrize("distance", some([-4e-5, 2e-6, 4e-5], 0, 1))
@pytest.mark.parametrize("tol", [1e-1, 1e-3, 1e-5, 1e-8])
def test_cells_keep_every_tolerance(distance, tol):
    span = span_from_cells(distance, tol)
    field = random_field(span.source.shape)
    method = DirectQuadrature(span)
    expected = light_of_cells(distance)
    wrong = error_of(method.forward(field), expected, span, field)
    assert wrong <= method.error.value + method.arithmetic <= tol


def test_cells_side_by_side_are_one_cell():
    hole = Plane((1, 1), (8e-6, 8e-6), (0.5e-6, -0.5e-6))
    tiles = Plane((8, 8), (1e-6, 1e-6), (1e-6, 0.0))
    answers = []
    for plane in (hole, tiles):
        span = FreeSpaceSpan(plane, ANY, 3e-5, WAVELENGTH, cells=plane.pitch, tol=1e-9)
        answers.append(DirectQuadrature(span).forward(torch.ones(plane.shape)))
    assert torch.allclose(*answers, rtol=0, atol=1e-9 * float(answers[0].abs().max()))


def disc_on_axis(radius, z):
    """The first Rayleigh-Sommerfeld integral of a disc, on its axis, without exp(i k z)."""
    r = math.hypot(radius, z)
    return 1 - z / r * np.exp(1j * K * (r - z))


def test_a_disc_of_cells_on_its_axis():
    # Cells on a fine grid, with the exact share of each that the disc covers, come to the
    # closed form as their side goes down: the error must fall with its square.
    z, radius = 2e-5, 2e-6
    errors = []
    for count in (31, 93):
        side = 2.2 * radius / count
        fine = 24
        x = ((np.arange(count * fine) + 0.5) / fine - count / 2) * side
        open_part = (x[:, None] ** 2 + x**2 < radius**2).astype(float)
        share = open_part.reshape(count, fine, count, fine).mean(axis=(1, 3))
        plane = Plane((count, count), (side, side))
        axis = Plane((1, 1), (1e-7, 1e-7))
        span = FreeSpaceSpan(plane, axis, z, WAVELENGTH, cells=(side, side), tol=1e-6)
        light = DirectQuadrature(span).forward(torch.from_numpy(share)).item()
        errors.append(abs(light - disc_on_axis(radius, z)))
    assert errors[0] < 4e-3
    assert 7 < errors[0] / errors[1] < 11


def test_samples_that_send_copies_are_made_finer():
    target = Plane((9, 8), (0.4e-6, 0.3e-6))
    coarse = Plane((32, 32), (0.5e-6, 0.5e-6))
    near = FreeSpaceSpan(coarse, target, 1e-6, WAVELENGTH, band=(1e6, 1e6), tol=1e-3)
    field, expected = beam_on(near, 1e-6)
    method = DirectQuadrature(near)
    assert min(method._factors) > 1
    assert error_of(method.forward(field), expected, near, field) < 1e-3
    method._factors = (1, 1)
    assert error_of(method.forward(field), expected, near, field) > 1e-2


def test_a_band_that_leaves_no_gap_has_copies_that_cannot_be_missed():
    kappa = 1e-7
    assert replicas_miss_target((-1e4, 1e4), 1e-5, (-3e4, 3e4), kappa, 1e-4)
    assert not replicas_miss_target((-5e4, 5e4), 1e-5, (-3e4, 3e4), kappa, 1e-4)
    # A bandpass field far off the target: neither it nor its copies go there.
    assert replicas_miss_target((2.45e5, 2.55e5), 1e-5, (-1e4, 1e4), kappa, 1e-4)
    assert not replicas_miss_target((1.95e5, 2.05e5), 1e-5, (-1e4, 1e4), kappa, 1e-4)


@pytest.mark.parametrize("cells", [None, (2e-6, 2e-6)])
@pytest.mark.parametrize("paraxial", [False, True])
@pytest.mark.parametrize("distance", [3e-5, -3e-5])
@pytest.mark.parametrize("shapes", [((4, 3), (3, 2)), ((1, 5), (2, 1)), ((1, 1), (1, 1))])
def test_the_adjoint_is_the_conjugate_transpose(cells, paraxial, distance, shapes):
    source, target = (
        Plane(s, p.pitch, p.centre) for s, p in zip(shapes, (SMALL, ANY), strict=True)
    )
    span = FreeSpaceSpan(
        source, target, distance, WAVELENGTH, cells=cells, paraxial=paraxial, tol=1e-4
    )
    method = DirectQuadrature(span)
    there, back = random_field((2, *shapes[0])), random_field((2, *shapes[1]), 1)
    one = (method.forward(there) * back.conj()).sum()
    other = (there * method.adjoint(back).conj()).sum()
    assert abs(one - other) < 1e-12 * (method.forward(there).abs() * back.abs()).sum()


@pytest.mark.parametrize(
    ("cells", "paraxial", "sign"),
    some(itertools.product([None, (2e-6, 2e-6)], [False, True], [1.0, -1.0]), 0, 7),
)
def test_derivatives(cells, paraxial, sign):
    def light(field, distance, wavelength, y, x):
        target = Plane(ANY.shape, ANY.pitch, (1e-6 * y, 1e-6 * x))
        span = FreeSpaceSpan(
            SMALL, target, sign * 1e-5 * distance, 1e-7 * wavelength,
            cells=cells, paraxial=paraxial, tilt=(0.1, 0.2), tol=1e-4,
        )  # fmt: skip
        return DirectQuadrature(span).forward(field)

    lengths = [
        torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (3.0, 5.0, -1.0, 4.0)
    ]
    field = random_field(SMALL.shape).requires_grad_()
    assert torch.autograd.gradcheck(light, (field, *lengths), atol=1e-6, rtol=1e-6)


def test_the_adjoint_is_differentiable_too():
    span = FreeSpaceSpan(SMALL, ANY, 3e-5, WAVELENGTH, cells=(2e-6, 2e-6), tol=1e-2)
    back = random_field(ANY.shape).requires_grad_()
    assert torch.autograd.gradcheck(DirectQuadrature(span).adjoint, back)


def test_memory_is_bounded_and_time_is_that_of_all_pairs():
    speed = MachineSpeed()
    small, large = (
        DirectQuadrature(
            FreeSpaceSpan(Plane((n, n), (8e-6, 8e-6)), Plane((n, n), (5e-6, 5e-6)), 1.0, WAVELENGTH,
                 cells=(8e-6, 8e-6), tol=1e-2)
        )
        for n in (100, 1000)
    )  # fmt: skip
    assert large.bytes < 1e9
    assert large.cpu_seconds(speed) > 5e3 * small.cpu_seconds(speed)


def test_tiles_change_nothing(monkeypatch):
    span = FreeSpaceSpan(SMALL, ANY, 3e-5, WAVELENGTH, cells=(2e-6, 2e-6), tol=1e-4)
    field, back = random_field(SMALL.shape), random_field(ANY.shape)
    method = DirectQuadrature(span)
    there, here = method.forward(field), method.adjoint(back)
    monkeypatch.setattr(rayleigh_sommerfeld, "_TILE_PAIRS", 50)
    monkeypatch.setattr(rayleigh_sommerfeld, "_TILE_SOURCE_POINTS", 10)
    assert torch.allclose(method.forward(field), there, rtol=1e-12, atol=0)
    assert torch.allclose(method.adjoint(back), here, rtol=1e-12, atol=0)


def test_too_many_points_are_refused_before_any_is_made():
    wide = Plane((64, 64), (1e-3, 1e-3))
    near = FreeSpaceSpan(
        wide, wide, 1e-3, WAVELENGTH, cells=(1e-3, 1e-3), tol=1e-3, budget=Budget(1 << 20)
    )
    with pytest.raises(ToleranceError, match="direct quadrature"):
        DirectQuadrature(near)
    smooth = FreeSpaceSpan(wide, wide, 1e-3, WAVELENGTH, tol=1e-3)
    with pytest.raises(ToleranceError, match="direct quadrature"):
        DirectQuadrature(smooth)


def test_a_tolerance_below_rounding_is_refused():
    span = FreeSpaceSpan(SMALL, ANY, 3e-5, WAVELENGTH, cells=(2e-6, 2e-6), tol=1e-14)
    with pytest.raises(ToleranceError, match="ask for tol") as refusal:
        DirectQuadrature(span)
    # What is asked for leaves room for the quadrature's own error.
    method = DirectQuadrature(replace(span, tol=1.001 * refusal.value.floor))
    assert method.error.value + method.arithmetic <= method.span.tol
    with pytest.raises(ToleranceError, match="ask for tol"):
        DirectQuadrature(replace(span, tol=1.1e-12))


legendre = cache(np.polynomial.legendre.leggauss)


@pytest.mark.parametrize("turn", [0.0, 0.1, 3.0, 40.0])
@pytest.mark.parametrize("bend", [0.0, 0.02, 0.6, 5.0, 30.0])
@pytest.mark.parametrize("depth", [0.5, 4.0, math.inf])
def test_gauss_nodes_are_enough(turn, bend, depth):
    def integral(nodes):
        x, w = legendre(nodes)
        wave = np.exp(1j * (turn * x + bend * x**2))
        return (w * wave / (1 + (x / depth) ** 2)).sum() / 2

    exact = integral(150)
    for error in (1e-2, 1e-5, 1e-9, 1e-11):
        nodes = gauss_nodes(turn, bend, depth, error, 200)
        assert abs(integral(nodes) - exact) <= error
        # Not many more than the half turn, the bend and the poles ask for.
        poles = 1 + math.log(1 / error) / (2 * math.asinh(depth))
        assert nodes <= turn + bend + poles + 2 + 0.6 * math.log(1 / error)
    assert gauss_nodes(turn, bend, 1e-4, 1e-9, 200) == 0


def test_a_long_cell_needs_no_fewer_nodes_than_its_chirp_has_turns():
    assert gauss_nodes(1e5, 0.0, math.inf, 1e-3, 1000) == 0
    assert gauss_nodes(0.0, 1e5, math.inf, 1e-3, 1000) == 0
    assert gauss_nodes(0.0, 0.0, math.inf, 1e-3, 1000) == 1


@pytest.mark.parametrize("tol", [1e-3, 1e-5, 1e-8, 1e-10])
def test_a_paraxial_cell_whose_phase_bends_keeps_every_tolerance(tol):
    """A cell's field by scipy's Fresnel integrals."""
    cell, z = Plane((1, 1), (14e-6, 8e-6)), 1e-3
    target = Plane((4, 3), (5e-6, 6e-6), (3e-6, -2e-6))
    span = FreeSpaceSpan(cell, target, z, WAVELENGTH, cells=cell.pitch, paraxial=True, tol=tol)
    method = DirectQuadrature(span)
    root = math.sqrt(WAVELENGTH * z / 2)
    along = []
    for axis in (0, 1):
        x, half = target.coordinates(axis).numpy(), cell.pitch[axis] / 2
        (s1, c1), (s0, c0) = (fresnel((x + side) / root) for side in (half, -half))
        along.append((c1 - c0 + 1j * (s1 - s0)) / (1 + 1j))
    light = torch.ones(cell.shape)
    wrong = error_of(method.forward(light), np.outer(*along), span, light)
    assert wrong <= method.error.value + method.arithmetic <= tol


@pytest.mark.parametrize("distance", some([-1e-6, 5e-7, 3e-6]))
def test_copies_of_a_paraxial_beam_do_not_die_beyond_the_wavelength(distance):
    """The paraxial model has no evanescent waves: close by, a copy is missed or shines."""
    source, target = Plane((64, 61), (0.3e-6, 0.3e-6)), Plane((9, 8), (0.4e-6, 0.3e-6))

    def beam(plane, z):
        y, x = (p.numpy() for p in plane.mesh())
        q = 1 + 1j * WAVELENGTH * z / (math.pi * WAIST**2)
        return np.exp(-(y**2 + x**2) / (WAIST**2 * q)) / q

    span = FreeSpaceSpan(
        source, target, distance, WAVELENGTH, paraxial=True, band=(1.2e6, 1.2e6), tol=1e-5
    )
    field, method = torch.from_numpy(beam(source, 0.0)), DirectQuadrature(span)
    wrong = error_of(method.forward(field), beam(target, distance), span, field)
    assert wrong <= method.error.value + method.arithmetic <= span.tol
