"""Judges of patterns seen from several depths: OTFs of point-like pixels, and exact spheres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from judges.basics import positions
from judges.sums import Array, gauss, phasor
from optics.camera import Camera


def by_points(
    camera: Camera,
    wavelength: float,
    phase: Any,
    dioptre: float,
    samples: Array,
    size: int,
    middle: float = 0.0,
) -> NDArray[np.complex128]:
    """Direct sums over all panel pixels, and over all samples of the light

    The OTF on (size, size // 2 + 1) frequencies, behind pixels that are points, of a lens that is
    focused at infinity. samples: evenly spaced, in sensor pixels. middle: panel pixels from the
    origin pixel to the point that light and depth are seen from.
    """
    panel, scale = camera.panel, wavelength * float(camera.lens.focal_length)
    y, x = (positions(n, panel.pitch, -middle * panel.pitch) for n in panel.shape)
    y, x = y.astype(np.longdouble), x.astype(np.longdouble)
    turns = np.asarray(phase, np.longdouble) / (8 * np.arctan(np.longdouble(1)))
    turns = turns + dioptre * (y[:, None] ** 2 + x**2) / (2 * np.longdouble(wavelength))
    wave, u = phasor(turns), samples * camera.sensor.pitch
    field = phasor(-np.outer(u, y) / scale) @ wave @ phasor(-np.outer(x, u) / scale)
    step = panel.pitch * (u[1] - u[0]) / scale
    light = np.abs(field) ** 2 * step**2 / wave.size
    rows = phasor(-np.outer(np.fft.fftfreq(size), samples))
    return rows @ light @ phasor(-np.outer(samples, np.fft.rfftfreq(size)))


def by_spheres(
    camera: Camera, wavelength: float, phase: Any, distance: float, places: Array, exact: bool
) -> Array:
    """Gauss-Legendre over every panel pixel, with sqrt(d² + r²) - d in extended precision

    The light's density at places (v, u) = (place, place) metres on the sensor, times the pixel's
    area. The lens takes the parabola of its focus away. exact: whether the object's wave is a
    sphere, amplitude included, instead of a parabola.
    """
    panel, scale = camera.panel, wavelength * float(camera.lens.image_distance)
    side = np.sqrt(panel.fill_factor) * panel.pitch
    inner, weights = gauss(12)
    y, x = (
        (positions(n, panel.pitch)[:, None] + inner * side / 2).ravel().astype(np.longdouble)
        for n in panel.shape
    )
    square, d = y[:, None] ** 2 + x**2, np.longdouble(distance)
    r = np.sqrt(d**2 + square)
    path = r - d if exact else square / (2 * d)
    path = path - square / (2 * np.longdouble(float(camera.lens.focus_distance)))
    shown = np.kron(np.exp(1j * np.asarray(phase, np.float64)), np.ones((len(inner),) * 2))
    wave = shown * phasor(path / np.longdouble(wavelength))
    if exact:
        wave = wave * (d / r).astype(float)
    wy, wx = (np.tile(weights * side / 2, n) for n in panel.shape)
    rows, columns = phasor(-np.outer(places, y) / scale) * wy, phasor(-np.outer(x, places) / scale)
    field = rows @ wave @ (columns * wx[:, None])
    area = np.prod(panel.shape) * side**2
    return np.abs(field) ** 2 * camera.sensor.pitch**2 / (scale**2 * area)
