"""What a lens is focused and aligned by: sharpness, a star's place and width, its level.

Hot pixels aren't taken for light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.camera import Sensor
from optics.measuring.spots import find_spot, frame_variance, without_hot_pixels
from optics.validation import require_unmasked

Array = NDArray[np.float64]


def _filter_period(sensor: Sensor) -> tuple[int, int]:
    """Return the period of the colour filters, (rows, columns); (1, 1) for a monochrome sensor."""
    if sensor.colour is None:
        return 1, 1
    return len(sensor.colour.pattern), len(sensor.colour.pattern[0])


def without_hot(light: Array, variance: Array, sensor: Sensor) -> Array:
    """Replace hot pixels by the median of their neighbours behind the same colour filter.

    Light of one colour makes single bright pixels among those of the other colours.
    light, variance: (rows, columns), DN and DN².
    """
    rows, columns = _filter_period(sensor)
    clean = light.copy()
    for row, column in np.ndindex(rows, columns):
        same = slice(row, None, rows), slice(column, None, columns)
        if light[same].size:
            clean[same] = without_hot_pixels(light[same], variance[same])
    return clean


@dataclass(frozen=True)
class PeakLevel:
    """Level of the brightest pixel of a picture.

    Parameters
    ----------
    level : float
        Share of the range from the black level to full scale.
    saturated : int
        Pixels at full scale, hot ones among them.
    """

    level: float
    saturated: int


def peak_level(numbers: NDArray[Any], sensor: Sensor) -> PeakLevel:
    """Return the level of the brightest pixel that isn't a hot one.

    No percentile below it would do: a star in focus covers some ten pixels of millions, and would
    be saturated at any exposure that brings a percentile to a level. A hot pixel is far brighter
    than all of its neighbours, which light through a lens never is.

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
        For a level or a rate that isn't so.
    """
    if not 0 < level < 1:
        raise ValueError(f"level is {level:g}; give a share of full scale above 0 and below 1")
    if not rate > 0:
        raise ValueError(f"rate is {rate:g} electrons/s; it must be positive")
    electrons = level * (sensor.full_scale - sensor.black_level) * sensor.gain
    return electrons / (rate + sensor.dark_current)


# Deviations of a region's mean light from none: a score is divided by its square; chosen
_LEAST_LIGHT = 3.0


def focus_score(numbers: NDArray[Any], sensor: Sensor) -> float:
    """Return the focus score of a region: the energy of its gradients over its light squared.

    The mean square of the gradient is the focus measure of Tenenbaum, here by central differences,
    which compare pixels of the same colour filter in a Bayer pattern; what noise is expected to add
    is subtracted. Over the square of the mean light it doesn't depend on the exposure. It is
    comparable as long as the same scene is in the region, and the larger, the sharper. Hot pixels
    are left out.

    Parameters
    ----------
    numbers : NDArray, (rows, columns)
        Digital numbers of the region, 3 x 3 pixels at least.
    sensor : Sensor
        Tells gain, noise and black level.

    Returns
    -------
    float
        In 1/pixel². A cosine of modulation m and angular frequency k, in rad/pixel, has
        m² sin²(k) / 2. By noise, the score of a scene without structure may be slightly negative.

    Raises
    ------
    ValueError
        For a smaller region, and one without light.

    References
    ----------
    S. Pertuz, D. Puig and M. A. Garcia, "Analysis of focus measure operators for shape-from-focus",
    Pattern Recognition 46, 1415 (2013), doi 10.1016/j.patcog.2012.11.011.
    """
    require_unmasked(numbers)
    if numbers.ndim != 2 or min(numbers.shape) < 3:
        raise ValueError(f"the region is {numbers.shape} pixels; give 3 x 3 at least")
    raw = numbers.astype(np.float64)
    variance = frame_variance(raw, sensor)
    light = without_hot(raw, variance, sensor) - sensor.black_level
    mean = float(light.mean())
    if mean < _LEAST_LIGHT * math.sqrt(float(variance.mean()) / light.size):
        raise ValueError(
            f"the region's mean light is {mean:.2g} DN; that is too dark to judge the focus. "
            "Expose longer"
        )
    down = (light[2:, 1:-1] - light[:-2, 1:-1]) / 2
    across = (light[1:-1, 2:] - light[1:-1, :-2]) / 2
    vertical = variance[2:, 1:-1] + variance[:-2, 1:-1]
    around = (vertical + variance[1:-1, 2:] + variance[1:-1, :-2]) / 4
    return float((down**2 + across**2 - around).mean()) / mean**2


FWHM = 2 * math.sqrt(2 * math.log(2))
"""Full width at half maximum of a Gaussian over its standard deviation."""

# Pixels: least side of a star's region, and its rim, which tells the background; chosen
_LEAST_SIDE, _RIM = 8, 2


_FIRST_WIDTH = 2.0  # pixels, standard deviation of a star's first window; chosen
_NARROWEST = 0.3  # pixels: the neighbours of a star in a single pixel have 0.4 % of its light
_WIDEST = 0.2  # share of the region's shorter side, which shows too little of a wider star; chosen
# Most steps, each halves the error; change of the window that ends them; chosen
_ROUNDS, _TOLERANCE = 100, 1e-5
_REACH = 5.0  # standard deviations of the window beyond which its weight, below 4e-6, isn't counted


@dataclass(frozen=True)
class StarShape:
    """Place, width and light of a star in a region.

    Parameters
    ----------
    y, x : float
        Row and column of its middle in the region; whole numbers are the centres of pixels.
    fwhm_major, fwhm_minor : float
        Full widths at half maximum of the Gaussian along its long and its short axis, pixels.
    angle : float
        Direction of the long axis in radians, from that of the columns (x) towards that of the
        rows (y), from -π/2 to π/2.
    peak : float
        Brightest pixel above the background, hot pixels left out, DN.
    background : float
        DN.
    saturated : int
        Pixels of the region at full scale. With any, the width is too large.
    """

    y: float
    x: float
    fwhm_major: float
    fwhm_minor: float
    angle: float
    peak: float
    background: float
    saturated: int

    @property
    def fwhm(self) -> float:
        """The geometric mean of both widths, in pixels."""
        return math.sqrt(self.fwhm_major * self.fwhm_minor)


def star_shape(numbers: NDArray[Any], sensor: Sensor) -> StarShape:
    """Measure the star that stands out most in a region, by adaptive moments.

    A Gaussian window follows the star until both have the same moments through it, on the same
    pixels: that is the elliptical Gaussian of best fit. It is exact for a Gaussian, also for one of
    few pixels, and noise far from the star doesn't count. It grows steadily with defocus: a disc of
    radius R has a width of 1.485 R. Pixels add 1/12 square pixel to the variance, as they do in the
    picture. A star of a standard deviation below half a pixel can't be told from a hot pixel.
    Behind colour filters, the mean over each period of their pattern is measured, and the variance
    that this adds is subtracted.

    Parameters
    ----------
    numbers : NDArray, (rows, columns)
        Digital numbers of the region, 8 x 8 at least.
    sensor : Sensor
        Tells gain, noise, black level, full scale and colour filters.

    Returns
    -------
    StarShape
        In pixels of the region.

    Raises
    ------
    ValueError
        If no star stands out of the noise, or it is wider than the region can tell.

    References
    ----------
    G. M. Bernstein and M. Jarvis, "Shapes and shears, stars and smears: optimal measurements for
    weak lensing", Astron. J. 123, 583 (2002), doi 10.1086/338085, section 3.
    """
    require_unmasked(numbers)
    if numbers.ndim != 2 or min(numbers.shape) < _LEAST_SIDE:
        raise ValueError(
            f"the region is {numbers.shape} pixels; give {_LEAST_SIDE} x {_LEAST_SIDE} at least"
        )
    raw = numbers.astype(np.float64)
    variance = frame_variance(raw, sensor)
    rim = np.ones(raw.shape, dtype=bool)
    rim[_RIM:-_RIM, _RIM:-_RIM] = False
    background = float(np.median(raw[rim]))
    clean = without_hot(raw - background, variance, sensor)
    period = _filter_period(sensor)
    light, mean_variance = (
        ndimage.uniform_filter(one, period, mode="nearest") for one in (clean, variance)
    )
    centre, covariance = _adaptive_moments(light, find_spot(light, mean_variance).place)
    # A mean over an even number of pixels moves the star by half of one.
    y, x = (float(c) - (0.5 if n % 2 == 0 else 0.0) for c, n in zip(centre, period, strict=True))
    added = (np.array(period) ** 2 - 1) / 12
    values, vectors = np.linalg.eigh(covariance - np.diag(added))
    minor, major = (FWHM * math.sqrt(max(float(v), 0.0)) for v in values)
    down, across = vectors[:, 1]
    angle = math.atan(down / across) if across else math.pi / 2
    saturated = int(np.count_nonzero(raw >= sensor.full_scale))
    return StarShape(y, x, major, minor, angle, float(clean.max()), background, saturated)


def _adaptive_moments(light: Array, start: tuple[float, float]) -> tuple[Array, Array]:
    """Return centre (y, x) and covariance of the Gaussian that fits a star best, in pixels.

    Raises ValueError if the window finds no light, leaves the region, or outgrows it.
    """
    centre, shape = np.array(start), light.shape
    window = _FIRST_WIDTH**2 * np.eye(2)
    for _ in range(_ROUNDS):
        reaches = _REACH * np.sqrt(np.diag(window))
        part = tuple(
            slice(max(math.floor(c - reach), 0), min(math.ceil(c + reach) + 1, n))
            for c, reach, n in zip(centre, reaches, shape, strict=True)
        )
        dy = np.arange(part[0].start, part[0].stop)[:, None] - centre[0]
        dx = np.arange(part[1].start, part[1].stop)[None, :] - centre[1]
        inverse = np.linalg.inv(window)
        distance = inverse[0, 0] * dy**2 + 2 * inverse[0, 1] * dy * dx + inverse[1, 1] * dx**2
        weight = np.exp(-distance / 2)
        shift, spread = _moments(weight * light[part], dy, dx)
        # What a Gaussian of the window's own shape would have there, on the same few pixels.
        own_shift, own_spread = _moments(weight**2, dy, dx)
        # Through its own window, a Gaussian shows half of a change of its place and covariance.
        centre = centre + 2 * (shift - own_shift)
        values, axes = np.linalg.eigh(window + 2 * (spread - own_spread))
        wider: Array = (axes * np.maximum(values, _NARROWEST**2)) @ axes.T
        change = float(np.abs(wider - window).max() / window.max())
        window = wider
        inside = all(0 <= c <= n - 1 for c, n in zip(centre, shape, strict=True))
        if not (inside and np.linalg.eigvalsh(window)[1] <= (_WIDEST * min(shape)) ** 2):
            raise ValueError(
                f"the star is wider than a region of {shape[0]} x {shape[1]} pixels can tell, or "
                "lies at its rim; enlarge the region, or move it"
            )
        if change < _TOLERANCE:
            break
    return centre, window


def _moments(weighted: Array, dy: Array, dx: Array) -> tuple[Array, Array]:
    """Return the mean (y, x) of weighted light, and its second moments, (2, 2).

    Raises ValueError if there is no light.
    """
    total = float(weighted.sum())
    if not total > 0:
        raise ValueError("the star is lost in the noise; expose longer")
    share = weighted / total
    mean = np.array([(share * dy).sum(), (share * dx).sum()])
    across = float((share * dy * dx).sum())
    return mean, np.array([[(share * dy**2).sum(), across], [across, (share * dx**2).sum()]])
