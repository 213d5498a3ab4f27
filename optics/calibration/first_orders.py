"""Measure the light in the first diffraction orders of each region's grating, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.calibration.registration import Registration
from optics.calibration.spots import frame_variance
from optics.camera import Sensor

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FirstOrders:
    """Hold the measured light in one region's first orders, (frames,), and its noise.

    clipped: (frames,) whether a pixel of the windows was at full scale. windows: (rows, columns) of
    the pixels of both spots, or of the one that is on the sensor.
    """

    light: Array
    noise: Array
    clipped: NDArray[np.bool_]
    windows: tuple[tuple[slice, slice], ...]


def measure_first_orders(
    frames: Sequence[NDArray[np.uint16]],
    dark: Array,
    registration: Registration,
    vectors: Array,
    region_shape: tuple[int, int],
    sensor: Sensor,
    wavelength: float,
) -> list[FirstOrders]:
    """Measure every region's first-order light in a calibration sweep of gratings.

    The light is weighted by the shapes of the region's spots. frames: digital numbers as read.
    dark: the mean dark frame of the same exposure time. vectors: grating vectors of the regions,
    (regions, 2). region_shape: (rows, columns) of a region's panel pixels.

    A pixel's weight is its mean in the brighter half of the sweep less that in the dimmer half.
    All pixels of a spot vary in proportion, so that any weights keep the dependence on the phase
    step; these weights give the least noise. Hot pixels have no weight. Raises ValueError if a
    region's spots lie outside of the frame, or are clipped in more than a fifth of the frames.
    """
    # A pixel of a dark frame is hot from 8 standard deviations of read noise on.
    hot = dark - np.median(dark) > 8.0 * sensor.read_noise / sensor.gain + 1
    found = []
    for number, vector in enumerate(vectors):
        windows = _windows(registration, vector, region_shape, dark.shape, wavelength)
        if not windows:
            raise ValueError(
                f"both first orders of region {number + 1} fall outside of the frame; choose "
                "longer periods, or let more of the sensor be read"
            )
        found.append(_measure_region(frames, dark, hot, tuple(windows), sensor, number))
    return found


def _windows(
    registration: Registration,
    vector: Array,
    region_shape: tuple[int, int],
    shape: tuple[int, ...],
    wavelength: float,
) -> list[tuple[slice, slice]]:
    """Return pixel windows around a calibration grating's two first orders.

    A window that doesn't lie wholly on the sensor is left out.
    """
    stretch = wavelength / registration.wavelength
    line = stretch * np.hypot(*(registration.matrix / np.array(region_shape)).T)
    # A spot extends over three line widths of its region's grating, and at least two more pixels
    # because of the star's size, the filter's band and the lens.
    reach = np.ceil(3.0 * line + 2.0).astype(int)
    found = []
    for order in (1, -1):
        middle = np.rint(registration.to_pixels(order * vector, wavelength)).astype(int)
        low, high = middle - reach, middle + reach + 1
        if (low >= 0).all() and (high <= np.array(shape)).all():
            found.append((slice(low[0], high[0]), slice(low[1], high[1])))
    return found


def _measure_region(
    frames: Sequence[NDArray[np.uint16]],
    dark: Array,
    hot: NDArray[np.bool_],
    windows: tuple[tuple[slice, slice], ...],
    sensor: Sensor,
    number: int,
) -> FirstOrders:
    """Measure one region's first-order light in the frames of a calibration sweep."""

    def cut(frame: NDArray[Any]) -> Array:
        return np.concatenate([frame[window].ravel() for window in windows]).astype(np.float64)

    raw = np.stack([cut(frame) for frame in frames])
    usable = cut(hot) == 0
    light = raw - cut(dark)
    clipped = ((raw >= sensor.full_scale) & usable).any(axis=1)
    if clipped.mean() > 0.2:
        raise ValueError(
            f"the spots of region {number + 1} are clipped in {clipped.sum()} of {len(frames)} "
            "frames; expose them shorter"
        )
    order = np.argsort(light[:, usable].sum(axis=1))
    half = len(order) // 2
    shape = light[order[half:]].mean(axis=0) - light[order[:half]].mean(axis=0)
    weight = np.where(usable, np.clip(shape, 0, None), 0.0)
    weight /= math.sqrt(float((weight**2).sum())) or 1.0
    variance = frame_variance(raw, sensor)
    return FirstOrders(light @ weight, np.sqrt(variance @ weight**2), clipped, windows)
