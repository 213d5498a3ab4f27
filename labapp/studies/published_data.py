"""Data that the thesis' authors published beside the thesis, and that studies compare with.

Source: github.com/cgtuebingen/computational_camera_phase_retrieval, MIT licence; see
labapp/data/studies/SOURCES.txt.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from labapp.files.picture.grey_picture import read_grey_picture
from labapp.files.reading import bundled_path
from optics.camera import Camera

RING_RADIUS_SAMPLES, _RING_WIDTH_SAMPLES = 30, 1.15
"""Radius and width (standard deviation) of the published ring, in samples of its PSF."""

_SIDE = 1920 * 8e-6
"""Side of the authors' panel in metres, which is also that of the square that they transform."""

RING_BAND = (20, 40)
"""Distances from the axis, in samples, between which the published ring's light is summed."""

RING_ENERGY: Mapping[int, float] = {1: 0.780, 10: 0.849, 100: 0.903, 569: 0.933}
"""Share of the light within the band by the number of iterations, for the published patterns.

Their PSFs are computed as the authors do it, by one Fourier transform of the pattern within
1920 x 1920 samples.
"""


def published_ring_sizes(camera: Camera, wavelength: float) -> tuple[float, float]:
    """Return the radius and width of the published ring on the sensor, in metres.

    The width is the ring's standard deviation. A sample of the published transform is wavelength x
    image distance / 15.36 mm. On a bench, B of the ray matrix takes the place of the image
    distance.
    """
    sample = wavelength * camera.ray_matrix_b / _SIDE
    return RING_RADIUS_SAMPLES * sample, _RING_WIDTH_SAMPLES * sample


def read_published_ring() -> NDArray[np.uint8]:
    """Read the middle of the thesis' ring after 569 iterations, 100 x 100 samples."""
    return read_grey_picture(bundled_path("studies/published-ring.png"), "a pattern")
