"""Stops and the wave in them: areas, nodes, polynomials, paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import torch
from judges import covered, explicit_zernike, open_area
from numpy.typing import NDArray

from hard_cases.lenses import SPIDER
from hard_cases.table import ONCE, Agrees, Case, Holds, Refused
from optics.camera import Lens
from optics.camera.pupil import defocus_path
from optics.camera.stop import Circle, Polygon, Shape, Stop, rectangle, regular_polygon
from optics.camera.stop_areas import coverage
from optics.camera.stop_nodes import PhaseSlopeBound, stop_rule
from optics.plane import Plane
from optics.zernike import zernike

BY_LINES = "Gauss-Legendre along the lines that the stop leaves open"
GRID = Plane((9, 8), (0.25, 0.3), (0.01, -0.02))


def shares(
    name: str, hard_because: str, stop: Stop, plane: Plane = GRID, radius: float = 1.0
) -> Agrees:
    """The share of every cell of a grid that a stop leaves open."""
    return Agrees(
        name,
        hard_because,
        f"{plane.shape[0]}x{plane.shape[1]} cells of {plane.pitch[0]:.3g} R"
        if radius == 1
        else f"{plane.shape[0]}x{plane.shape[1]} cells, R {radius:g}",
        lambda tol: coverage(stop, radius, plane),
        lambda: covered(stop, radius, plane),
        BY_LINES,
        tols=(1e-12,),
    )


def areas(
    name: str, hard_because: str, stop: Stop, area: Callable[[], float], judge: str
) -> Agrees:
    """The area of a stop, from its boundary and from the weights of its nodes."""

    def both(tol: float) -> NDArray[np.float64]:
        gentle = PhaseSlopeBound(lambda r: 0.0, lambda r: 0.0, 1.0)
        return np.array([stop.area, float(stop_rule(stop, gentle, 1e-10).weight.sum())])

    return Agrees(
        name, hard_because, "boundary, nodes", both, lambda: np.full(2, area()), judge, tols=(1e-9,)
    )


def moments(tol: float) -> NDArray[np.float64]:
    """Integrals of x^a y^b over a spider, by the nodes that a PSF would use."""
    nodes = stop_rule(SPIDER, PhaseSlopeBound(lambda r: 20.0, lambda r: 20.0, 20.0), tol)
    powers = [(a, b) for a in range(5) for b in range(5)]
    y, x, weight = nodes.y.numpy(), nodes.x.numpy(), nodes.weight.numpy()
    return np.array([np.sum(weight * x**a * y**b) for a, b in powers])


def moments_by_lines() -> NDArray[np.float64]:
    from judges import scan_lines

    lines = scan_lines(SPIDER, 0.0)
    powers = [(a, b) for a in range(5) for b in range(5)]
    return np.array([sum(np.sum(w * x**a * y**b) for y, x, w in lines) for a, b in powers])


RAY = np.concatenate([np.linspace(0, 1, 41), [1 - 1e-9, 1e-9, 1e-160]])


def radial(n: int, m: int) -> NDArray[np.float64]:
    """Born and Wolf's sum of factorials along a ray, with a hundred digits."""
    with mpmath.workdps(120):
        values = [
            mpmath.sqrt((2 if m else 1) * (n + 1))
            * mpmath.fsum(
                (-1) ** k
                * math.comb(n - k, k)
                * math.comb(n - 2 * k, (n - m) // 2 - k)
                * mpmath.mpf(float(r)) ** (n - 2 * k)
                for k in range((n - m) // 2 + 1)
            )
            for r in RAY
        ]
        return np.array([float(v) for v in values])


def path(distance: float, focus: float) -> Callable[[float], torch.Tensor]:
    lens = Lens(0.1, 1.4, focus, kind="stigmatic")
    r2 = torch.linspace(0, lens.stop_diameter / 2, 9, dtype=torch.float64) ** 2
    return lambda tol: defocus_path(lens, distance, r2)


def path_by_digits(distance: float, focus: float) -> Callable[[], NDArray[np.float64]]:
    """Two spheres, subtracted with fifty digits"""

    def sphere(d: float, r: float) -> Any:
        return 0 if math.isinf(d) else mpmath.sqrt(mpmath.mpf(d) ** 2 + mpmath.mpf(r) ** 2) - d

    def truth() -> NDArray[np.float64]:
        with mpmath.workdps(50):
            radii = np.linspace(0, 0.1 / 1.4 / 2, 9)
            return np.array([float(sphere(distance, r) - sphere(focus, r)) for r in radii])

    return truth


def exactly_in_focus(tol: float) -> None:
    """No path at all, not 1e-17 of it, for both kinds of lenses and at infinity."""
    r2 = torch.linspace(0, 1e-3, 9, dtype=torch.float64)
    for kind in ("thin", "stigmatic"):
        for distance in (0.3, 2.0, math.inf):
            assert not defocus_path(Lens(0.1, 2.8, distance, kind=kind), distance, r2).any()


def on_the_axis(tol: float) -> None:
    """Zero where there are cycles around it, sqrt(n + 1) times a sign where there are none."""
    zero = np.zeros(1)
    for n in range(13):
        for m in range(-n, n + 1, 2):
            expected = 0.0 if m else (-1) ** (n // 2) * math.sqrt(n + 1)
            assert abs(float(zernike(n, m, zero, zero)[0]) - expected) <= 1e-13


def orthogonal(tol: float) -> None:
    """Unit matrix of the mean products over the disc, up to degree 12."""
    nodes = stop_rule(Stop(), PhaseSlopeBound(lambda r: 60.0, lambda r: 60.0, 0.0), 1e-13)
    y, x = nodes.y.numpy(), nodes.x.numpy()
    terms = np.array([zernike(n, m, y, x) for n in range(13) for m in range(-n, n + 1, 2)])
    mean = (terms * (nodes.weight.numpy() / math.pi)) @ terms.T
    assert np.abs(mean - np.eye(len(terms))).max() <= 1e-11


VANE = rectangle(0.004, 1.6)


def turned(shape: Polygon, angle: float, y: float, x: float) -> Polygon:
    """Turned from x towards y, and moved."""
    c, s = math.cos(angle), math.sin(angle)
    return Polygon(tuple((y + s * v + c * u, x + c * v - s * u) for u, v in shape.corners))


def refused(
    name: str, hard_because: str, opening: Any, shapes: tuple[Shape, ...], words: str, **row: Any
) -> Refused:
    """A stop that can't be; a clear one can."""
    return Refused(
        name, hard_because, f"{len(shapes)} obscurations" if shapes else "an opening",
        lambda: Stop(opening() if callable(opening) else opening, shapes).area,
        words, lambda tol: Stop().area, **row,
    )  # fmt: skip


def open_circles(tol: float) -> NDArray[np.float64]:
    return np.array(Stop(Circle(0.7, (0.0, 0.2)), (Circle(0.5, (0.3, -0.4)),)).area)


def two_discs() -> NDArray[np.float64]:
    """The lens that two circles have in common, by the formula for segments."""
    a, b, d = 0.7, 0.5, math.hypot(0.3, 0.6)
    one = a * a * math.acos((d * d + a * a - b * b) / (2 * d * a))
    two = b * b * math.acos((d * d + b * b - a * a) / (2 * d * b))
    kite = 0.5 * math.sqrt((-d + a + b) * (d + a - b) * (d - a + b) * (d + a + b))
    return np.array(math.pi * a * a - (one + two - kite))


CASES: list[Case] = [
    # Shares of cells
    shares("a circle on a coarse grid", "inside or outside, an edge cell is 2 % off", Stop()),
    shares(
        "a circle that touches the grid's lines",
        "a tangent line has two crossings that are one, or none",
        Stop(), Plane((5, 6), (0.5, 0.5), (0.25, 0.0)),
    ),
    shares(
        "edges exactly on the grid's lines",
        "a cell on the line belongs to one side, the other, or both",
        Stop(rectangle(1.0, 1.0)), Plane((9, 9), (0.25, 0.25)),
    ),
    shares(
        "a stop smaller than a cell",
        "no line of the grid cuts it",
        Stop(), Plane((3, 3), (5.0, 7.0), (0.3, 0.1)),
    ),
    shares(
        "a stop larger than the grid",
        "its boundary lies outside; every cell is open all the same",
        Stop(), Plane((4, 5), (0.1, 0.1)),
    ),
    shares(
        "vanes thinner than a cell",
        "a vane takes 2 % of the cells that it passes, and turns at none of their centres",
        SPIDER,
    ),
    shares(
        "an obscuration that reaches beyond the rim",
        "what isn't open can't be taken off",
        Stop(Circle(), (Circle(0.5, (0.4, 0.7)),)),
    ),
    shares(
        "a stop of micrometres",
        "lengths in metres to the fourth power are 1e-24: no threshold may take them for nothing",
        Stop(regular_polygon(5, turn=0.3)), Plane((6, 7), (4e-7, 3e-7)), radius=1e-6,
    ),
    # Areas and nodes
    areas("a hexagon's area", "fans of straight edges", Stop(regular_polygon(6)),
          lambda: 1.5 * math.sqrt(3), "3/2 sqrt(3)"),
    areas("a spider's area", "vanes overlap with the disc that they hold, and leave the rim",
          SPIDER, lambda: open_area(SPIDER), BY_LINES),
    areas("a hairline of a slit", "1e-6 wide: an area below is taken for nothing",
          Stop(rectangle(1.0, 1e-6)), lambda: 1e-6, "height x width"),
    Agrees("two discs that overlap in part", "arcs of either circle, in the right sense",
           "0.7 R less 0.5 R beside it", open_circles, two_discs, "circular segments",
           tols=(1e-13,)),
    Agrees("moments of a spider", "positive and negative fans cancel behind the vanes",
           "x^a y^b, a and b up to 4", moments, moments_by_lines, BY_LINES, tols=(1e-10,)),
    # Polynomials
    *(
        Agrees(
            f"Zernike's polynomial of degree {n}",
            f"factorials of {n} cancel: in double precision the textbooks' sum is noise",
            f"({n}, {m}) on 44 radii",
            lambda tol, n=n, m=m: zernike(n, m, 0 * RAY, RAY),
            lambda n=n, m=m: radial(n, m),
            "the same sum with 120 digits",
            tols=(1e-11,),
        )
        for n, m in ((40, 0), (61, 21), (120, 4))
    ),
    Agrees(
        "sines and cosines around the axis",
        "the sign of m and the sense of the angle are conventions",
        "(5, -3) all around",
        lambda tol: zernike(5, -3, np.sin(np.arange(9.0)) / 2, np.cos(np.arange(9.0)) / 2),
        lambda: explicit_zernike(
            5, -3, np.sin(np.arange(9.0)) / 2, np.cos(np.arange(9.0)) / 2
        ).astype(float),
        "Born and Wolf's sum in extended precision",
        tols=(1e-13,),
    ),
    Holds("polynomials on the axis", "there is no angle", "all up to degree 12", on_the_axis,
          "0, or sqrt(n + 1)", tols=ONCE),
    Holds("polynomials among themselves", "the root mean square of one is a mean over the disc",
          "all up to degree 12", orthogonal, "the unit matrix", tols=ONCE),
    # Paths
    *(
        Agrees(name, why, f"{d:g} m, focus {f:g} m, f/1.4", path(d, f), path_by_digits(d, f),
               "spheres, subtracted with 50 digits", tols=(1e-13,))
        for name, why, d, f in (
            ("spheres around far points", "sqrt(d² + r²) - d at 1e9 m has no digit left", 1e9, 2e9),
            ("an object at infinity, as a sphere", "inf - inf", math.inf, 3.0),
            ("a focus at infinity", "the other way round", 0.5, math.inf),
            ("an object closer than the stop is wide", "the parabola is half the sphere",
             0.03, 0.2),
        )
    ),
    Agrees(
        "a millimetre beyond the focus",
        "two sags of 600 µm that differ by 0.6 µm: three digits cancel and ten are left",
        "1.001 m, focus 1 m, f/1.4", path(1.001, 1.0), path_by_digits(1.001, 1.0),
        "spheres, subtracted with 50 digits", tols=(1e-12,),
    ),
    Holds("exactly in focus", "a difference of roundings is a phase", "0.3 m, 2 m, ∞",
          exactly_in_focus, "zero", tols=ONCE),
    # Refusals
    refused("a stop that is covered all over", "0 / 0 of light", Circle(), (Circle(1.1),),
            "the obscurations close the stop: no light passes"),
    refused("three obscurations in one place", "what is taken off three times is put back once",
            Circle(), (Circle(0.5), Circle(0.4, (0.1, 0.0)), Circle(0.4, (0.0, 0.1))),
            "three obscurations overlap; end vanes where others begin"),
    refused("three hairlines through one point", "they overlap between all samples that look",
            Circle(), tuple(turned(VANE, a, 0.0013, 0.0017) for a in (0.0, 1.0, 2.0)),
            "three obscurations overlap; end vanes where others begin"),
    refused("an opening beyond the stop's radius", "cut-off and sampling follow the radius",
            Circle(0.8, (0.3, 0.0)), (), "the opening reaches beyond the stop's radius"),
    refused("a polygon that crosses itself", "an area of plus and minus",
            lambda: Polygon(((0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5))), (),
            "crosses itself|no area"),
    refused("a polygon without an inside", "corners in a line",
            lambda: Polygon(((0.0, 0.0), (0.1, 0.1), (0.2, 0.2))), (), "lie in a line"),
    refused("a corner that is no number", "NaN compares with nothing",
            lambda: Polygon(((0.0, 0.0), (math.nan, 0.5), (0.5, 0.0))), (), "finite"),
]  # fmt: skip
