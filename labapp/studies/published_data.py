"""What the thesis' authors published beside it, as far as studies compare with it.

github.com/cgtuebingen/computational_camera_phase_retrieval, MIT licence: see
labapp/data/studies/SOURCES.txt.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from labapp.files.reading import bundled_path, read_grey
from optics.camera import Camera

RING_RADIUS_SAMPLES, _RING_WIDTH_SAMPLES = 30, 1.15
"""Of the published ring, in samples of its PSF; the width is a standard deviation."""

_SIDE = 1920 * 8e-6
"""Of the authors' panel, metres, which is also the side of the square that they transform."""

RING_BAND = (20, 40)
"""Samples from the axis, between which the ring's energy is counted."""

RING_ENERGY: Mapping[int, float] = {1: 0.780, 10: 0.849, 100: 0.903, 569: 0.933}
"""Share of the light within the band, by iterations: of the published patterns, as their authors
compute a PSF, by one Fourier transform of the pattern within 1920 x 1920 samples."""


def published_ring_sizes(camera: Camera, wavelength: float) -> tuple[float, float]:
    """Radius and width (standard deviation) that the published ring has on a sensor, metres.

    A sample is wavelength x image distance / 15.36 mm, as of the published transform.
    """
    sample = wavelength * camera.ray_matrix_b / _SIDE
    return RING_RADIUS_SAMPLES * sample, _RING_WIDTH_SAMPLES * sample


def read_published_ring() -> NDArray[np.uint8]:
    """The middle of the published PSF after 569 iterations, a picture of 100 x 100 samples."""
    return read_grey(bundled_path("studies/published-ring.png"))
