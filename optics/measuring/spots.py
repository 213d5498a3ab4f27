"""Spots of light in a frame: where they are, and their centroid and light with uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.camera import Sensor

Array = NDArray[np.float64]


# Standard deviations of noise from which a maximum counts as a spot; chosen
_DETECTION_SIGMAS = 8.0
_SMOOTHING = 1.5  # pixels, standard deviation of the Gaussian by which spots are found; chosen
_HOT_RATIO = 10.0  # of a hot pixel to its brightest neighbour: smaller in a focused spot; chosen
# Most iterations of a centroid, and pixels by which it moves at their end
_ROUNDS, _TOLERANCE = 30, 1e-4
_NARROWEST, _WIDEST = 1.0, 8.0  # pixels: limits of the centroid window's standard deviation; chosen


@dataclass(frozen=True)
class Spot:
    """Centroid and light of a spot.

    y, x: pixels from the corner pixel's centre.
    sigma: standard deviation of either, pixels.
    light: in the frame's unit.
    noise: standard deviation of the light.
    """

    y: float
    x: float
    sigma: float
    light: float
    noise: float

    @property
    def place(self) -> tuple[float, float]:
        return self.y, self.x


def frame_variance(numbers: Array, sensor: Sensor) -> Array:
    """Compute the variance of digital numbers by shot noise, read noise and rounding (EMVA 1288).

    In DN².
    """
    electrons = np.clip(numbers - sensor.black_level, 0, None) * sensor.gain
    return (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12


def without_hot_pixels(frame: Array, variance: Array) -> Array:
    """Replace hot pixels by the median of their neighbours, the upper one.

    A pixel is hot if it stands out of the noise and is far brighter than each of its neighbours.
    Light through a lens never makes such a pixel.
    """
    ring = np.ones((3, 3), dtype=bool)
    ring[1, 1] = False
    brightest = ndimage.maximum_filter(frame, footprint=ring, mode="nearest")
    dimmest = ndimage.minimum_filter(frame, footprint=ring, mode="nearest")
    limit = _HOT_RATIO * (brightest - dimmest) + _DETECTION_SIGMAS * np.sqrt(variance)
    hot = frame - dimmest > limit
    # Few pixels are hot, and a median over the whole frame takes half a second for 5 megapixels.
    rows, columns = np.nonzero(hot)
    last_row, last_column = frame.shape[0] - 1, frame.shape[1] - 1
    around = [
        frame[np.clip(rows + down, 0, last_row), np.clip(columns + across, 0, last_column)]
        for down, across in np.argwhere(ring) - 1
    ]
    clean = frame.copy()
    clean[hot] = np.partition(np.array(around), 4, axis=0)[4]
    return clean


def find_spot(light: Array, variance: Array, excluded: NDArray[np.bool_] | None = None) -> Spot:
    """Find the spot that stands out most in a frame.

    light, variance: (rows, columns); the background is already subtracted.
    excluded: pixels that aren't searched.

    Raises ValueError if no spot stands out of the noise.
    """
    _require_frame(light, variance)
    clean = without_hot_pixels(light, variance)
    smooth = ndimage.gaussian_filter(clean, _SMOOTHING, mode="nearest")
    # The squared weights of a Gaussian filter are a Gaussian narrower by the root of two.
    spread = ndimage.gaussian_filter(variance, _SMOOTHING / math.sqrt(2), mode="nearest")
    signal = smooth / np.sqrt(spread / (4 * math.pi * _SMOOTHING**2))
    if excluded is not None:
        signal = np.where(excluded, -np.inf, signal)
    y, x = np.unravel_index(int(np.argmax(signal)), signal.shape)
    if not signal[y, x] >= _DETECTION_SIGMAS:
        raise ValueError(
            f"no spot stands out of the noise: the brightest place is {max(signal[y, x], 0):.1f} "
            f"standard deviations above it, and {_DETECTION_SIGMAS:g} are needed; expose longer, "
            "or bring the star into the frame"
        )
    return measure_spot(clean, variance, (float(y), float(x)))


def measure_spot(light: Array, variance: Array, start: tuple[float, float]) -> Spot:
    """Measure a spot near a position (y, x) by its windowed centroid.

    The window is a Gaussian that follows the spot and is as wide as the spot (Bertin, SExtractor's
    windowed positions). The noise of far pixels therefore doesn't count, and the centroid isn't
    biased towards pixel centres. Raises ValueError if there is no light, or the spot leaves the
    frame.
    """
    _require_frame(light, variance)
    (y, x), width = start, 2.0
    for _ in range(_ROUNDS):
        part, py, px = _window_pixels((y, x), width, light.shape)
        weight = np.exp(-((py - y) ** 2 + (px - x) ** 2) / (2 * width**2))
        weighted = weight * light[part]
        total = float(weighted.sum())
        if not total > 0:
            raise ValueError(f"no light at pixel ({start[0]:.0f}, {start[1]:.0f}); expose longer")
        dy, dx = (float((weighted * (p - c)).sum()) / total for p, c in ((py, y), (px, x)))
        # A window as wide as the spot halves the measured shift, so the shift is doubled.
        y, x = y + 2 * dy, x + 2 * dx
        if not (0 <= y <= light.shape[0] - 1 and 0 <= x <= light.shape[1] - 1):
            raise ValueError(
                f"the spot at pixel ({start[0]:.0f}, {start[1]:.0f}) leaves the frame; "
                "move the star or the camera"
            )
        spread = float((weighted * ((py - y) ** 2 + (px - x) ** 2)).sum()) / (2 * total)
        # In a window as wide as itself, a Gaussian appears narrower by the root of two.
        wider = math.sqrt(max(2 * spread, 0.0))
        width = min(max(0.5 * (width + wider), _NARROWEST), _WIDEST)
        if math.hypot(dy, dx) < _TOLERANCE and abs(wider - width) < 0.05 * width:
            break
    part, py, px = _window_pixels((y, x), width, light.shape)
    square = (py - y) ** 2 + (px - x) ** 2
    weight = np.exp(-square / (2 * width**2))
    total = float((weight * light[part]).sum())
    noise = weight**2 * variance[part]
    sigma = 2 * math.sqrt(float((noise * (square / 2)).sum())) / total
    # A window as wide as a Gaussian spot passes half of its light.
    return Spot(y, x, sigma, 2 * total, 2 * math.sqrt(float(noise.sum())))


def _window_pixels(
    place: tuple[float, float], width: float, shape: tuple[int, int]
) -> tuple[tuple[slice, slice], Array, Array]:
    """Return the pixels within four widths of a place: two slices, and y (column) and x (row)."""
    reach = math.ceil(4 * width)
    spans = [
        slice(max(round(c) - reach, 0), min(round(c) + reach + 1, n))
        for c, n in zip(place, shape, strict=True)
    ]
    y, x = (np.arange(s.start, s.stop, dtype=np.float64) for s in spans)
    return (spans[0], spans[1]), y[:, None], x[None, :]


def _require_frame(light: Array, variance: Array) -> None:
    if light.ndim != 2 or light.shape != variance.shape:
        raise ValueError(
            f"light is {light.shape} and variance is {variance.shape}; both need the frame's rows "
            "and columns"
        )
    if not (np.isfinite(light).all() and np.isfinite(variance).all() and (variance > 0).all()):
        raise ValueError("light and variance must be finite, and the variance positive")
