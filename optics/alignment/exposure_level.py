"""The level of a picture's brightest pixel, and the exposure that brings it where it is wanted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.alignment.hot_pixels import without_hot
from optics.calibration.spots import frame_variance
from optics.camera import Sensor
from optics.validation import require_unmasked


@dataclass(frozen=True)
class PeakLevel:
    """Level of the brightest pixel of a picture that is exposed for alignment.

    Parameters
    ----------
    level : float
        Share of the range from the black level to full scale, 1 at full scale.
    saturated : int
        Pixels at full scale, hot ones among them.
    """

    level: float
    saturated: int


def peak_level(numbers: NDArray[Any], sensor: Sensor) -> PeakLevel:
    """Return the level of the brightest pixel that isn't a hot one.

    It is the brightest pixel, and no percentile below it: a star in focus covers some ten pixels
    of millions, and would be saturated at any exposure that brings a percentile to a level. A hot
    pixel is far brighter than all of its neighbours, which light through a lens never is.

    Parameters
    ----------
    numbers : NDArray, (rows, columns)
        Digital numbers.
    sensor : Sensor
        Tells gain, noise, black level and full scale.

    Returns
    -------
    PeakLevel
        With the number of saturated pixels.
    """
    require_unmasked(numbers)
    raw = numbers.astype(np.float64)
    clean = without_hot(raw, frame_variance(raw, sensor), sensor)
    room = sensor.full_scale - sensor.black_level
    saturated = int(np.count_nonzero(raw >= sensor.full_scale))
    return PeakLevel((float(clean.max()) - sensor.black_level) / room, saturated)


def exposure_for_level(level: float, rate: float, sensor: Sensor) -> float:
    """Return the exposure at which light of a rate reaches a level of the sensor's range.

    Parameters
    ----------
    level : float
        Share of the range from the black level to full scale, above 0 and below 1.
    rate : float
        Electrons per second of light in the brightest pixel, positive.
    sensor : Sensor
        Tells gain, dark current, black level and full scale.

    Returns
    -------
    float
        Seconds, whatever the camera can expose.

    Raises
    ------
    ValueError
        For a level outside its range, and a rate that isn't positive.
    """
    if not 0 < level < 1:
        raise ValueError(f"level is {level:g}; give a share of full scale above 0 and below 1")
    if not rate > 0:
        raise ValueError(f"rate is {rate:g} electrons/s; it must be positive")
    electrons = level * (sensor.full_scale - sensor.black_level) * sensor.gain
    return electrons / (rate + sensor.dark_current)
