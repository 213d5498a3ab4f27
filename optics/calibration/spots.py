"""Spots of light in a frame: where they are, how bright, and how well that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.camera import Sensor

Array = NDArray[np.float64]

_DETECTION_SIGMAS = 8.0
"""Standard deviations of noise from which a spot counts as one."""

_SMOOTHING = 1.5
"""Pixels, standard deviation, over which light is gathered to find a spot."""

_HOT_PIXEL_RATIO = 10.0
"""How much brighter than its brightest neighbour no focused spot's pixel is."""

_ROUNDS = 30
_CENTROID_TOLERANCE = 1e-4
"""Of a pixel, by which a centroid that has settled moves at most."""

_NARROWEST, _WIDEST = 1.0, 8.0
"""Pixels, standard deviation, of the window in which a centroid is taken."""


@dataclass(frozen=True)
class Spot:
    """A spot's centroid and light.

    y, x: pixels from the corner pixel's centre. sigma: of either, pixels. light: in the frame's
    unit. noise: standard deviation of light. clipped: whether a pixel in it is at full scale.
    """

    y: float
    x: float
    sigma: float
    light: float
    noise: float
    clipped: bool

    @property
    def place(self) -> tuple[float, float]:
        return self.y, self.x


def frame_variance(numbers: Array, sensor: Sensor) -> Array:
    """Variance of the digital numbers of a frame: shot, read-out and rounding (EMVA 1288)."""
    electrons = np.clip(numbers - sensor.black_level, 0, None) * sensor.gain
    return (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12


def without_hot_pixels(frame: Array, variance: Array) -> Array:
    """The frame with lonely bright pixels replaced by their neighbours' median.

    A pixel is lonely if it stands out of the noise and is far brighter than each of its
    neighbours: light through a lens never is.
    """
    ring = np.ones((3, 3), dtype=bool)
    ring[1, 1] = False
    brightest = ndimage.maximum_filter(frame, footprint=ring, mode="nearest")
    dimmest = ndimage.minimum_filter(frame, footprint=ring, mode="nearest")
    lonely = frame - dimmest > _HOT_PIXEL_RATIO * (
        brightest - dimmest
    ) + _DETECTION_SIGMAS * np.sqrt(variance)
    return np.where(lonely, ndimage.median_filter(frame, footprint=ring, mode="nearest"), frame)


def find_spot(
    light: Array,
    variance: Array,
    clipped: NDArray[np.bool_] | None = None,
    excluded: NDArray[np.bool_] | None = None,
) -> Spot:
    """The spot that stands out most in a frame less its background.

    light, variance: (rows, columns). clipped: pixels at full scale. excluded: pixels that aren't
    searched. Raises ValueError if nothing stands out of the noise.
    """
    _require_frame(light, variance)
    clean = without_hot_pixels(light, variance)
    gathered = ndimage.gaussian_filter(clean, _SMOOTHING, mode="nearest")
    # A filter's weights squared are a filter that is narrower by the root of two.
    noise = np.sqrt(
        ndimage.gaussian_filter(variance, _SMOOTHING / math.sqrt(2), mode="nearest")
        / (4 * math.pi * _SMOOTHING**2)
    )
    signal = gathered / noise
    if excluded is not None:
        signal = np.where(excluded, -np.inf, signal)
    y, x = np.unravel_index(int(np.argmax(signal)), signal.shape)
    if not signal[y, x] >= _DETECTION_SIGMAS:
        raise ValueError(
            f"no spot stands out of the noise: the brightest place is {max(signal[y, x], 0):.1f} "
            f"standard deviations above it, and {_DETECTION_SIGMAS:g} are needed; expose longer, "
            "or bring the star into the frame"
        )
    return measure_spot(clean, variance, (float(y), float(x)), clipped)


def measure_spot(
    light: Array,
    variance: Array,
    start: tuple[float, float],
    clipped: NDArray[np.bool_] | None = None,
) -> Spot:
    """The spot near a place (y, x), by a centroid under a Gaussian window that follows it.

    The window is as wide as the spot (Bertin, SExtractor's windowed positions): the noise of
    far pixels has no say, and pixels don't pull the centroid to their centres. Raises
    ValueError if there is no light, or the spot leaves the frame.
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
        # Twice the shift: the window holds back the half of it, where it is as wide as the spot.
        y, x = y + 2 * dy, x + 2 * dx
        if not (0 <= y <= light.shape[0] - 1 and 0 <= x <= light.shape[1] - 1):
            raise ValueError(
                f"the spot at pixel ({start[0]:.0f}, {start[1]:.0f}) leaves the frame; "
                "move the star or the camera"
            )
        spread = float((weighted * ((py - y) ** 2 + (px - x) ** 2)).sum()) / (2 * total)
        # Under a window as wide as itself a Gaussian seems narrower by the root of two.
        wider = math.sqrt(max(2 * spread, 0.0))
        width = min(max(0.5 * (width + wider), _NARROWEST), _WIDEST)
        if math.hypot(dy, dx) < _CENTROID_TOLERANCE and abs(wider - width) < 0.05 * width:
            break
    return _spot_at(light, variance, (y, x), width, clipped)


def _spot_at(
    light: Array,
    variance: Array,
    place: tuple[float, float],
    width: float,
    clipped: NDArray[np.bool_] | None,
) -> Spot:
    part, py, px = _window_pixels(place, width, light.shape)
    y, x = place
    weight = np.exp(-((py - y) ** 2 + (px - x) ** 2) / (2 * width**2))
    total = float((weight * light[part]).sum())
    away = ((py - y) ** 2 + (px - x) ** 2) / 2
    sigma = 2 * math.sqrt(float((weight**2 * variance[part] * away).sum())) / total
    return Spot(
        y,
        x,
        sigma,
        # A Gaussian's light, of which a window of its own width passes the half.
        2 * total,
        2 * math.sqrt(float((weight**2 * variance[part]).sum())),
        clipped is not None and bool(clipped[part].any()),
    )


def _window_pixels(
    place: tuple[float, float], width: float, shape: tuple[int, int]
) -> tuple[tuple[slice, slice], Array, Array]:
    """The pixels within four widths, and their places as a column and a row."""
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
