"""The PSF behind a panel in its lens' plane, and its gradient, as products of matrices."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from labapp.accuracy.references.lens_integral import open_area_shares, sample_positions
from optics.camera import Camera
from optics.plane import Plane

Array = NDArray[np.float64]
Field = NDArray[np.complex128]

_SPARE_NODES = 8
"""Gauss-Legendre nodes across a panel pixel, beyond two for each wave across it; chosen. Twice as
many change the light by less than 1e-12."""


class PanelMatrices:
    """PSFs at pixels' centres, computed slowly and in double precision.

    The wave of an object under a thin lens is a parabola, a product along y and x. The integral
    over every panel pixel is one, too, and the PSF's field is the panel's modulation between two
    matrices. They hold the integrals of all pixels, by a sum over nodes.

    camera: its panel stands at its thin lens. Unmodulated light isn't added.
    distance, wavelength: metres.
    pixels: where the light is computed.
    """

    def __init__(self, camera: Camera, distance: float, wavelength: float, pixels: Plane) -> None:
        lens, panel = camera.lens, camera.panel
        self._camera, self._pixels = camera, pixels
        self._scale = wavelength * float(lens.image_distance)
        self._waves = (1 / distance - 1 / float(lens.focus_distance)) / (2 * wavelength)
        radius = float(lens.stop_diameter) / 2
        self._amplitude = open_area_shares(lens.stop, radius, panel.plane)
        power = self._amplitude.sum() * panel.active_side**2
        self._factor = math.prod(pixels.pitch) / (self._scale**2 * power)

    @cached_property
    def _matrices(self) -> tuple[Field, Field]:
        return self._integrals(0), self._integrals(1)

    def _integrals(self, axis: int) -> Field:
        """Integrate the PSF's kernel over each panel pixel along an axis: (samples, pixels)."""
        panel = self._camera.panel
        centres = sample_positions(panel.plane, axis)
        frequencies = sample_positions(self._pixels, axis) / self._scale
        slope = 2 * abs(self._waves) * np.abs(centres).max() + np.abs(frequencies).max()
        count = math.ceil(2 * slope * panel.active_side) + _SPARE_NODES
        found = np.zeros((frequencies.size, centres.size), dtype=np.complex128)
        for node, weight in zip(*np.polynomial.legendre.leggauss(count), strict=True):
            y = centres + node * panel.active_side / 2
            turns = self._waves * y**2 - np.outer(frequencies, y)
            found += weight * panel.active_side / 2 * np.exp(2j * math.pi * turns)
        return found

    def light(self, phase: Array) -> Array:
        """Return the PSF of a phase in radians, (rows, columns): shares of the light."""
        field = self._field(self._modulation(phase))
        return np.asarray(self._factor * (field.real**2 + field.imag**2))

    def gradient(self, phase: Array, weights: Array) -> Array:
        """Return the gradient in the panel's phase of the sum of weights times the PSF."""
        y, x = self._matrices
        modulation = self._modulation(phase)
        back = y.T @ (weights * self._field(modulation).conj()) @ x
        return np.asarray(-2 * self._factor * (modulation * back).imag)

    def _modulation(self, phase: Array) -> Field:
        return np.asarray(self._amplitude * np.exp(1j * phase))

    def _field(self, modulation: Field) -> Field:
        y, x = self._matrices
        return np.asarray(y @ modulation @ x.T)
