"""The wave in the pupil, by the formulas of the textbooks, in extended precision."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from judges.pixels import lines_of, scale_of
from judges.view import View
from optics.camera import Lens


def explicit_zernike(n: int, m: int, y: Any, x: Any, real: Any = np.longdouble) -> Any:
    """Born and Wolf 9.2.1 (5), factorials and all, in whole numbers and extended precision."""
    order = abs(m)
    y, x = np.asarray(y, real), np.asarray(x, real)
    r = np.hypot(y, x)
    square, radial = r * r, np.zeros_like(r)
    for k in range((n - order) // 2 + 1):
        term = (-1) ** k * math.comb(n - k, k) * math.comb(n - 2 * k, (n - order) // 2 - k)
        # Horner's scheme: in extended precision, powers take forty times longer.
        radial = radial * square + real(term)
    radial = np.sqrt(real((2 if m else 1) * (n + 1))) * radial
    if order == 0:
        return radial
    angle = np.arctan2(y, x)
    turn = np.cos(order * angle) if m >= 0 else np.sin(order * angle)
    return radial * r**order * turn


def turns(
    lens: Lens, distance: float, wavelength: float, y: Any, x: Any, real: Any = np.longdouble
) -> Any:
    """Waves of path at (y, x) in metres in the pupil, extended precision, by the textbooks'
    formulas: a parabola, or spheres as they are. real: of the aberrations."""
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
            n, m, y / radius, x / radius, real
        )
    return path / np.longdouble(float(wavelength))


def waves(view: View, y: Any, x: Any, real: Any = np.longdouble) -> Any:
    """turns(), and those of a plate before the lens."""
    waves = turns(view.lens, view.distance, view.wavelength, y, x, real)
    if callable(view.phase):
        waves = waves + np.asarray(view.phase(y, x), np.longdouble) / (2 * np.pi)
    return waves


def steepest(view: View, radius: float) -> float:
    """Radians per metre of the wave within `radius`, on a raster, and of the kernel."""
    grid = np.linspace(-radius, radius, 201)
    inside = np.hypot(grid[:, None], grid) <= radius * 1.001
    # Digits for a slope; in extended precision, it takes ten times as long.
    wave = waves(view, *np.broadcast_arrays(grid[:, None], grid[None, :]), np.float64)
    wave = np.where(inside, np.asarray(wave, np.float64), np.nan)
    slopes = [np.nanmax(np.abs(np.diff(wave, axis=axis))) / (grid[1] - grid[0]) for axis in (0, 1)]
    v, u, _, _ = lines_of(view)
    tilt = math.hypot(np.abs(v).max(), np.abs(u).max()) / scale_of(view)
    return 2 * np.pi * (1.2 * math.hypot(*slopes) + tilt)
