"""Pictures by direct quadrature: the slow judges of the fast engine.

They share no code with the engine. For a star, the Fraunhofer integral is summed term by term in
double precision (as two matrix products, which is the same sum), wavelength, star and
pixel are integrated by midpoint and Simpson rules, and the panel's dispersion is
interpolated by Lagrange polynomials. Thesis Eq. 3.1, 2.17 and §5.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera, Panel

Picture = NDArray[np.float64]

_PER_PIXEL = 7
_MARGIN = 3
_SIMPSON = np.array([1, 4, 2, 4, 1]) / 3.0
_REACH = 2.5
"""Standard deviations of the filter's band that are integrated to either side."""


@dataclass(frozen=True)
class Star:
    """A uniform disc in focus; metres."""

    diameter: float
    distance: float


def star_picture(
    camera: Camera,
    grey: NDArray[np.uint8],
    wavelength: float,
    bandwidth: float,
    star: Star,
    window: int,
) -> Picture:
    """Light of the star on each pixel of a square window, in arbitrary units.

    bandwidth: of the filter's Gaussian band, full width at half maximum, metres.
    """
    sigma = bandwidth / np.sqrt(8 * np.log(2))
    offsets = np.linspace(-_REACH, _REACH, _SIMPSON.size)
    weights = _SIMPSON * np.exp(-(offsets**2) / 2)
    fine = sum(
        weight * _intensity(camera, grey, wavelength + offset * sigma, window)
        for offset, weight in zip(offsets, weights / weights.sum(), strict=True)
    )
    return _on_pixels(np.asarray(fine), camera, star, window)


def _intensity(camera: Camera, grey: NDArray[np.uint8], wavelength: float, window: int) -> Picture:
    """Modulated and unmodulated light at points _PER_PIXEL times finer than the pixels."""
    panel, sensor = camera.panel, camera.sensor
    scale = wavelength * camera.lens.image_distance
    count = (window + 2 * _MARGIN) * _PER_PIXEL
    # The centre of pixel n // 2 is the optical axis, and the middle of its own points.
    middle = (window // 2 + _MARGIN) * _PER_PIXEL + _PER_PIXEL // 2
    points = (np.arange(count) - middle) * sensor.pitch / _PER_PIXEL
    side = np.sqrt(panel.fill_factor) * panel.pitch
    envelope = np.sinc(points * side / scale)
    kernels = [
        np.exp(-2j * np.pi / scale * np.outer(points, _positions(n, panel.pitch)))
        * envelope[:, None]
        for n in panel.shape
    ]
    phase = grey * (_highest_phase(panel, wavelength) / (panel.levels - 1))
    straight = np.ones(panel.shape, dtype=complex)
    parts = [
        np.abs(kernels[0] @ pupil @ kernels[1].T) ** 2 for pupil in (np.exp(1j * phase), straight)
    ]
    return (1 - panel.unmodulated) * parts[0] + panel.unmodulated * parts[1]


def _positions(count: int, pitch: float) -> Picture:
    return (np.arange(count, dtype=np.float64) - count // 2) * pitch


def _highest_phase(panel: Panel, wavelength: float) -> float:
    """Lagrange interpolation of the optical path in one over wavelength squared."""
    path = 0.0
    for i, (w_i, phase_i) in enumerate(panel.max_phase):
        term = phase_i * w_i
        for j, (w_j, _) in enumerate(panel.max_phase):
            if i != j:
                term *= (wavelength**-2 - w_j**-2) / (w_i**-2 - w_j**-2)
        path += term
    return path / wavelength


def _on_pixels(fine: Picture, camera: Camera, star: Star, window: int) -> Picture:
    """Sum over the pixel's square and the star's disc, both cut into the fine points."""
    step = camera.sensor.pitch / _PER_PIXEL
    radius = star.diameter * camera.lens.image_distance / star.distance / 2 / step
    disc = _disc(radius)
    reach = disc.shape[0] // 2
    assert reach < _MARGIN * _PER_PIXEL
    blurred = np.zeros_like(fine)
    for (dy, dx), weight in np.ndenumerate(disc):
        shift = (dy - reach, dx - reach)
        blurred += weight * np.roll(fine, shift, axis=(0, 1))
    whole = window + 2 * _MARGIN
    pixels = blurred.reshape(whole, _PER_PIXEL, whole, _PER_PIXEL).sum(axis=(1, 3))
    return pixels[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]


def _disc(radius: float, cuts: int = 16) -> Picture:
    """Area of a disc in each cell of a grid, from cuts x cuts points a cell; sum one."""
    reach = int(np.ceil(radius + 0.5))
    cells = 2 * reach + 1
    points = (np.arange(cells * cuts) + 0.5) / cuts - cells / 2
    inside = (points[:, None] ** 2 + points[None, :] ** 2 <= radius**2).astype(float)
    area = inside.reshape(cells, cuts, cells, cuts).sum(axis=(1, 3))
    return area / area.sum()
