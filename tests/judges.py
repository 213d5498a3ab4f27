"""Slow, independent ways to compute what optics computes: direct sums in numpy, float64."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera
from optics.plane import Plane

Array = NDArray[np.float64]


def relative(value: NDArray, truth: NDArray) -> float:
    """Relative L2 error."""
    value, truth = np.asarray(value), np.asarray(truth)
    return float(np.linalg.norm(value - truth) / np.linalg.norm(truth))


def positions(n: int, pitch: float, centre: float = 0.0) -> Array:
    """Sample positions with the origin at n // 2, written out."""
    return np.array([(i - n // 2) * pitch + centre for i in range(n)])


def direct_transform(field: NDArray, pupil: Plane, image: Plane, scale: float) -> NDArray:
    """Sum of f(y, x) exp(-2 pi i (y v + x u) / scale), one image sample after the other."""
    y = positions(pupil.shape[0], pupil.pitch[0], pupil.centre[0])[:, None]
    x = positions(pupil.shape[1], pupil.pitch[1], pupil.centre[1])[None, :]
    answer = np.empty(image.shape, dtype=np.complex128)
    for j, v in enumerate(positions(image.shape[0], image.pitch[0], image.centre[0])):
        for i, u in enumerate(positions(image.shape[1], image.pitch[1], image.centre[1])):
            answer[j, i] = np.sum(field * np.exp(-2j * np.pi * (y * v + x * u) / scale))
    return answer


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


def natural_image(rows: int, columns: int, seed: int) -> Array:
    """Noise with an amplitude spectrum that falls with frequency, and an edge; 0 to 1."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)[None, :]
    slope = 1 / np.maximum(np.hypot(fy, fx), 1 / max(rows, columns)) ** 1.2
    texture = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(rows, columns))) * slope, (rows, columns))
    texture /= texture.std()
    y, x = np.mgrid[:rows, :columns]
    texture = texture + 1.5 * ((x - columns / 2.2) ** 2 + (y - rows / 1.8) ** 2 < (rows / 4) ** 2)
    low, high = texture.min(), texture.max()
    return 0.05 + 0.9 * (texture - low) / (high - low)


def gaussian_psf(side: int, sigma: float) -> Array:
    """A normalised Gaussian around n // 2, sigma in samples."""
    x = positions(side, 1.0)
    g = np.exp(-(x**2) / (2 * sigma**2))
    return np.outer(g, g) / g.sum() ** 2


def binned(array: Array, factor: int) -> Array:
    """Sums over blocks of factor x factor samples."""
    rows, columns = (n // factor for n in array.shape)
    return array.reshape(rows, factor, columns, factor).sum((1, 3))
