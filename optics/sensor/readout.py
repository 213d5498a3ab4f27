"""Describe a sensor as it is read: amplified, a region of it, pixels binned, frames averaged."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeAlias

from optics.sensor.sensor import Sensor
from optics.validation import require_count, require_number

Region: TypeAlias = "tuple[int, int, int, int]"


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
        By how much more the signal is amplified, in decibels: 20 of them are a factor of 10. Read
        noise is kept in electrons, although amplifiers in front of a converter lower it.
    region : tuple of int, optional
        x, y, width and height in pixels; all by default.
    binning : int, default 1
        Pixels across and down whose mean is one number.
    averaged : int, default 1
        Frames whose mean is taken.

    Returns
    -------
    Sensor
        With its gain, noise, dark current, pitch, shape and clip level.

    Raises
    ------
    ValueError
        If a number is invalid, or the region lies outside of the sensor, is smaller than a binned
        pixel, or binning would mix the colours of a mosaic.

    References
    ----------
    EMVA 1288, release 4.0, sec. 2: the linear model of a camera.
    """
    require_number("amplification_db", amplification_db, "dB")
    require_count("binning", binning)
    require_count("averaged", averaged)
    x, y, width, height = region or (0, 0, sensor.shape[1], sensor.shape[0])
    _require_pixels(sensor, (x, y, width, height), binning)
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


def _require_pixels(sensor: Sensor, region: Region, binning: int) -> None:
    """Raise ValueError unless the sensor has a region's pixels, and may bin them."""
    (rows, columns), (x, y, width, height) = sensor.shape, region
    if min(x, y) < 0 or min(width, height) < binning or x + width > columns or y + height > rows:
        raise ValueError(
            f"region is {list(region)}; it must lie within {columns} x {rows} pixels, and have "
            f"{binning} at least each way"
        )
    if sensor.colour is None:
        return
    if binning > 1:
        raise ValueError(f"binning is {binning}; it would mix the colours of this sensor's mosaic")
    pattern = sensor.colour.pattern
    if x % len(pattern[0]) or y % len(pattern):
        raise ValueError(
            f"region is {list(region)}; with this sensor's mosaic, x must be a multiple of "
            f"{len(pattern[0])} and y of {len(pattern)}"
        )
