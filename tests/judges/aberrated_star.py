"""A star seen by a lens with field aberrations: a direct sum of waves for each point of its disc.

The wave of a point is summed over the open pupil by Kirchhoff's integral, in numpy alone, with the
aberration in the polar form of Hopkins and Welford.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from simulator.scene import Star

Array = NDArray[np.float64]

_PUPIL, _FINER = 96, 4
"""Samples across the pupil, and rings of the disc in a diffraction spot."""


def aberrated_star(star: Star, camera: Camera, wavelength: float, shape, pitch: float) -> Array:
    """Irradiance at the samples' middles, whose sum over the infinite plane is 1.

    The axis is at n // 2. The panel is at the lens, its pattern flat, and its side orders aren't
    there: each pixel's active area spreads the light by its own diffraction.
    """
    y, x = ((np.arange(n) - n // 2) * pitch for n in shape)
    scale = camera.magnification(star.distance)
    total = np.zeros(shape)
    spot = wavelength * float(camera.lens.image_distance / camera.lens.stop_diameter)
    radius, open_ = star.diameter / 2 * scale, _open_shares(camera)
    for py, px, share in _points(radius, 2 + math.ceil(_FINER * radius / spot)):
        place = star.offset[0] * scale + py, star.offset[1] * scale + px
        total += share * _psf(camera, open_, wavelength, place, y - place[0], x - place[1])
    return total * pitch**2


def _points(radius: float, rings: int) -> list[tuple[float, float, float]]:
    """Over a disc, by rings of even width: (y, x, share)."""
    found = []
    for ring in range(rings):
        r, n = radius * (ring + 0.5) / rings, 6 * ring + 3
        for k in range(n):
            t = 2 * np.pi * k / n
            share = (2 * ring + 1) / rings**2 / n
            found.append((float(r * np.sin(t)), float(r * np.cos(t)), share))
    return found


def _places(camera: Camera) -> tuple[Array, float]:
    """Metres across the pupil, and the width of a sample."""
    radius = float(camera.lens.stop_diameter) / 2
    side = 2 * radius / _PUPIL
    return (np.arange(_PUPIL) + 0.5) * side - radius, side


def _open_shares(camera: Camera) -> Array:
    """Of each sample in the pupil, what the stop and the panel leave of it."""
    (q, side), radius = _places(camera), float(camera.lens.stop_diameter) / 2
    inner = (np.arange(8) + 0.5) / 8 - 0.5
    fv, fu = ((q[:, None] + inner * side).ravel() / radius for _ in range(2))
    open_ = (fv[:, None] ** 2 + fu**2 <= 1).reshape(_PUPIL, 8, _PUPIL, 8).mean((1, 3))
    # The panel's rows and columns lie around its middle pixel, which is at n // 2.
    for axis, n in enumerate(camera.panel.shape):
        low, high = ((edge - n // 2 - 0.5) * camera.panel.pitch for edge in (0, n))
        inside = np.clip(np.minimum(q + side / 2, high) - np.maximum(q - side / 2, low), 0, side)
        open_ = open_ * (inside[:, None] if axis == 0 else inside) / side
    return np.asarray(open_)


def _psf(camera: Camera, open_: Array, wavelength: float, place, y: Array, x: Array) -> Array:
    """Power per area at points (y, x) from the paraxial image of unit power."""
    lens, panel, (q, side) = camera.lens, camera.panel, _places(camera)
    radius, z = float(lens.stop_diameter) / 2, float(lens.image_distance)
    v, u = q[:, None] / radius, q / radius
    power = (open_**2).sum() * side**2
    wave = open_ * np.exp(2j * np.pi / wavelength * _path(lens.field_aberrations, place, v, u))
    ways = [np.exp(-2j * np.pi / wavelength / z * np.outer(at, q)) for at in (y, x)]
    field = ways[0] @ wave @ ways[1].T * side**2 / (wavelength * z)
    active = np.sqrt(panel.fill_factor) * panel.pitch / (wavelength * z)
    spread = np.sinc(active * y)[:, None] ** 2 * np.sinc(active * x) ** 2
    return np.asarray(np.abs(field) ** 2 / power * spread)


def _path(by, place, v: Array, u: Array) -> Array:
    """W131 H r³ cos t + W222 H² r² cos² t + W220 H² r², t from the direction of the image."""
    if by is None:
        return np.zeros(np.broadcast_shapes(v.shape, u.shape))
    h = np.hypot(*place) / by.height
    r, t = np.hypot(v, u), np.arctan2(v, u) - np.arctan2(*place)
    return np.asarray(
        by.coma * h * r**3 * np.cos(t)
        + by.astigmatism * h**2 * (r * np.cos(t)) ** 2
        + by.curvature * h**2 * r**2
    )
