"""Spots of light in a frame: where they are, and their centroid and light with uncertainties."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.camera import Sensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpotSettings:
    """Tune how spots are found and measured; all values are chosen.

    detection_sigmas: standard deviations of noise from which a maximum counts as a spot.
    smoothing: standard deviation, in pixels, of the Gaussian that smooths a frame for detection.
    hot_pixel_ratio: ratio of a hot pixel to its brightest neighbour. In a focused spot the ratio is
        smaller.
    rounds: most iterations of a centroid.
    centroid_tolerance: pixels; the iteration ends when the centroid moves by less.
    narrowest, widest: limits, in pixels, of the centroid window's standard deviation.
    """

    detection_sigmas: float = 8.0
    smoothing: float = 1.5
    hot_pixel_ratio: float = 10.0
    rounds: int = 30
    centroid_tolerance: float = 1e-4
    narrowest: float = 1.0
    widest: float = 8.0


_SETTINGS = SpotSettings()


@dataclass(frozen=True)
class Spot:
    """Centroid and light of a spot.

    y, x: pixels from the corner pixel's centre.
    sigma: standard deviation of either, pixels.
    light: in the frame's unit.
    noise: standard deviation of the light.
    clipped: whether one of its pixels is at full scale.
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
    """Compute the variance of digital numbers by EMVA 1288, DN².

    Shot noise, read noise and rounding add up.
    """
    electrons = np.clip(numbers - sensor.black_level, 0, None) * sensor.gain
    return (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12


def without_hot_pixels(frame: Array, variance: Array) -> Array:
    """Replace hot pixels by the median of their neighbours.

    A pixel is hot if it stands out of the noise and is far brighter than each of its neighbours.
    Light through a lens never makes such a pixel.
    """
    ring = np.ones((3, 3), dtype=bool)
    ring[1, 1] = False
    brightest = ndimage.maximum_filter(frame, footprint=ring, mode="nearest")
    dimmest = ndimage.minimum_filter(frame, footprint=ring, mode="nearest")
    hot = frame - dimmest > _SETTINGS.hot_pixel_ratio * (
        brightest - dimmest
    ) + _SETTINGS.detection_sigmas * np.sqrt(variance)
    clean = frame.copy()
    clean[hot] = _median_around(frame, hot)
    return clean


def _median_around(frame: Array, chosen: NDArray[np.bool_]) -> Array:
    """Return the median of the neighbours of some pixels, the upper one.

    Few pixels are hot, and a median over the whole frame takes half a second for 5 megapixels.
    """
    rows, columns = np.nonzero(chosen)
    last_row, last_column = frame.shape[0] - 1, frame.shape[1] - 1
    around = [
        frame[np.clip(rows + down, 0, last_row), np.clip(columns + across, 0, last_column)]
        for down in (-1, 0, 1)
        for across in (-1, 0, 1)
        if down or across
    ]
    middle = len(around) // 2
    median: Array = np.partition(np.array(around), middle, axis=0)[middle]
    return median


def find_spot(
    light: Array,
    variance: Array,
    clipped: NDArray[np.bool_] | None = None,
    excluded: NDArray[np.bool_] | None = None,
) -> Spot:
    """Find the spot that stands out most in a frame.

    light, variance: (rows, columns); the background is already subtracted.
    clipped: pixels at full scale.
    excluded: pixels that aren't searched.

    Raises ValueError if no spot stands out of the noise.
    """
    _require_frame(light, variance)
    clean = without_hot_pixels(light, variance)
    smoothing, least = _SETTINGS.smoothing, _SETTINGS.detection_sigmas
    smooth = ndimage.gaussian_filter(clean, smoothing, mode="nearest")
    # The squared weights of a Gaussian filter are a Gaussian narrower by the root of two.
    noise = np.sqrt(
        ndimage.gaussian_filter(variance, smoothing / math.sqrt(2), mode="nearest")
        / (4 * math.pi * smoothing**2)
    )
    signal = smooth / noise
    if excluded is not None:
        signal = np.where(excluded, -np.inf, signal)
    y, x = np.unravel_index(int(np.argmax(signal)), signal.shape)
    if not signal[y, x] >= least:
        raise ValueError(
            f"no spot stands out of the noise: the brightest place is {max(signal[y, x], 0):.1f} "
            f"standard deviations above it, and {least:g} are needed; expose longer, "
            "or bring the star into the frame"
        )
    return measure_spot(clean, variance, (float(y), float(x)), clipped)


def measure_spot(
    light: Array,
    variance: Array,
    start: tuple[float, float],
    clipped: NDArray[np.bool_] | None = None,
) -> Spot:
    """Measure a spot near a position (y, x) by its windowed centroid.

    The window is a Gaussian that follows the spot and is as wide as the spot (Bertin, SExtractor's
    windowed positions). The noise of far pixels therefore doesn't count, and the centroid isn't
    biased towards pixel centres. Raises ValueError if there is no light, or the spot leaves the
    frame.
    """
    _require_frame(light, variance)
    (y, x), width = start, 2.0
    for _ in range(_SETTINGS.rounds):
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
        width = min(max(0.5 * (width + wider), _SETTINGS.narrowest), _SETTINGS.widest)
        settled = math.hypot(dy, dx) < _SETTINGS.centroid_tolerance
        if settled and abs(wider - width) < 0.05 * width:
            break
    return _spot_at(light, variance, (y, x), width, clipped)


def _spot_at(
    light: Array,
    variance: Array,
    place: tuple[float, float],
    width: float,
    clipped: NDArray[np.bool_] | None,
) -> Spot:
    """Measure light, noise and accuracy at a known place and width."""
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
        # A window as wide as a Gaussian spot passes half of its light.
        2 * total,
        2 * math.sqrt(float((weight**2 * variance[part]).sum())),
        clipped is not None and bool(clipped[part].any()),
    )


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
