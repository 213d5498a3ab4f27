"""Rules over stops against Fourier transforms, Fresnel integrals and Bessel functions."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import scipy.special
from scipy.integrate import quad
from scipy.optimize import brentq
from sweeps import some

from optics.camera.stop import Circle, Polygon, Stop, rectangle, regular_polygon
from optics.camera.stop_nodes import (
    PhaseSlopeBound,
    QuadratureNodes,
    count_nodes,
    line_rule,
    line_rule_node_count,
    product_rule,
    stop_rule,
    stop_rule_blocks,
)

TOLERANCES = [1e-3, 1e-6, 1e-9]


def disc(circle: Circle, ky: float, kx: float) -> complex:
    """Integral of exp(i k r), by Bessel's J1."""
    k, (y, x) = math.hypot(ky, kx), circle.centre
    airy = 2 * math.pi * circle.radius * scipy.special.j1(k * circle.radius) / k
    return complex(airy * cmath.exp(1j * (ky * y + kx * x)))


def polygon(shape: Polygon, ky: float, kx: float) -> complex:
    """Integral of exp(i k r): -i k exp(i k r) / k² through the sides, by Gauss' theorem."""
    total = 0j
    for (y0, x0), (y1, x1) in zip(
        shape.corners, shape.corners[1:] + shape.corners[:1], strict=True
    ):
        dy, dx = y1 - y0, x1 - x0
        through = kx * dy - ky * dx
        middle = cmath.exp(0.5j * (ky * (y0 + y1) + kx * (x0 + x1)))
        total += through * middle * np.sinc((ky * dy + kx * dx) / 2 / math.pi)
    return complex(-1j * total / (ky**2 + kx**2))


def strip(height: float, ky: float, kx: float) -> complex:
    """Of what a strip along x covers of the unit disc: chord by chord."""

    def chord(y: float) -> float:
        half = math.sqrt(1 - y * y)
        return 2 * half * np.sinc(kx * half / math.pi) * math.cos(ky * y)

    return complex(quad(chord, -height / 2, height / 2, epsabs=1e-13, limit=500)[0])


def shape(of: Circle | Polygon, ky: float, kx: float) -> complex:
    return disc(of, ky, kx) if isinstance(of, Circle) else polygon(of, ky, kx)


def plain(stop: Stop):
    """The transform where all obscurations lie inside and apart."""

    def transform(ky: float, kx: float) -> complex:
        return shape(stop.opening, ky, kx) - sum(shape(o, ky, kx) for o in stop.obscurations)

    return stop, transform


def spider(ky: float, kx: float) -> complex:
    both = polygon(rectangle(0.06, 0.1), ky, kx)
    return disc(Circle(), ky, kx) - strip(0.06, ky, kx) - strip(0.1, kx, ky) + both


L = Polygon(((-0.5, -0.5), (-0.5, 0.5), (0.0, 0.5), (0.0, 0.0), (0.5, 0.0), (0.5, -0.5)))

STOPS = {
    "round": plain(Stop()),
    "annular": plain(Stop(Circle(0.95), (Circle(0.4),))),
    "round, off the middle": plain(Stop(Circle(0.5, (0.2, -0.4)))),
    "with a disc off the middle": plain(Stop(Circle(), (Circle(0.3, (0.3, -0.5)),))),
    "with two discs in the middle": plain(
        Stop(Circle(), (Circle(0.2), Circle(0.1, (0.4, 0.3)))),
    ),
    "rectangular": plain(Stop(rectangle(0.7, 1.2, (0.1, -0.2)))),
    "round, beside the axis": plain(Stop(Circle(0.3, (0.5, -0.2)))),
    "with a short bar": plain(Stop(Circle(), (rectangle(0.01, 0.9, (0.0, 0.5)),))),
    "with a dot": plain(Stop(Circle(), (Circle(0.03, (0.8, 0.1)),))),
    "a frame beside the axis": plain(
        Stop(rectangle(0.5, 0.7, (0.4, 0.4)), (rectangle(0.2, 0.3, (0.45, 0.35)),))
    ),
    "a thin slit": plain(Stop(rectangle(0.004, 1.9))),
    "triangular": plain(Stop(regular_polygon(3, turn=0.4))),
    "hexagonal": plain(Stop(regular_polygon(6))),
    "hexagonal, with a disc": plain(Stop(regular_polygon(6, turn=0.2), (Circle(0.4),))),
    "hexagonal, with a disc off the middle": plain(
        Stop(regular_polygon(6), (Circle(0.2, (0.3, 0.4)),))
    ),
    "an L": plain(Stop(L)),
    "with an L": plain(Stop(Circle(), (L,))),
    "with a spider": (Stop(Circle(), (rectangle(0.06, 2.4), rectangle(2.4, 0.1))), spider),
}


def tilted(k: float) -> PhaseSlopeBound:
    return PhaseSlopeBound(lambda r: 0.0, lambda r: 0.0, k)


def defocused(c: float, tilt: float = 0.0) -> PhaseSlopeBound:
    """Of the phase c r²."""
    return PhaseSlopeBound(lambda r: 2 * abs(c) * r, lambda r: 0.0, tilt)


def points(nodes: QuadratureNodes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return nodes.y.numpy(), nodes.x.numpy(), nodes.weight.numpy()


def sum_over(stop: Stop, steepness: PhaseSlopeBound, tol: float, phase) -> complex:
    y, x, weight = points(stop_rule(stop, steepness, tol))
    return complex(np.sum(weight * np.exp(1j * phase(y, x))))


def test_the_judges_of_polygons_and_strips_agree_with_a_rectangle():
    """Its transform is a product of sincs."""
    ky, kx = 7.3, -4.1
    truth = 0.7 * 1.2 * np.sinc(ky * 0.35 / math.pi) * np.sinc(kx * 0.6 / math.pi)
    truth *= cmath.exp(1j * (ky * 0.1 + kx * -0.2))
    assert abs(polygon(rectangle(0.7, 1.2, (0.1, -0.2)), ky, kx) - truth) <= 1e-15
    assert abs(strip(2.0, ky, kx) - disc(Circle(), ky, kx)) <= 1e-12


@pytest.mark.parametrize("name", STOPS)
def test_a_stops_area_is_where_its_transform_begins(name):
    """But for a few squares of k."""
    stop, transform = STOPS[name]
    assert transform(1e-4, 1e-4).real == pytest.approx(stop.area, rel=1e-7)


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("name", STOPS)
def test_the_weights_have_the_sum_of_the_area(name, tol):
    """Where lengths of arcs don't have to be integrated, to the last digit."""
    stop, _ = STOPS[name]
    bound = 1e-13 if stop.annulus_radii or stop.rectangle_bounds else tol
    for steepness in (tilted(0.0), defocused(30.0, 5.0)):
        nodes = stop_rule(stop, steepness, tol)
        assert nodes.count == nodes.y.numel() == nodes.x.numel()
        assert float(nodes.weight.sum()) == pytest.approx(stop.area, rel=bound)


@pytest.mark.parametrize("name", STOPS)
def test_all_nodes_are_in_the_open_and_all_weights_positive(name):
    """What obscures a wave needn't be known there."""
    stop, _ = STOPS[name]
    y, x, weight = points(stop_rule(stop, defocused(5.0, 10.0), 1e-6))
    assert stop.opening.contains(y, x).all()
    assert not any(shape.contains(y, x).any() for shape in stop.obscurations)
    assert weight.min() > 0


@pytest.mark.parametrize("k", some([0.5, 70.0, 300.0], 0, 2))
@pytest.mark.parametrize("name", STOPS)
def test_a_tilt_gives_the_fourier_transform(name, k):
    stop, transform = STOPS[name]
    tilts = [(k * math.sin(angle), k * math.cos(angle)) for angle in (0.0, math.pi / 2, 4.0)]
    truths = [transform(ky, kx) for ky, kx in tilts]
    for tol in TOLERANCES:
        y, x, weight = points(stop_rule(stop, tilted(k), tol))
        for (ky, kx), truth in zip(tilts, truths, strict=True):
            value = np.sum(weight * np.exp(1j * (ky * y + kx * x)))
            assert abs(value - truth) <= tol * stop.area


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("c", [0.3, -7.0, 60.0, 300.0])
def test_defocus_over_a_disc_has_its_closed_form(c, tol):
    """pi (exp(i c) - 1) / (i c); over an annulus a difference of two."""

    def closed(radius: float) -> complex:
        return math.pi * (cmath.exp(1j * c * radius**2) - 1) / (1j * c)

    for stop, truth in (
        (Stop(), closed(1)),
        (Stop(Circle(0.9), (Circle(0.5),)), closed(0.9) - closed(0.5)),
    ):
        value = sum_over(stop, defocused(c), tol, lambda y, x: c * (y**2 + x**2))
        assert abs(value - truth) <= tol * stop.area


def chirp(low: float, high: float, c: float) -> complex:
    """Integral of exp(i c x²) by Fresnel's."""
    s, k = scipy.special.fresnel(np.array([low, high]) * math.sqrt(2 * c / math.pi))
    return complex(k[1] - k[0], s[1] - s[0]) * math.sqrt(math.pi / (2 * c))


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("c", [0.3, 7.0, 60.0, 300.0])
def test_defocus_over_a_rectangle_is_a_product_of_fresnel_integrals(c, tol):
    stop = Stop(rectangle(0.7, 1.2, (0.1, -0.2)))
    truth = chirp(-0.25, 0.45, c) * chirp(-0.8, 0.4, c)
    value = sum_over(stop, defocused(c), tol, lambda y, x: c * (y**2 + x**2))
    assert abs(value - truth) <= tol * stop.area


@pytest.mark.parametrize("c", [5.0, 80.0])
def test_defocus_and_tilt_over_a_rectangle_complete_a_square(c):
    """c x² + k x = c (x + k / 2c)² - k² / 4c."""
    ky, kx = 30.0, -60.0
    truth = cmath.exp(-0.25j * (ky**2 + kx**2) / c)
    truth *= chirp(-0.4 + ky / 2 / c, 0.4 + ky / 2 / c, c)
    truth *= chirp(-0.6 + kx / 2 / c, 0.6 + kx / 2 / c, c)
    steepness = defocused(c, math.hypot(ky, kx))
    value = sum_over(
        Stop(rectangle(0.8, 1.2)), steepness, 1e-9,
        lambda y, x: c * (y**2 + x**2) + ky * y + kx * x,
    )  # fmt: skip
    assert abs(value - truth) <= 1e-9


def offset_disc(circle: Circle, c: float) -> complex:
    """Of exp(i c r²): rings around the disc's own middle see a tilt, Bessel's J0."""
    away = math.hypot(*circle.centre)

    def ring(s: float, part) -> float:
        phase = c * (s * s + away**2)
        return 2 * math.pi * s * scipy.special.j0(2 * c * away * s) * part(phase)

    return complex(
        *(
            quad(lambda s, p=p: ring(s, p), 0, circle.radius, epsabs=1e-12, limit=2000)[0]
            for p in (math.cos, math.sin)
        )
    )


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("c", [0.3, 7.0, 100.0])
def test_defocus_around_a_disc_off_the_middle(c, tol):
    circle = Circle(0.3, (0.3, -0.5))
    hidden, whole = offset_disc(circle, c), math.pi * (cmath.exp(1j * c) - 1) / (1j * c)
    for stop, truth in ((Stop(circle), hidden), (Stop(Circle(), (circle,)), whole - hidden)):
        value = sum_over(stop, defocused(c), tol, lambda y, x: c * (y**2 + x**2))
        assert abs(value - truth) <= tol * stop.area


def hexagon_in_rows(c: float, circle: Circle | None = None) -> complex:
    """Of exp(i c r²), a chirp a row, less a disc that bites it from the side of large x."""

    def reach(y: float) -> float:
        side = 1 - abs(y) / math.sqrt(3)
        if circle is None or abs(y) >= circle.radius:
            return side
        return min(side, circle.centre[1] - math.sqrt(circle.radius**2 - y * y))

    def row(y: float, part: str) -> float:
        return getattr(
            chirp(-1 + abs(y) / math.sqrt(3), reach(y), c) * cmath.exp(1j * c * y * y), part
        )

    top, kinks = math.sqrt(3) / 2, []
    if circle is not None:
        inside = lambda y: 1 - y / math.sqrt(3) - reach(y) - 1e-14  # noqa: E731
        kinks = [brentq(inside, 0, circle.radius)]
    return complex(
        *(
            2 * quad(row, 0, top, args=(p,), points=kinks or None, epsabs=1e-12, limit=500)[0]
            for p in ("real", "imag")
        )
    )


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("c", [0.3, 7.0, 100.0])
@pytest.mark.parametrize("circle", [None, Circle(0.9, (0.0, 1.5))])
def test_defocus_over_a_hexagon_that_a_disc_bites(circle, c, tol):
    stop = Stop(regular_polygon(6), (circle,) if circle else ())
    value = sum_over(stop, defocused(c), tol, lambda y, x: c * (y**2 + x**2))
    assert abs(value - hexagon_in_rows(c, circle)) <= tol * stop.area


QUADRANT, OTHER = rectangle(2.0, 2.0, (1.0, 1.0)), rectangle(2.0, 2.0, (-1.0, -1.0))


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize(("m", "a"), [(4, 3.0), (4, 40.0), (8, 1.0), (20, 3.0)])
@pytest.mark.parametrize(
    ("stop", "share"),
    [
        (Stop(), 1.0),
        (Stop(Circle(0.95), (Circle(0.4),)), 1.0),
        (Stop(Circle(), (QUADRANT,)), 0.75),
        (Stop(Circle(), (QUADRANT, OTHER)), 0.5),
    ],
)
def test_waves_around_the_axis_average_to_a_bessel_function(stop, share, m, a, tol):
    """exp(i a r^m cos(m t)) has the mean J0(a r^m), over a circle and over a quarter of it."""
    inner, outer = stop.annulus_radii or (0.0, 1.0)
    truth = quad(
        lambda r: 2 * math.pi * r * scipy.special.j0(a * r**m), inner, outer, epsabs=1e-12
    )[0]
    steepness = PhaseSlopeBound(lambda r: a * m * r ** (m - 1), lambda r: a * m * r**m, 0.0, m)
    value = sum_over(stop, steepness, tol, lambda y, x: a * ((x + 1j * y) ** m).real)
    assert abs(value - share * truth) <= tol * stop.area


@pytest.mark.parametrize(
    "steepness",
    [
        tilted(0.0),
        tilted(200.0),
        defocused(150.0, 40.0),
        PhaseSlopeBound(lambda r: 90 * r**5, lambda r: 90 * r**6, 20.0, 6),
    ],
)
@pytest.mark.parametrize("name", STOPS)
def test_nodes_are_counted_before_they_are_made(name, steepness):
    stop, _ = STOPS[name]
    made = stop_rule(stop, steepness, 1e-5).count
    assert count_nodes(stop, steepness, 1e-5) == pytest.approx(made, rel=0.15)


@pytest.mark.parametrize("most", [1, 700, 10**9])
@pytest.mark.parametrize("name", ["annular", "rectangular", "with a spider"])
def test_blocks_are_the_rule_in_parts(name, most):
    stop, _ = STOPS[name]
    blocks = list(stop_rule_blocks(stop, tilted(30.0), 1e-6, most))
    whole = points(stop_rule(stop, tilted(30.0), 1e-6))
    for values, truth in zip(zip(*map(points, blocks), strict=True), whole, strict=True):
        assert np.array_equal(np.concatenate(values), truth)
    assert (len(blocks) == 1) == (name != "with a spider" or most == 10**9)


def test_a_smaller_tolerance_and_a_steeper_wave_cost_nodes():
    for stop, _ in STOPS.values():
        counts = [count_nodes(stop, tilted(50.0), tol) for tol in TOLERANCES]
        assert counts == sorted(set(counts))
        counts = [count_nodes(stop, tilted(k), 1e-6) for k in (0.0, 10.0, 100.0, 400.0)]
        assert counts == sorted(set(counts))


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("slope", [0.0, 1.0, 30.0, 399.0, 401.0, 5000.0])
def test_a_line_is_integrated_to_its_tolerance(slope, tol):
    """Also one of many panels."""
    for length in (0.1, 1.0, 1.7):
        t, weight = line_rule(length, slope, tol)
        assert t.size == line_rule_node_count(length, slope, tol)
        assert t.min() > 0
        assert t.max() < 1
        assert weight.sum() == pytest.approx(1, abs=1e-13)
        for k in (slope, slope / 3):
            truth = np.exp(0.5j * k * length) * np.sinc(k * length / 2 / math.pi)
            assert abs(np.sum(weight * np.exp(1j * k * length * t)) - truth) <= tol


def test_rows_and_columns_of_a_rectangle_are_its_nodes():
    stop, steepness = Stop(rectangle(0.7, 1.2, (0.1, -0.2))), defocused(20.0, 10.0)
    (y, wy), (x, wx) = product_rule(stop, steepness, 1e-6)
    one, other, weight = points(stop_rule(stop, steepness, 1e-6))
    assert np.array_equal(
        one.reshape(y.size, x.size), np.broadcast_to(y[:, None], (y.size, x.size))
    )
    assert np.array_equal(other.reshape(y.size, x.size), np.broadcast_to(x, (y.size, x.size)))
    assert np.allclose(weight.reshape(y.size, x.size), np.outer(wy, wx), rtol=1e-15)
    assert wy.sum() == pytest.approx(0.7, rel=1e-14)
    assert wx.sum() == pytest.approx(1.2, rel=1e-14)


def test_the_steepest_direction_is_between_outwards_and_around():
    """Radians per stop radius: around a circle of radius r they are r times as far apart."""
    steepness = PhaseSlopeBound(lambda r: 3 * r, lambda r: 2 * r, 10.0)
    assert steepness.largest_slope(0.5) == pytest.approx(math.hypot(1.5, 2.0) + 10)
    assert math.isfinite(steepness.largest_slope(0.0))
