"""A point's light through panel, space, stop, lens and space, by sums over nodes in numpy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from judges.basics import positions
from optics.camera import Camera

Array = NDArray[np.float64]


def disc_nodes(radius: float, rings: int) -> tuple[Array, Array, Array]:
    """Places (y, x) in a disc and their weights: Gauss-Legendre radii, evenly spaced angles."""
    t, w = np.polynomial.legendre.leggauss(rings)
    r, w = radius * (t + 1) / 2, radius * w / 2
    angle = 2 * np.pi * np.arange(3 * rings) / (3 * rings)
    y, x = r[:, None] * np.sin(angle), r[:, None] * np.cos(angle)
    weight = np.repeat((w * r)[:, None], angle.size, axis=1) * (2 * np.pi / angle.size)
    return y.ravel(), x.ravel(), weight.ravel()


def open_power(camera: Camera) -> float:
    """Square metres of pixels in the overlap of panel and round stop, by slices."""
    radius, panel = camera.lens.stop_diameter / 2, camera.panel
    (y0, y1), (x0, x1) = (
        ((-(n // 2) - 0.5) * panel.pitch, (n - n // 2 - 0.5) * panel.pitch) for n in panel.shape
    )
    y = np.linspace(max(y0, -radius), min(y1, radius), 200001)
    half = np.sqrt(np.clip(radius**2 - y**2, 0, None))
    open_ = np.clip(np.minimum(x1, half) - np.maximum(x0, -half), 0, None)
    return float(np.trapezoid(open_, y)) * panel.fill_factor


def direct_chain(
    camera: Camera,
    modulation: NDArray[np.complex128],
    distance: float,
    wavelength: float,
    y: Array,
    x: Array,
    *,
    field: tuple[float, float] = (0.0, 0.0),
    sphere: bool = False,
    across_pixel: int = 6,
    rings: int = 45,
) -> Array:
    """Share of the light per square metre at sensor places y and x from the image point.

    Thesis Eq. 5.1 to 5.7, without any of their global phases. A round, clear stop; spherical
    aberration (4, 0) and none else.
    """
    lens, z1, z2 = camera.lens, camera.separation, camera.lens.image_distance
    panel, wave = camera.panel, np.pi / wavelength
    nodes, weights = np.polynomial.legendre.leggauss(across_pixel)
    half = panel.active_side / 2
    sy, sx = ((positions(n, panel.pitch)[:, None] + half * nodes).ravel() for n in panel.shape)
    wy, wx = (np.tile(half * weights, n) for n in panel.shape)
    lit = np.kron(modulation, np.ones((across_pixel, across_pixel))) * np.outer(wy, wx)
    lit = lit * _wave(sy[:, None], sx[None, :], distance, wavelength, field, z1, z2, sphere)
    ly, lx, lw = disc_nodes(lens.stop_diameter / 2, rings)
    down = np.exp(1j * wave / z1 * (ly[:, None] - sy) ** 2)
    along = np.exp(1j * wave / z1 * (lx[:, None] - sx) ** 2)
    at_lens = ((down @ lit) * along).sum(axis=1) / (wavelength * z1)
    at_lens = at_lens * np.exp(-1j * wave / lens.focal_length * (ly**2 + lx**2))
    r2 = (ly**2 + lx**2) / (lens.stop_diameter / 2) ** 2
    for n, m, path in lens.aberrations:
        assert (n, m) == (4, 0)
        at_lens = at_lens * np.exp(2j * wave * path * math.sqrt(5) * (6 * r2**2 - 6 * r2 + 1))
    down = np.exp(1j * wave / z2 * ((y + field[0])[:, None] - ly) ** 2)
    along = np.exp(1j * wave / z2 * ((x + field[1])[:, None] - lx) ** 2)
    found = (down * (at_lens * lw)) @ along.T / (wavelength * z2)
    return np.asarray(np.abs(found) ** 2 / open_power(camera))


def _wave(y, x, distance, wavelength, field, z1, z2, sphere):
    """The point's wave over the panel: a parabola, or the sphere of Eq. 5.1."""
    if not sphere:
        # The object stands at -field (d + z1) / z2; divided by d for the limit of a far one.
        ty, tx = (-f / z2 * (1 + z1 / distance) for f in field)
        path = (y**2 + x**2) / (2 * distance) - (ty * y + tx * x)
        return np.exp(2j * np.pi / wavelength * path)
    # The chief ray through the middle of the lens has the sines field / z2.
    py, px = y + z1 * field[0] / z2, x + z1 * field[1] / z2
    cosine = math.sqrt(1 - (field[0] ** 2 + field[1] ** 2) / z2**2)
    if math.isinf(distance):
        turns = (py * field[0] + px * field[1]) / z2 / wavelength
        return cosine * np.exp(2j * np.pi * turns)
    oy, ox = (-f / z2 * distance / cosine for f in field)
    r = np.sqrt((py - oy) ** 2 + (px - ox) ** 2 + distance**2)
    return distance / r * np.exp(2j * np.pi / wavelength * (r - distance / cosine))
