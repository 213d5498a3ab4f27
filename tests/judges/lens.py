"""Judges of a lens: sums over its open stop, and closed forms of some stops."""

from __future__ import annotations

import numpy as np
import scipy.special

from judges.pixels import lines_of, on_pixels, scale_of
from judges.stops import scan_lines
from judges.sums import Array, gauss, node_count, phasor, times
from judges.view import View
from judges.wave import steepest, waves
from optics.camera.stop import Polygon


def by_lines(view: View) -> Array:
    """Gauss-Legendre along the lines that the stop leaves open"""
    lens, scale = view.lens, scale_of(view)
    radius = float(lens.stop_diameter) / 2
    v, u, wv, wu = lines_of(view)
    lines = scan_lines(lens.stop, steepest(view, radius) * radius)
    heights = np.array([y for y, _, _ in lines]) * radius
    lengths = [x.size for _, x, _ in lines]
    y, x = np.repeat(heights, lengths), np.concatenate([x for _, x, _ in lines]) * radius
    wave = phasor(waves(view, y, x)) * np.concatenate([weight for _, _, weight in lines])
    ends = np.cumsum(lengths)[:-1]
    rows = [
        times(np.exp(-2j * np.pi / scale * np.outer(u, at)), part)
        for at, part in zip(np.split(x, ends), np.split(wave, ends), strict=True)
    ]
    field = np.exp(-2j * np.pi / scale * np.outer(v, heights)) @ np.array(rows)
    area = sum(float(w.sum()) for _, _, w in lines)
    density = np.abs(field) ** 2 * radius**2 / (scale**2 * area)
    return on_pixels(view, density, wv, wu)


def by_rings(view: View) -> Array:
    """Gauss-Legendre along the radius of the stop, with J0"""
    lens, scale = view.lens, scale_of(view)
    radius = float(lens.stop_diameter) / 2
    assert lens.stop.annulus_radii is not None
    inner, outer = lens.stop.annulus_radii
    v, u, wv, wu = lines_of(view)
    s, place = np.unique(np.hypot(v[:, None], u), return_inverse=True)
    nodes, weights = gauss(node_count(outer - inner, steepest(view, radius) * radius))
    r = inner + (outer - inner) * (nodes + 1) / 2
    weights = weights * (outer - inner) / 2 * 2 * np.pi * r
    wave = weights * phasor(waves(view, 0 * r, r * radius))
    parts = np.array_split(s, max(1, s.size * r.size // 1_000_000))
    field = np.concatenate(
        [
            times(scipy.special.j0(2 * np.pi * radius / scale * np.outer(part, r)), wave)
            for part in parts
        ]
    )
    area = np.pi * (outer**2 - inner**2)
    density = np.abs(field) ** 2 * radius**2 / (scale**2 * area)
    return on_pixels(view, density[place].reshape(v.size, u.size), wv, wu)


def by_airy(view: View) -> Array:
    """Airy's (2 J1(v) / v)², less that of the obscuration"""
    lens, scale = view.lens, scale_of(view)
    radius = float(lens.stop_diameter) / 2
    assert lens.stop.annulus_radii is not None
    inner, outer = lens.stop.annulus_radii
    v, u, wv, wu = lines_of(view)
    s = np.hypot(v[:, None], u)

    def disc(r: float) -> Array:
        argument = 2 * np.pi * r * s / scale
        safe = np.where(argument > 0, argument, 1)
        return np.pi * r**2 * np.where(argument > 0, 2 * scipy.special.j1(safe) / safe, 1)

    field = disc(outer * radius) - (disc(inner * radius) if inner else 0)
    density = field**2 / (scale**2 * np.pi * radius**2 * (outer**2 - inner**2))
    return on_pixels(view, density, wv, wu)


def by_fresnel(view: View) -> Array:
    """Fresnel's integrals along each side of a rectangle"""
    lens, scale = view.lens, scale_of(view)
    assert lens.stop.rectangle_bounds is not None
    radius = float(lens.stop_diameter) / 2
    vergence = 1 / view.distance - 1 / lens.focus_distance
    y0, y1, x0, x1 = (side * radius for side in lens.stop.rectangle_bounds)
    v, u, wv, wu = lines_of(view)

    def line(at: Array, low: float, high: float) -> Array:
        if vergence == 0:
            return ((high - low) * np.sinc((high - low) * at / scale)) ** 2
        stretch = np.sqrt(2 * abs(vergence) / view.wavelength)
        shift = at / (vergence * lens.image_distance)
        s1, c1 = scipy.special.fresnel(stretch * (high - shift))
        s0, c0 = scipy.special.fresnel(stretch * (low - shift))
        return np.asarray(((c1 - c0) ** 2 + (s1 - s0) ** 2) / stretch**2)

    density = np.outer(line(v, y0, y1), line(u, x0, x1)) / (scale**2 * (y1 - y0) * (x1 - x0))
    return on_pixels(view, density, wv, wu)


def by_edges(view: View) -> Array:
    """the closed form of a polygon's edges (Lee and Mittra 1983)"""
    lens, scale = view.lens, scale_of(view)
    radius = float(lens.stop_diameter) / 2
    opening = lens.stop.opening
    assert isinstance(opening, Polygon)
    corners = np.array(opening.corners) * radius
    v, u, wv, wu = lines_of(view)
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
    return on_pixels(view, np.abs(field) ** 2 / (scale**2 * area), wv, wu)
