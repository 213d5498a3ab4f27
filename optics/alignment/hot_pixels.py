"""A picture without its hot pixels, which measures for alignment must not take for light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optics.calibration.spots import without_hot_pixels
from optics.camera import Sensor

Array = NDArray[np.float64]


def filter_period(sensor: Sensor) -> tuple[int, int]:
    """Return the period of the colour filters that a star is seen through, (rows, columns).

    It is (1, 1) for a monochrome sensor.
    """
    if sensor.colour is None:
        return 1, 1
    pattern = sensor.colour.pattern
    return len(pattern), len(pattern[0])


def without_hot(light: Array, variance: Array, sensor: Sensor) -> Array:
    """Return a picture to be aligned with hot pixels replaced by the median of their neighbours.

    Neighbours are those of the same colour filter: light of one colour makes single bright pixels
    among those of the other colours. light, variance: (rows, columns), DN and DN².
    """
    rows, columns = filter_period(sensor)
    clean = light.copy()
    for row in range(rows):
        for column in range(columns):
            same = slice(row, None, rows), slice(column, None, columns)
            if light[same].size:
                clean[same] = without_hot_pixels(light[same], variance[same])
    return clean
