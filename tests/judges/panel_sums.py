"""A panel in the lens' plane by sums in numpy: a row of strips in closed form, and pictures."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from judges.basics import positions
from optics.camera import Camera

Array = NDArray[np.float64]


def line_density(camera: Camera, n: int, wavelength: float, u: float) -> float:
    """Share of light per metre behind n open strips in a row: grating times envelope."""
    pitch, scale = camera.panel.pitch, wavelength * camera.lens.image_distance
    side = math.sqrt(camera.panel.fill_factor) * pitch
    angle = np.pi * pitch * u / scale
    waves = n if np.sin(angle) == 0 else np.sin(n * angle) / np.sin(angle)
    return float(side / (n * scale) * (waves * np.sinc(side * u / scale)) ** 2)


def line_share(camera: Camera, n: int, wavelength: float, low: float, high: float) -> float:
    """Integral of line_density from low to high, by the midpoint rule at 60 points a fringe."""
    fringe = wavelength * camera.lens.image_distance / (n * camera.panel.pitch)
    points = math.ceil((high - low) / fringe * 60)
    u = low + (np.arange(points) + 0.5) * (high - low) / points
    total = sum(line_density(camera, n, wavelength, x) for x in u)
    return total * (high - low) / points


def _gauss(points: int) -> tuple[Array, Array]:
    """Gauss-Legendre nodes and weights on a unit interval around zero."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes / 2, weights / 2


def quadrature_psf(
    camera: Camera,
    phase: Array,
    distance: float,
    wavelength: float,
    shape: tuple[int, int],
    *,
    across_panel_pixel: int = 6,
    across_sensor_pixel: int = 8,
) -> Array:
    """Light on sensor pixels by Gauss-Legendre quadrature over panel and sensor pixels.

    The defocus varies inside a panel pixel, and nothing is periodic. No stop.
    """
    panel, z, p = camera.panel, camera.lens.image_distance, camera.sensor.pitch
    side = math.sqrt(panel.fill_factor) * panel.pitch
    inner, weight = _gauss(across_panel_pixel)
    y, x = ((positions(n, panel.pitch)[:, None] + inner * side).ravel() for n in panel.shape)
    wy, wx = (np.tile(weight * side, n) for n in panel.shape)
    vergence = 1 / distance - 1 / camera.lens.focus_distance
    wave = np.exp(1j * np.pi / wavelength * vergence * (y[:, None] ** 2 + x[None, :] ** 2))
    wave *= np.exp(1j * np.kron(phase, np.ones((across_panel_pixel, across_panel_pixel))))
    wave *= wy[:, None] * wx[None, :]
    outer, share = _gauss(across_sensor_pixel)
    v, u = ((positions(n, p)[:, None] + outer * p).ravel() for n in shape)
    scale = wavelength * z
    field = np.exp(-2j * np.pi / scale * np.outer(v, y)) @ wave
    field = field @ np.exp(-2j * np.pi / scale * np.outer(x, u))
    power = phase.size * side**2
    density = np.abs(field) ** 2 / scale**2 / power
    blocks = density.reshape(shape[0], across_sensor_pixel, shape[1], across_sensor_pixel)
    return np.einsum("iajb,a,b->ij", blocks, share * p, share * p)
