"""Slow judges that share nothing with the code they judge but the declared model.

The model (thesis Eq. 3.1 and 3.2): a point's field at a place s on the sensor is

    U(s) = integral over the open pupil of exp(2 pi i (path(r) / wavelength - r s / scale)),

scale = wavelength x image distance, and |U|² / (scale² x open area) is its share of the light
per square metre. Phases are made in extended precision, as whole and broken turns, by the
formulas of the textbooks; no judge reduces, folds, interpolates or chooses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
import scipy.special
from judges import positions
from numpy.typing import NDArray

from hard_cases.view import View
from labapp.figures.free_space_judge import Cells, Points
from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf import PSFOperator
from optics.stop.aperture import Circle, Polygon, Stop

Array = NDArray[np.float64]
Shape = Circle | Polygon
Interval = tuple[float, float]
Edge = tuple[tuple[float, float], tuple[float, float]]
Judge = Callable[[View], Array]


@cache
def gauss(count: int) -> tuple[Array, Array]:
    """At least so many Gauss-Legendre nodes from -1 to 1, in panels, and their weights."""
    panels = math.ceil(count / 96)
    nodes, weights = np.polynomial.legendre.leggauss(math.ceil(count / panels))
    middles = (2 * np.arange(panels) + 1) / panels - 1
    return (middles[:, None] + nodes / panels).ravel(), np.tile(weights / panels, panels)


def richardson(function: Callable[[float], Any], at: float, step: float) -> Any:
    """The derivative of a function: central differences, extrapolated to no step at all."""
    steps = [step / 2**k for k in range(4)]
    slopes = [(function(at + h) - function(at - h)) / (2 * h) for h in steps]
    for order in range(1, len(slopes)):
        factor = 4**order
        slopes = [(factor * fine - coarse) / (factor - 1) for coarse, fine in pairwise(slopes)]
    return slopes[0]


# Where the light is looked at


def _lines(view: View) -> tuple[Array, Array, Array, Array]:
    """Rows and columns on the sensor in metres, and the metres that each stands for."""
    found = []
    for n, pitch, centre in zip(
        view.pixels.shape, view.pixels.pitch, view.pixels.centre, strict=True
    ):
        at = positions(n, pitch, float(centre))
        if not view.integrate:
            found += [at, np.full(n, pitch)]
            continue
        inside, weight = gauss(_count(pitch, 2 * np.pi * _cutoff(view)) - 36)
        found += [
            (at[:, None] + inside * pitch / 2).ravel(),
            np.tile(weight * pitch / 2, n),
        ]
    v, wv, u, wu = found
    return v, u, wv, wu


def _on_pixels(view: View, density: Array, wv: Array, wu: Array) -> Array:
    """Light on pixels from its density on the rows and columns of _lines()."""
    rows, columns = view.pixels.shape
    light = density * wv[:, None] * wu
    return light.reshape(rows, -1, columns, light.shape[1] // columns).sum((1, 3))


def _cutoff(view: View) -> float:
    """Cycles per metre of the finest fringe, of a stop or of the panel pixels behind it."""
    width = float(view.lens.stop_diameter)
    if isinstance(view.optics, Camera) and not float(view.optics.separation):
        panel = view.optics.panel
        width = min(width + 2 * panel.pitch, max(panel.shape) * panel.pitch)
    return width / _scale(view)


def _scale(view: View) -> float:
    return float(view.wavelength) * float(view.lens.image_distance)


# The wave in the pupil


def explicit_zernike(n: int, m: int, y: Any, x: Any) -> Any:
    """Born and Wolf 9.2.1 (5), factorials and all, in whole numbers and extended precision."""
    order = abs(m)
    r = np.hypot(np.asarray(y, np.longdouble), np.asarray(x, np.longdouble))
    radial = np.zeros_like(r)
    for k in range((n - order) // 2 + 1):
        term = (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, (n - order) // 2 - k)
        radial = radial + np.longdouble(term) * r ** (n - 2 * k)
    angle = np.arctan2(np.asarray(y, np.longdouble), np.asarray(x, np.longdouble))
    turn = np.cos(order * angle) if m >= 0 else np.sin(order * angle)
    return np.sqrt(np.longdouble((2 if m else 1) * (n + 1))) * radial * turn


def turns(lens: Lens, distance: float, wavelength: float, y: Any, x: Any) -> Any:
    """Waves of path at (y, x) in metres in the pupil, extended precision, by the textbooks'
    formulas: a parabola, or spheres as they are."""
    y, x = np.asarray(y, np.longdouble), np.asarray(x, np.longdouble)
    r2 = y**2 + x**2

    def sphere(d: float) -> Any:
        far = np.longdouble(d)
        return 0 * r2 if np.isinf(far) else np.sqrt(far**2 + r2) - far

    near, focus = float(distance), float(lens.focus_distance)
    vergence = 1 / np.longdouble(near) - 1 / np.longdouble(focus)
    path = vergence * r2 / 2 if lens.kind == "thin" else sphere(near) - sphere(focus)
    radius = np.longdouble(float(lens.stop_diameter)) / 2
    for n, m, strength in lens.aberrations:
        path = path + np.longdouble(float(strength)) * explicit_zernike(
            n, m, y / radius, x / radius
        )
    return path / np.longdouble(float(wavelength))


def _waves(view: View, y: Any, x: Any) -> Any:
    """turns(), and those of a plate before the lens."""
    waves = turns(view.lens, view.distance, view.wavelength, y, x)
    if callable(view.phase):
        waves = waves + np.asarray(view.phase(y, x), np.longdouble) / (2 * np.pi)
    return waves


def _phasor(waves: Any) -> NDArray[np.complex128]:
    part = np.asarray(waves - np.rint(waves), dtype=np.float64)
    return np.exp(2j * np.pi * part)


def _steepest(view: View, radius: float) -> float:
    """Radians per metre of the wave within `radius`, on a raster, and of the kernel."""
    grid = np.linspace(-radius, radius, 201)
    inside = np.hypot(grid[:, None], grid) <= radius * 1.001
    wave = _waves(view, *np.broadcast_arrays(grid[:, None], grid[None, :]))
    wave = np.where(inside, np.asarray(wave, np.float64), np.nan)
    slopes = [np.nanmax(np.abs(np.diff(wave, axis=axis))) / (grid[1] - grid[0]) for axis in (0, 1)]
    v, u, _, _ = _lines(view)
    tilt = math.hypot(np.abs(v).max(), np.abs(u).max()) / _scale(view)
    return 2 * np.pi * (1.2 * math.hypot(*slopes) + tilt)


# Stops, line by line


def _chord(shape: Shape, y: float) -> Interval | None:
    """Where a horizontal line is inside a convex shape."""
    if isinstance(shape, Circle):
        half2 = shape.radius**2 - (y - shape.centre[0]) ** 2
        if half2 <= 0:
            return None
        return shape.centre[1] - math.sqrt(half2), shape.centre[1] + math.sqrt(half2)
    crossed = [
        x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        for (y0, x0), (y1, x1) in shape.edges
        if (y0 > y) != (y1 > y)
    ]
    return (min(crossed), max(crossed)) if crossed else None


def _open(stop: Stop, y: float) -> list[Interval]:
    """Where a horizontal line is open: the opening's chord less those of what stands in it."""
    chord = _chord(stop.opening, y)
    free = [chord] if chord else []
    for shape in stop.obscurations:
        taken = _chord(shape, y)
        if taken:
            free = [
                part
                for low, high in free
                for part in ((low, min(high, taken[0])), (max(low, taken[1]), high))
                if part[1] > part[0]
            ]
    return free


def _breaks(stop: Stop, x: Sequence[float] = (), y: Sequence[float] = ()) -> Array:
    """Heights at which a boundary turns or meets another one: between them all is smooth.

    x, y: further lines to be met, as of a grid.
    """
    shapes = (stop.opening, *stop.obscurations)
    found = [-1.0, 1.0, *y]
    for shape in shapes:
        if isinstance(shape, Circle):
            found += [shape.centre[0] - shape.radius, shape.centre[0] + shape.radius]
        else:
            found += [height for height, _ in shape.corners]
    upright = [((-2.0, position), (2.0, position)) for position in x]
    edges = [edge for shape in shapes if isinstance(shape, Polygon) for edge in shape.edges]
    circles = [shape for shape in shapes if isinstance(shape, Circle)]
    for one, two in combinations(edges, 2):
        found += _lines_meet(one, two)
    for one, two in product(edges, upright):
        found += _lines_meet(one, two)
    for circle, edge in product(circles, edges + upright):
        found += _circle_meets(circle, edge)
    for a, b in combinations(circles, 2):
        found += _circle_meets(a, _chord_line(a, b))
    return np.unique(np.round([height for height in found if -1 <= height <= 1], 15))


def _lines_meet(one: Edge, two: Edge) -> list[float]:
    """The height at which two straight pieces cross."""
    (p, q), (r, s) = np.array(one), np.array(two)
    matrix = np.column_stack([q - p, r - s])
    if abs(np.linalg.det(matrix)) < 1e-14:
        return []
    a, b = np.linalg.solve(matrix, r - p)
    return [float((p + a * (q - p))[0])] if 0 <= a <= 1 and 0 <= b <= 1 else []


def _circle_meets(circle: Circle, edge: Edge) -> list[float]:
    """The heights at which a straight piece crosses a circle."""
    p, along = np.array(edge[0]), np.subtract(edge[1], edge[0])
    away = p - circle.centre
    roots = np.roots([along @ along, 2 * away @ along, away @ away - circle.radius**2])
    real = roots[np.abs(np.imag(roots)) < 1e-9].real
    return [float(p[0] + t * along[0]) for t in real if 0 <= t <= 1]


def _chord_line(a: Circle, b: Circle) -> Edge:
    """A piece of the straight line on which two circles meet."""
    p, q = np.array(a.centre), np.array(b.centre)
    d = float(np.linalg.norm(q - p))
    if d == 0:
        return (9.0, 9.0), (9.0, 10.0)
    towards = (q - p) / d
    middle = p + towards * (d**2 + a.radius**2 - b.radius**2) / (2 * d)
    across = 2 * np.array([-towards[1], towards[0]])
    (y0, x0), (y1, x1) = middle - across, middle + across
    return (y0, x0), (y1, x1)


def scan_lines(stop: Stop, slope: float) -> list[tuple[float, Array, Array]]:
    """Heights, positions and weights of an integral over a stop, in stop radii.

    Heights go as a cosine between the breaks, so that round ends are smooth in them.
    """
    lines = []
    for y, weight in _heights(_breaks(stop), slope):
        for left, right in _open(stop, y):
            inner, share = gauss(_count(right - left, slope))
            x = (left + right) / 2 + (right - left) / 2 * inner
            lines.append((y, x, weight * share * (right - left) / 2))
    return lines


def _heights(breaks: Array, slope: float) -> Iterator[tuple[float, float]]:
    """Heights and their weights between breaks."""
    for low, high in pairwise(breaks):
        middle, half = (low + high) / 2, (high - low) / 2
        if half < 1e-13:
            continue
        nodes, weights = gauss(_count(2 * half, slope))
        angle = np.pi / 2 * (nodes + 1)
        yield from zip(
            middle - half * np.cos(angle), weights * np.pi / 2 * np.sin(angle) * half, strict=True
        )


def _count(length: float, slope: float) -> int:
    """Nodes for a phase that turns by so many radians, with plenty to spare."""
    return 48 + math.ceil(0.6 * length * slope)


def open_area(stop: Stop) -> float:
    """Gauss-Legendre along the lines that a stop leaves open"""
    return float(sum(w.sum() for _, _, w in scan_lines(stop, 0.0)))


# Judges of a lens


def _times(matrix: NDArray[Any], vector: NDArray[Any]) -> NDArray[np.complex128]:
    """A product on one thread: BLAS' threads wait for each other longer than they work."""
    return np.asarray(np.einsum("ij,j->i", matrix, vector))


def by_lines(view: View) -> Array:
    """Gauss-Legendre along the lines that the stop leaves open"""
    lens, scale = view.lens, _scale(view)
    radius = float(lens.stop_diameter) / 2
    v, u, wv, wu = _lines(view)
    lines = scan_lines(lens.stop, _steepest(view, radius) * radius)
    rows, heights = [], []
    for y, x, weight in lines:
        wave = _phasor(_waves(view, y * radius, x * radius)) * weight
        rows.append(_times(np.exp(-2j * np.pi * radius / scale * np.outer(u, x)), wave))
        heights.append(y * radius)
    field = np.exp(-2j * np.pi / scale * np.outer(v, heights)) @ np.array(rows)
    area = sum(float(w.sum()) for _, _, w in lines)
    density = np.abs(field) ** 2 * radius**2 / (scale**2 * area)
    return _on_pixels(view, density, wv, wu)


def by_rings(view: View) -> Array:
    """Gauss-Legendre along the radius of the stop, with J0"""
    lens, scale = view.lens, _scale(view)
    radius = float(lens.stop_diameter) / 2
    assert lens.stop.rings is not None
    inner, outer = lens.stop.rings
    v, u, wv, wu = _lines(view)
    s, place = np.unique(np.hypot(v[:, None], u), return_inverse=True)
    nodes, weights = gauss(_count(outer - inner, _steepest(view, radius) * radius))
    r = inner + (outer - inner) * (nodes + 1) / 2
    weights = weights * (outer - inner) / 2 * 2 * np.pi * r
    wave = weights * _phasor(_waves(view, 0 * r, r * radius))
    parts = np.array_split(s, max(1, s.size * r.size // 1_000_000))
    field = np.concatenate(
        [
            _times(scipy.special.j0(2 * np.pi * radius / scale * np.outer(part, r)), wave)
            for part in parts
        ]
    )
    area = np.pi * (outer**2 - inner**2)
    density = np.abs(field) ** 2 * radius**2 / (scale**2 * area)
    return _on_pixels(view, density[place].reshape(v.size, u.size), wv, wu)


def by_airy(view: View) -> Array:
    """Airy's (2 J1(v) / v)², less that of the obscuration"""
    lens, scale = view.lens, _scale(view)
    radius = float(lens.stop_diameter) / 2
    assert lens.stop.rings is not None
    inner, outer = lens.stop.rings
    v, u, wv, wu = _lines(view)
    s = np.hypot(v[:, None], u)

    def disc(r: float) -> Array:
        argument = 2 * np.pi * r * s / scale
        safe = np.where(argument > 0, argument, 1)
        return np.pi * r**2 * np.where(argument > 0, 2 * scipy.special.j1(safe) / safe, 1)

    field = disc(outer * radius) - (disc(inner * radius) if inner else 0)
    density = field**2 / (scale**2 * np.pi * radius**2 * (outer**2 - inner**2))
    return _on_pixels(view, density, wv, wu)


def by_lommel(view: View) -> Array:
    """Lommel's series of Bessel functions (Born and Wolf 8.8)"""
    lens, scale = view.lens, _scale(view)
    radius = float(lens.stop_diameter) / 2
    at_edge = turns(lens, view.distance, view.wavelength, 0, radius)
    u_ = abs(4 * np.pi * float(at_edge))
    v, u, wv, wu = _lines(view)
    s, place = np.unique(np.hypot(v[:, None], u), return_inverse=True)
    field = np.array([_lommel(u_, 2 * np.pi * radius / scale * each) for each in s])
    density = np.abs(field) ** 2 * np.pi * radius**2 / scale**2
    return _on_pixels(view, density[place].reshape(v.size, u.size), wv, wu)


def _lommel(u: float, v: float) -> complex:
    """2 times the integral of exp(i u r² / 2) J0(v r) r dr from 0 to 1, up to a phase."""
    count = int(max(u, v) + 20 * max(u, v) ** (1 / 3)) + 80
    order = np.arange(count)
    bessel = scipy.special.jv(order, v)
    if u > v:
        terms = (v / u) ** order * bessel
        v0, v1 = _alternating(terms, 0), _alternating(terms, 1)
        edge = np.exp(0.5j * (u + v * v / u))
        return complex(2 / u * (1j - edge * (v1 + 1j * v0)))
    terms = (u / v) ** order * bessel
    u1, u2 = _alternating(terms, 1), _alternating(terms, 2)
    return complex(2 / u * (u1 - 1j * u2) * np.exp(0.5j * u))


def _alternating(terms: NDArray[Any], first: int) -> float:
    """Sum over s of (-1)^s times the term first + 2 s."""
    part = terms[first::2]
    return float(np.sum(part * (-1.0) ** np.arange(part.size)))


def by_fresnel(view: View) -> Array:
    """Fresnel's integrals along each side of a rectangle"""
    lens, scale = view.lens, _scale(view)
    assert lens.stop.sides is not None
    radius = float(lens.stop_diameter) / 2
    vergence = 1 / view.distance - 1 / lens.focus_distance
    y0, y1, x0, x1 = (side * radius for side in lens.stop.sides)
    v, u, wv, wu = _lines(view)

    def line(at: Array, low: float, high: float) -> Array:
        if vergence == 0:
            return ((high - low) * np.sinc((high - low) * at / scale)) ** 2
        stretch = np.sqrt(2 * abs(vergence) / view.wavelength)
        shift = at / (vergence * lens.image_distance)
        s1, c1 = scipy.special.fresnel(stretch * (high - shift))
        s0, c0 = scipy.special.fresnel(stretch * (low - shift))
        return np.asarray(((c1 - c0) ** 2 + (s1 - s0) ** 2) / stretch**2)

    density = np.outer(line(v, y0, y1), line(u, x0, x1)) / (scale**2 * (y1 - y0) * (x1 - x0))
    return _on_pixels(view, density, wv, wu)


def by_edges(view: View) -> Array:
    """the closed form of a polygon's edges (Lee and Mittra 1983)"""
    lens, scale = view.lens, _scale(view)
    radius = float(lens.stop_diameter) / 2
    opening = lens.stop.opening
    assert isinstance(opening, Polygon)
    corners = np.array(opening.corners) * radius
    v, u, wv, wu = _lines(view)
    ky, kx = (2 * np.pi / scale * a for a in (v[:, None], u[None, :]))
    field = np.zeros((v.size, u.size), dtype=complex)
    for (y0, x0), (y1, x1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        half = (ky * (y1 - y0) + kx * (x1 - x0)) / 2
        middle = np.exp(-1j * (ky * (y0 + y1) + kx * (x0 + x1)) / 2)
        field += (kx * (y1 - y0) - ky * (x1 - x0)) * np.sinc(half / np.pi) * middle
    square = ky**2 + kx**2
    turned = np.roll(corners, -1, axis=0)
    area = abs(np.sum(corners[:, 1] * turned[:, 0] - turned[:, 1] * corners[:, 0])) / 2
    safe = np.where(square > 0, square, 1)
    field = np.where(square > 0, 1j * field / safe, area)
    return _on_pixels(view, np.abs(field) ** 2 / (scale**2 * area), wv, wu)


# Judges of a panel


def by_panel(view: View) -> Array:
    """Gauss-Legendre over every pixel of the panel and of the sensor"""
    assert isinstance(view.optics, Camera)
    share = view.optics.panel.unmodulated
    lit = _panel_light(view, view.modulation())
    if not share:
        return lit
    return (1 - share) * lit + share * _panel_light(view, view.modulation(modulated=False))


def _panel_light(view: View, modulation: NDArray[np.complex128]) -> Array:
    assert isinstance(view.optics, Camera)
    panel, scale = view.optics.panel, _scale(view)
    side = math.sqrt(panel.fill_factor) * panel.pitch
    # A pixel that the stop cuts reaches beyond it.
    reach = float(view.lens.stop_diameter) / 2 + math.sqrt(2) * panel.pitch
    reach = min(math.hypot(*panel.shape) * panel.pitch / 2, reach)
    inner, weight = gauss(_count(side, _steepest(view, reach)) - 32)
    y, x = ((positions(n, panel.pitch)[:, None] + inner * side / 2).ravel() for n in panel.shape)
    wy, wx = (np.tile(weight * side / 2, n) for n in panel.shape)
    covered = pixel_coverage(view.optics)
    factor = np.kron(covered * modulation, np.ones((inner.size, inner.size)))
    dark = factor == 0
    waves = turns(view.lens, view.distance, view.wavelength, y[:, None], x[None, :])
    wave = np.where(dark, 0, factor * _phasor(np.where(dark, 0, waves)) * wy[:, None] * wx)
    v, u, wv, wu = _lines(view)
    field = np.exp(-2j * np.pi / scale * np.outer(v, y)) @ wave
    field = field @ np.exp(-2j * np.pi / scale * np.outer(x, u))
    density = np.abs(field) ** 2 / (scale**2 * covered.sum() * side**2)
    return _on_pixels(view, density, wv, wu)


def pixel_coverage(camera: Camera) -> Array:
    """The stop's share of every panel pixel"""
    return covered(camera.lens.stop, float(camera.lens.stop_diameter) / 2, camera.panel.plane)


def covered(stop: Stop, radius: float, plane: Plane) -> Array:
    """Gauss-Legendre along the lines that the stop leaves open in each cell"""
    (rows, columns), (py, px) = plane.shape, (p / radius for p in plane.pitch)
    y, x = (
        (np.arange(n + 1) - n // 2 - 0.5) * p + float(c) / radius
        for n, p, c in zip(plane.shape, (py, px), plane.centre, strict=True)
    )
    area = np.zeros((rows, columns))
    for height, weight in _heights(_breaks(stop, tuple(x), tuple(y)), 0.0):
        row = int(np.searchsorted(y, height)) - 1
        if 0 <= row < rows:
            for low, high in _open(stop, height):
                area[row] += weight * np.clip(
                    np.minimum(high, x[1:]) - np.maximum(low, x[:-1]), 0, None
                )
    return area / (py * px)


# Judges of a panel that stands apart from its lens


@dataclass(frozen=True)
class Apart(View):
    """A point's light through panel, space, lens and stop, and space.

    off_axis, sphere: `field` and `sphere` of PSFOperator; pixels lie around the point's image.
    """

    off_axis: tuple[Any, Any] = (0.0, 0.0)
    sphere: bool = False

    def operator(self, tol: float) -> PSFOperator:
        return PSFOperator(
            self.optics,
            self.distance,
            self.wavelength,
            self.pixels,
            field=self.off_axis,
            sphere=self.sphere,
            integrate=self.integrate,
            method=self.method,
            tol=tol,
        )

    def __str__(self) -> str:
        assert isinstance(self.optics, Camera)
        words = f"{super().__str__()}, panel {float(self.optics.separation):.3g} m before the lens"
        if any(float(place) for place in self.off_axis):
            words += ", image at ({:.3g}, {:.3g}) mm".format(
                *(1e3 * float(p) for p in self.off_axis)
            )
        return words + (", exact sphere" if self.sphere else "")


def by_chain(view: View) -> Array:
    """Fresnel's integrals to the lens and on to the sensor, line by line"""
    assert isinstance(view, Apart)
    assert isinstance(view.optics, Camera)
    share = view.optics.panel.unmodulated
    lit = _chain_light(view, view.modulation())
    if not share:
        return lit
    return (1 - share) * lit + share * _chain_light(view, view.modulation(modulated=False))


def _chain_light(view: Apart, modulation: NDArray[np.complex128]) -> Array:
    """Along each axis the waves of thesis Eq. 5.1 to 5.6 have the exponent pi i / wavelength
    times (p - o)² / d + (x - p)² / z1 - x² / f + (u - x)² / z2, with o the object, p on the
    panel, x in the stop and u on the sensor."""
    assert isinstance(view.optics, Camera)
    lens, radius, scale = view.lens, float(view.lens.stop_diameter) / 2, _scale(view)
    v, u, wv, wu = _lines(view)
    v, u = (seen + float(place) for seen, place in zip((v, u), view.off_axis, strict=True))
    panel = _Panel.of(view, modulation)
    # Nearly a node a radian is plenty: half of them would do, and here they are dear.
    slope = 0.6 * panel.slope((v, u)) * radius
    rows, heights = [], []
    for y, x, weight in scan_lines(lens.stop, slope):
        at = np.full(1, y * radius), x * radius
        light = panel.towards(0, at[0]) @ panel.wave @ panel.towards(1, at[1]).T
        light = light[0] * weight * _phasor(panel.left_over(*at))
        rows.append(_times(np.exp(-2j * np.pi / scale * np.outer(u, at[1])), light))
        heights.append(y * radius)
    field = np.exp(-2j * np.pi / scale * np.outer(v, heights)) @ np.array(rows) * radius**2
    passed = float(pixel_coverage(view.optics).sum()) * view.optics.panel.active_side**2
    return _on_pixels(view, np.abs(field) ** 2 / (scale**2 * passed), wv, wu)


@dataclass(frozen=True)
class _Panel:
    """The light of a panel on its way to the lens: a wave on nodes, and what an axis adds."""

    view: Apart
    wave: NDArray[np.complex128]
    nodes: tuple[Array, Array]

    @staticmethod
    def of(view: Apart, modulation: NDArray[np.complex128]) -> _Panel:
        """Of an exact sphere, on Gauss-Legendre nodes inside the pixels; else pixel by pixel."""
        assert isinstance(view.optics, Camera)
        panel = view.optics.panel
        middles = positions(panel.shape[0], panel.pitch), positions(panel.shape[1], panel.pitch)
        if not view.sphere:
            return _Panel(view, modulation, middles)
        assert not any(view.off_axis)
        half, reach = panel.active_side / 2, max(panel.shape) * panel.pitch / 2
        near = (float(view.lens.stop_diameter) / 2 + reach) / float(view.optics.separation)
        slope = near + reach / float(view.distance)
        inner, weight = gauss(16 + math.ceil(2 * np.pi / float(view.wavelength) * slope * half))
        y, x = ((middle[:, None] + half * inner).ravel() for middle in middles)
        wy, wx = (np.tile(half * weight, n) for n in panel.shape)
        away = np.add.outer(y.astype(np.longdouble) ** 2, x.astype(np.longdouble) ** 2)
        d = np.longdouble(float(view.distance))
        r = np.sqrt(away + d**2)
        sphere = _phasor((r - d) / float(view.wavelength)) * (d / r).astype(float)
        wave = np.kron(modulation, np.ones((inner.size, inner.size))) * np.outer(wy, wx) * sphere
        return _Panel(view, wave, (y, x))

    @property
    def _lengths(self) -> tuple[float, float, float]:
        """z1, 1 / d and the wavelength."""
        assert isinstance(self.view.optics, Camera)
        z1, wavelength = float(self.view.optics.separation), float(self.view.wavelength)
        return z1, 1 / float(self.view.distance), wavelength

    def _tilt(self, axis: int) -> float:
        """-o / d, of the object whose image lies at the view's place: it is inverted."""
        z1, near, _ = self._lengths
        return (
            float(self.view.off_axis[axis]) / float(self.view.lens.image_distance) * (1 + z1 * near)
        )

    def towards(self, axis: int, x: Array) -> NDArray[np.complex128]:
        """From each node to places x at the lens, without what left_over() has."""
        z1, near, wavelength = self._lengths
        if self.view.sphere:
            turn = (x[:, None] - self.nodes[axis]) ** 2 / (2 * wavelength * z1)
            return _phasor(turn) / math.sqrt(wavelength * z1)
        assert isinstance(self.view.optics, Camera)
        half = self.view.optics.panel.active_side / 2
        bend = near + 1 / z1
        centre = (x / z1 - self._tilt(axis)) / bend
        stretch = math.sqrt(2 * bend / wavelength)
        ends = [self.nodes[axis] + side - centre[:, None] for side in (-half, half)]
        (s0, c0), (s1, c1) = (scipy.special.fresnel(stretch * end) for end in ends)
        sent = (c1 - c0 + 1j * (s1 - s0)) / stretch / math.sqrt(wavelength * z1)
        own = (x**2 / z1 - bend * centre**2) / (2 * wavelength)
        return np.asarray(_phasor(own)[:, None] * sent)

    def left_over(self, y: Array, x: Array) -> Any:
        """Waves of path at places in the lens: its own phase, and the way to the sensor."""
        lens, (z1, _, wavelength) = self.view.lens, self._lengths
        r2 = np.asarray(y, np.longdouble) ** 2 + np.asarray(x, np.longdouble) ** 2
        # 1 / z2 - 1 / f is -1 / focus, by the thin-lens equation.
        focus = np.longdouble(float(lens.focus_distance))
        waves = -r2 / (2 * focus * np.longdouble(wavelength))
        whole = float(self.view.distance) + z1
        parabola = (1 / np.longdouble(whole) - 1 / focus) * r2 / 2 / wavelength
        return waves + turns(lens, whole, wavelength, y, x) - parabola

    def slope(self, seen: tuple[Array, Array]) -> float:
        """The most radians a metre by which the light turns in the stop: that from the panel's
        ends, and that which goes straight on."""
        lens, (z1, near, wavelength) = self.view.lens, self._lengths
        assert isinstance(self.view.optics, Camera)
        panel, radius = self.view.optics.panel, float(lens.stop_diameter) / 2
        image, focus = float(lens.image_distance), float(lens.focus_distance)
        steepest = []
        for axis, on_sensor in enumerate(seen):
            half = (panel.shape[axis] / 2 + 1) * panel.pitch
            rates = [
                rate - x / focus - u / image
                for x in (-radius, radius)
                for u in (on_sensor.min(), on_sensor.max())
                for rate in (
                    (x - half) / z1,
                    (x + half) / z1,
                    (x * near + self._tilt(axis)) / (1 + z1 * near),
                )
            ]
            steepest.append(max(map(abs, rates)))
        # An edge's light begins to turn within a Fresnel zone.
        own = 4 / math.sqrt(wavelength * z1)
        if lens.aberrations or lens.kind != "thin":
            own += _steepest(self.view, radius)
        return 2 * np.pi / wavelength * math.hypot(*steepest) + own


# Judges of free space


@dataclass(frozen=True)
class Beam:
    """A round Gaussian exp(-(r / waist)²) on the axis, and its exact scalar field anywhere.

    Its spectrum's Hankel integral, in the angle of travelling waves and, beyond, in the decay
    of evanescent ones: neither has a root where they meet. Going back, both are conjugate or
    die as well.
    """

    waist: float

    def samples(self, plane: Plane) -> NDArray[np.complex128]:
        y, x = (positions(n, p) for n, p in zip(plane.shape, plane.pitch, strict=True))
        return np.exp(-np.add.outer(y**2, x**2) / self.waist**2).astype(complex)

    def field(self, points: Points, *, paraxial: bool) -> NDArray[np.complex128]:
        """Without exp(i k distance); all points lie at one distance."""
        assert not paraxial
        assert not points.depth.any()
        r, z, k = np.hypot(points.y, points.x), points.distance, 2 * np.pi / points.wavelength
        steepest = 2 * 6.2 / self.waist
        sine = min(steepest / k, 1.0)
        angle, weight = _from_zero(math.asin(sine), k * (abs(z) + float(r.max())))
        total = _times(
            scipy.special.j0(np.outer(r, k * np.sin(angle))),
            weight
            * self._spectrum(k * np.sin(angle))
            * (k**2 * np.sin(angle) * np.cos(angle))
            * np.exp(-1j * k * z * 2 * np.sin(angle / 2) ** 2),
        )
        if steepest <= k:
            return total
        rise, weight = _from_zero(math.acosh(steepest / k), steepest * (abs(z) + float(r.max())))
        dying = _times(
            scipy.special.j0(np.outer(r, k * np.cosh(rise))),
            weight
            * self._spectrum(k * np.cosh(rise))
            * (k**2 * np.cosh(rise) * np.sinh(rise))
            * np.exp(-k * abs(z) * np.sinh(rise)),
        )
        return total + np.exp(-1j * k * z) * dying

    def _spectrum(self, across: Array) -> Array:
        """Over radians a metre, with all factors of the integral over across d across J0."""
        return np.asarray(self.waist**2 / 2 * np.exp(-((across * self.waist / 2) ** 2)))


def _from_zero(end: float, turn: float) -> tuple[Array, Array]:
    """Nodes and weights from 0 to an end, for a phase that turns by so many radians a unit."""
    nodes, weights = gauss(_count(end, turn))
    return (nodes + 1) * end / 2, weights * end / 2


@dataclass(frozen=True)
class Edges(Cells):
    """Cells whose scalar field is exact at any distance, however near: an integral along edges.

    With P the point, r its distance and phi an angle around it in the cell's plane, Rayleigh and
    Sommerfeld's integral over a cell is (A. Rubinowicz 1917, for a plane wave)

        U(P) = 1 / (2 pi) times the integral of 1 - (z / r) exp(i k (r - z)) over d phi

    around the cell's boundary: its integrand is a derivative along the radius. A piece of an
    edge that lies d away in the plane has d phi = d dt / (d² + t²), and t = d sinh(s) makes
    that smooth at any d.
    """

    def field(self, points: Points, *, paraxial: bool) -> NDArray[np.complex128]:
        if paraxial:
            return super().field(points, paraxial=True)
        k, value = 2 * np.pi / points.wavelength, np.zeros(points.y.size, dtype=complex)
        rows, columns = (self.values.any(axis=axis) for axis in (1, 0))
        middles = (
            self.plane.coordinates(0).numpy()[rows],
            self.plane.coordinates(1).numpy()[columns],
        )
        lit = self.values[np.ix_(rows, columns)]
        for number, (y, x, z) in enumerate(zip(points.y, points.x, points.z, strict=True)):
            (low_y, high_y), (low_x, high_x) = (
                (middle - side / 2 - at, middle + side / 2 - at)
                for middle, side, at in zip(middles, self.sides, (y, x), strict=True)
            )
            sent = sum(
                sign * _corner(k, abs(z), v[:, None], u)
                for sign, v, u in ((1, high_y, high_x), (-1, low_y, high_x),
                                   (-1, high_y, low_x), (1, low_y, low_x))
            )  # fmt: skip
            value[number] = np.sum(lit * (sent if z > 0 else np.conj(sent)))
        return points.turn * value


def _corner(k: float, z: float, y: Array, x: Array) -> NDArray[np.complex128]:
    """What the quarter plane from a point to a corner at (y, x) sends to it, up to its signs."""
    y, x = np.broadcast_arrays(y, x)
    return _edge(k, z, y, x) + _edge(k, z, x, y)


def _edge(k: float, z: float, away: Array, along: Array) -> NDArray[np.complex128]:
    """The integral over d phi of 1 - (z / r) exp(i k (r - z)) from 0 to `along` on an edge."""
    d = np.abs(away)
    least = np.where(d > 0, d, 1.0)
    end = np.arcsinh(np.abs(along) / least)
    r = np.sqrt(z**2 + away**2 + along**2)
    # The path is steepest at the end: its slope in s is (away² + along²)^(1/2) along / r.
    steepest = k * np.hypot(away, along) * np.abs(along) / r
    nodes, weights = gauss(_count(2.0, float((end / 2 * (steepest + 4)).max())))
    s = end[..., None] * (nodes + 1) / 2
    rho2 = (least[..., None] * np.cosh(s)) ** 2
    r = np.sqrt(z**2 + rho2)
    turn = k * rho2 / (r + z)
    lost = rho2 / (r * (r + z)) - z / r * 2j * np.sin(turn / 2) * np.exp(0.5j * turn)
    total = np.sum(weights * lost / np.cosh(s), axis=-1) * end / 2
    sign = np.sign(away) * np.sign(along) / (2 * np.pi)
    return np.asarray(np.where(d > 0, sign * total, 0))


def direct_field(
    samples: NDArray[Any], plane: Plane, points: Points, *, paraxial: bool = False
) -> NDArray[np.complex128]:
    """The diffraction integral as a sum over samples, in extended precision.

    Rayleigh and Sommerfeld's first kernel, or Fresnel's; no node but the samples.
    """
    y, x = (
        positions(n, p, float(c)).astype(np.longdouble)
        for n, p, c in zip(plane.shape, plane.pitch, plane.centre, strict=True)
    )
    wavelength = np.longdouble(points.wavelength)
    value = np.zeros(points.y.size, dtype=complex)
    for number, (v, u, z) in enumerate(zip(points.y, points.x, points.z, strict=True)):
        rho2 = np.add.outer((y - v) ** 2, (x - u) ** 2)
        far = np.longdouble(abs(z))
        if paraxial:
            kernel = _phasor(rho2 / (2 * wavelength * far) - 0.25) / float(wavelength * far)
        else:
            r = np.sqrt(far**2 + rho2)
            front = (1 / r - 2j * np.pi / wavelength) * far / (2 * np.pi * r**2)
            kernel = front.astype(complex) * _phasor((r - far) / wavelength)
        value[number] = np.sum(samples * (kernel if z > 0 else kernel.conj()))
    return points.turn * value * plane.pitch[0] * plane.pitch[1]
