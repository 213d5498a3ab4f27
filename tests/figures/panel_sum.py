"""The light behind a panel in the lens' plane, by a sum over its pixels in numpy."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from optics.camera import Camera
from optics.plane import Plane

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_PANEL_NODES, _SENSOR_NODES = 12, 8
"""Gauss-Legendre nodes along a side of a pixel: their error is below 1e-9 where the wave turns by
a cycle within a panel pixel, and the light by two within a sensor pixel."""


class PanelSum:
    """The PSF of patterns at some rows and columns of a window, in double precision.

    The wave of an object is a parabola over the panel, which is a product along y and x, so that
    the integral over every pixel is one, too. The stop must not cut the panel; no light may be
    unmodulated.
    """

    def __init__(
        self,
        camera: Camera,
        distance: float,
        wavelength: float,
        pixels: Plane,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        integrate: bool,
    ) -> None:
        assert not camera.panel.unmodulated
        assert math.hypot(*(n + 1 for n in camera.panel.shape)) * camera.panel.pitch <= float(
            camera.lens.stop_diameter
        )
        self._lines = rows, columns
        nodes = np.polynomial.legendre.leggauss(_SENSOR_NODES) if integrate else ([0.0], [2.0])
        places, self._weights = np.asarray(nodes[0]) / 2, np.asarray(nodes[1]) / 2
        waves = math.pi / wavelength * (1 / distance - 1 / float(camera.lens.focus_distance))
        scale = wavelength * float(camera.lens.image_distance)
        self._kernels = []
        for axis, numbers in enumerate(self._lines):
            n, pitch = pixels.shape[axis], pixels.pitch[axis]
            samples = ((numbers - n // 2)[:, None] + places).ravel() * pitch
            self._kernels.append(_pixel_integrals(camera, axis, samples / scale, waves))
        side = math.sqrt(camera.panel.fill_factor) * camera.panel.pitch
        area = math.prod(pixels.pitch)
        self._factor = area / (scale**2 * math.prod(camera.panel.shape) * side**2)

    def __call__(self, phase: torch.Tensor) -> Array:
        """Return the light of a pattern, (rows, columns)."""
        y, x = self._kernels
        field = y @ np.exp(1j * phase.double().numpy()) @ x.T
        density = (field.real**2 + field.imag**2) * self._factor
        rows, columns = (len(one) for one in self._lines)
        count = len(self._weights)
        blocks = density.reshape(rows, count, columns, count)
        return np.einsum("iajb,a,b->ij", blocks, self._weights, self._weights)

    def error(self, light: torch.Tensor, phase: torch.Tensor) -> float:
        """Return the relative L2 error of a pattern's PSF at the rows and columns."""
        truth = self(phase)
        found = light.double().numpy()[np.ix_(*self._lines)]
        return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def _pixel_integrals(camera: Camera, axis: int, frequencies: Array, waves: float) -> Complex:
    """Integrals of exp(i waves y² - 2 pi i f y) over every panel pixel, (frequencies, pixels)."""
    n, pitch = camera.panel.shape[axis], camera.panel.pitch
    side = math.sqrt(camera.panel.fill_factor) * pitch
    centres = (np.arange(n) - n // 2) * pitch
    found = np.zeros((len(frequencies), n), dtype=np.complex128)
    for node, weight in zip(*np.polynomial.legendre.leggauss(_PANEL_NODES), strict=True):
        y = centres + node * side / 2
        bent = np.exp(1j * waves * y**2) * (weight * side / 2)
        found += np.exp(-2j * math.pi * np.outer(frequencies, y)) * bent
    return found
