"""How a sensor is read: row by row, amplified, binned, averaged, and where its numbers end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from optics.sensor.sensor import Sensor
from optics.validation import require_count, require_number, require_positive

Region: TypeAlias = "tuple[int, int, int, int]"


def row_starts(sensor: Sensor, first_start: float = 0.0, *, rolling: bool = True) -> torch.Tensor:
    """Return when the shutter begins to expose each row, in seconds.

    A global shutter starts all rows at once. A rolling shutter starts each row by the sensor's line
    time after the one before, from the first row to the last.

    Parameters
    ----------
    sensor, first_start : Sensor, float, default 0.0
        The sensor, and the start of its first row, seconds.
    rolling : bool, default True
        Whether a rolling shutter's delays count.

    Returns
    -------
    torch.Tensor, (rows,), float64
        Seconds.
    """
    rows = torch.arange(sensor.shape[0], dtype=torch.float64)
    return first_start + rows * (row_delay(sensor) if rolling else 0.0)


def row_delay(sensor: Sensor) -> float:
    """Return the delay between the starts of two neighbouring rows, in seconds."""
    return sensor.line_time if sensor.shutter == "rolling" else 0.0


def frame_duration(sensor: Sensor, exposure: float) -> float:
    """Return how long a shutter takes to expose all rows of a frame, in seconds."""
    require_positive("exposure", exposure, "s")
    return exposure + (sensor.shape[0] - 1) * row_delay(sensor)


def sensor_as_read(
    sensor: Sensor,
    *,
    amplification_db: float = 0.0,
    region: Region | None = None,
    binning: int = 1,
    averaged: int = 1,
) -> Sensor:
    """Return a sensor whose frames are read in another way.

    The mean of n numbers, of pixels or of frames, has n times the electrons in each number, and √n
    times the read noise. It counts as clipped from the number on at which a single one does.

    Parameters
    ----------
    sensor : Sensor
        As it is described, for whole frames of single pixels.
    amplification_db : float, default 0
        By how much more the signal is amplified: 20 dB are a factor of 10. Read noise is kept in
        electrons, although amplifiers in front of a converter lower it.
    region : tuple of int, optional
        x, y, width and height in pixels; all by default.
    binning, averaged : int, default 1
        Pixels across and down whose mean is one number, and frames whose mean is taken.

    Returns
    -------
    Sensor
        With its gain, noise, dark current, pitch, shape and clip level.

    Raises
    ------
    ValueError
        If the region lies outside of the sensor, is smaller than a binned pixel, or binning would
        mix the colours of a mosaic.

    References
    ----------
    EMVA 1288, release 4.0, sec. 2: the linear model of a camera.
    """
    require_number("amplification_db", amplification_db, "dB")
    require_count("binning", binning)
    require_count("averaged", averaged)
    (rows, columns), (x, y, width, height) = sensor.shape, region or (0, 0, *sensor.shape[::-1])
    if min(x, y) < 0 or min(width, height) < binning or x + width > columns or y + height > rows:
        raise ValueError(
            f"region is {[x, y, width, height]}; it must lie within {columns} x {rows} pixels, and "
            f"have {binning} at least each way"
        )
    if sensor.colour is not None:
        if binning > 1:
            raise ValueError(
                f"binning is {binning}; it would mix the colours of this sensor's mosaic"
            )
        pattern = sensor.colour.pattern
        if x % len(pattern[0]) or y % len(pattern):
            raise ValueError(
                f"region is {[x, y, width, height]}; with this sensor's mosaic, x must be a "
                f"multiple of {len(pattern[0])} and y of {len(pattern)}"
            )
    pixels = binning**2
    count = pixels * averaged
    amplified = replace(sensor, gain=sensor.gain / 10 ** (amplification_db / 20))
    clip_level = amplified.full_scale if count > 1 else sensor.clip_level
    return replace(
        amplified,
        shape=(height // binning, width // binning),
        pitch=sensor.pitch * binning,
        gain=amplified.gain * count,
        full_well=sensor.full_well * count,
        read_noise=sensor.read_noise * math.sqrt(count),
        dark_current=sensor.dark_current * count,
        prnu=sensor.prnu / binning,
        dsnu=sensor.dsnu * binning * averaged,
        dead=sensor.dead**pixels,
        hot=1 - (1 - sensor.hot) ** pixels,
        hot_current=sensor.hot_current * averaged,
        clip_level=clip_level,
    )


# Pixels that share the largest number from which on they can be a pile. Chosen: noise alone seldom
# leaves so many in the last number of a picture.
LEAST_PILE = 20

# Pixels at the largest number over those at the next that occurs, from which on they are a pile.
# Chosen: without clipping, fewer pixels have the largest number than the next one.
_STEEP = 2


def top_pile(numbers: NDArray[np.generic]) -> int | None:
    """Return the number at which pixels of a picture pile up, as they clip; None if they don't.

    Without another exposure it may also be that all pixels have the same light.
    """
    flat: NDArray[Any] = numbers.reshape(-1)
    top = flat.max()
    count = int(np.count_nonzero(flat == top))
    if count < LEAST_PILE:
        return None
    rest = flat[flat != top]
    beside = int(np.count_nonzero(rest == rest.max())) if rest.size else 0
    return int(top) if count >= _STEEP * beside else None
