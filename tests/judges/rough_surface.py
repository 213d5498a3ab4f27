"""Light of a rough surface on a sensor, from random heights: one field for each wavelength.

The surface's samples lie much closer than the lens resolves, and each has a height of its own. The
image wraps around, so that each pixel is as good as any other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optics.camera import Camera

Array = NDArray[np.float64]


def speckled(
    rng: np.random.Generator, camera: Camera, finer: int, roughness: float, waves, weights
) -> Array:
    """Light on pixels, of mean 1 for a rough surface; waves: metres, with their weights."""
    one, lens = camera.sensor, camera.lens
    shape = [n * finer for n in one.shape]
    fy, fx = (np.fft.fftfreq(n, one.pitch / finer) for n in shape)
    height = roughness * rng.standard_normal(shape)
    total, all_weight = np.zeros(shape), sum(weights)
    for wave, weight in zip(waves, weights, strict=True):
        y, x = (wave * float(lens.image_distance) * f for f in (fy[:, None], fx))
        open_ = np.hypot(y, x) <= float(lens.stop_diameter) / 2
        sides = [n * camera.panel.pitch / 2 for n in camera.panel.shape]
        open_ = open_ & (np.abs(y) <= sides[0]) & (np.abs(x) <= sides[1])
        field = np.fft.ifft2(np.fft.fft2(np.exp(4j * np.pi * height / wave)) * open_)
        passed = open_.mean()  # Of the light that a rough surface scatters into all directions.
        total += weight / all_weight * np.abs(field) ** 2 / passed
    rows, columns = one.shape
    return np.asarray(total.reshape(rows, finer, columns, finer).mean((1, 3)))
