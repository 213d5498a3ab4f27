"""Weights that integrate band-limited samples over a pixel, fitted to a tolerance."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import torch
from numpy.typing import NDArray

from optics.accuracy import MachineSpeed

# Ratios of the samples' rate to the light's Nyquist rate to choose from. Closer to 1, the weights
# reach far. Chosen; the last one reaches every tolerance.
OVERSAMPLING = (1.15, 1.3, 1.5)

WIDEST_BAND = 0.48  # largest frequency in cycles per sample that weights are fitted for; chosen

# Pixels in a row that are integrated by one matrix; measured to be the fastest. The samples per
# pixel are whole multiples of its inverse, so that the next block needs the same matrix.
BLOCK = 16

# Relative L2 error of the light on pixels over the largest deviation of the weights' transfer
# function along an axis: 2 axes, times 2 because a pixel averages out fine fringes that count in
# the deviation.
_ERROR_MARGIN = 4.0

# Samples on either side of a pixel that another digit needs, times the oversampling beyond 1.
# Fitted to tolerances of 1e-3 to 1e-9 and the ratios above, which it meets within a quarter.
_SAMPLES_PER_DIGIT = 0.75

_FIRST_DIGIT_STEPS = 2.0  # samples in which the error is first taken to fall to a tenth; chosen
_STALLED_STEPS = 3  # steps of the search after which an error that hardly falls ends it; chosen
_MAX_REACH = 96  # most samples on either side; chosen: the error is down to rounding there

FIT_SECONDS = 2e-9  # to fit weights, over samples³; measured at up to 750

# Time to fit a pixel's weights: fixed, in calls; for each square of the samples on either side, in
# cosines; for each third power of them, in multiplications in double precision. Measured for 2 to
# 64.
_CALLS_PER_FIT, _COSINES_PER_FIT, _PRODUCTS_PER_FIT = 0.26, 260.0, 450.0

# Singular values of the weights' fit below this share of the tolerance, relative to the largest,
# are left out. Chosen: the fit loses far less than the tolerance.
_NEGLIGIBLE = 0.03


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """Weights of the samples around a pixel in the light's integral over it.

    They are (pixels, samples), float64, for the pixels of a block, of which the first one's centre
    is on a sample; the middle one of the samples is the nearest to the pixel's centre.
    """

    weights: torch.Tensor
    factor: Fraction  # samples per pixel, a multiple of the block's inverse
    error: float  # relative L2, of the light on pixels
    # Samples on either side of a pixel in each fit that led here, halved where symmetry halved it.
    fits: tuple[float, ...] = ()

    @property
    def reach(self) -> int:
        """Number of samples on either side of a pixel's centre that its weights use."""
        return self.weights.shape[1] // 2

    def fit_seconds(self, speed: MachineSpeed) -> float:
        """Predict the processor seconds in which the weights were found."""
        return sum(
            _CALLS_PER_FIT * speed.call
            + _COSINES_PER_FIT * half**2 * speed.cosine
            + _PRODUCTS_PER_FIT * half**3 * speed.multiply_add * speed.double
            for half in self.fits
        )

    @property
    def margin(self) -> int:
        """Whole pixels around a pixel that its weights need, on each side."""
        return math.ceil(self.reach / self.factor)


@functools.lru_cache(maxsize=256)
def pixel_weights(factor: Fraction, band: float, tol: float) -> PixelWeights:
    """Find the fewest weights that integrate band-limited light over a pixel.

    The transfer function of the weights must be that of the pixel, a sinc, wherever the light has
    frequencies. A fit by least squares at nodes that are dense near the band's edge is almost the
    best one. Elsewhere the function is free, so that the weights reach much less far than those of
    a band-limited interpolation.

    factor: samples per pixel, a multiple of 1/16 and 1 or more. band: the light's highest frequency
    in cycles per sample, below 1/2. tol: relative L2 error of the light on pixels that is allowed;
    the weights', measured at other frequencies than those of the fit, exceeds it only if it is
    beyond double precision.
    """
    # How far the pixels' centres lie beyond the nearest sample, in samples: one between two samples
    # is the hardest case, and one on a sample the easiest.
    centres = [pixel * factor for pixel in range(BLOCK)]
    by_pixel = [float(one - math.floor(one + Fraction(1, 2))) for one in centres]
    offsets = sorted(set(by_pixel), key=abs)
    tried: dict[tuple[int, float], tuple[NDArray[np.float64], float]] = {}

    def fit(reach: int, offset: float) -> tuple[NDArray[np.float64], float]:
        """Fit once; the weights of a pixel on the other side of its sample are mirrored."""
        key = reach, abs(offset)
        if key not in tried:
            tried[key] = _fit_weights(factor, band, reach, abs(offset), tol)
        weights, error = tried[key]
        return (weights if offset >= 0 else weights[::-1]), error

    first = math.ceil(factor) // 2 + 1
    expected = max(first, math.floor(expected_reach(0.5 / band, tol)))
    most = first + _MAX_REACH - 1
    reach = _least_reach(lambda one: fit(one, offsets[-1])[1], first, expected, most, tol)
    # An easier case may need a sample more, where rounding rules.
    while reach < most and fit(reach, offsets[-1])[1] <= tol:
        if max(fit(reach, one)[1] for one in offsets) <= tol:
            break
        reach += 1
    found = {one: fit(reach, one) for one in offsets}
    rows = [found[offset][0] for offset in by_pixel]
    error = max(one[1] for one in found.values())
    fits = tuple(size if offset else size / 2 for size, offset in tried)
    return PixelWeights(torch.from_numpy(np.stack(rows)), factor, error, fits)


def _least_reach(
    error: Callable[[int], float], first: int, expected: int, most: int, tol: float
) -> int:
    """Return the least reach of weights from `first` on whose error is within a tolerance.

    The error falls about exponentially with the reach. Each step goes where the last two errors
    point to, within the reaches that are known to be too short and long enough. Where no reach up
    to `most` does, the one of the least error among those that were tried is returned.
    """
    short, enough = first - 1, most + 1
    tried: dict[int, float] = {}
    reach = min(max(expected, first), most)
    while enough - short > 1:
        tried[reach] = error(reach)
        if tried[reach] <= tol:
            enough = reach
        else:
            short = reach
        # A reach that gains nothing more has met rounding, which longer ones don't pass.
        if enough > most and len(tried) > _STALLED_STEPS:
            *_, before, last = sorted(tried)
            if tried[last] > 0.5 * tried[before]:
                break
        step = _step_towards(tol, tried, reach)
        reach = min(max(reach + step, short + 1), enough - 1, most)
    return enough if enough <= most else min(tried, key=lambda one: tried[one])


def _step_towards(tol: float, tried: dict[int, float], reach: int) -> int:
    """Return by how much the weights shall reach farther for a tolerance; negative for less.

    The slope is that of the errors at the two reaches that were `tried` next to `reach`.
    """
    digits = math.log10(max(tried[reach], 1e-300) / max(tol, 1e-300))
    slope = 1 / _FIRST_DIGIT_STEPS
    others = [one for one in tried if one != reach]
    if others:
        other = min(others, key=lambda one: abs(one - reach))
        fall = math.log10(max(tried[other], 1e-300) / max(tried[reach], 1e-300)) / (reach - other)
        slope = fall if fall > 0 else slope
    step = digits / slope
    return math.ceil(step) if step > 0 else min(math.ceil(step), -1)


def _fit_weights(
    factor: Fraction, band: float, reach: int, offset: float, tol: float
) -> tuple[NDArray[np.float64], float]:
    """Fit the weights of 2 reach + 1 samples to a pixel's transfer function, and tell their error.

    The pixel's centre has an offset from the middle sample. What the samples can hardly tell apart
    gets no weight: huge weights of opposite signs would amplify rounding.
    """
    width = float(factor)
    negligible = min(max(_NEGLIGIBLE * tol, 1e-15), 1e-6)
    fitted: NDArray[np.float64] = band * np.sin(np.pi / 2 * np.linspace(0, 1, 4 * reach + 16))
    judged: NDArray[np.float64] = np.linspace(0, band, 8 * reach + 33, dtype=np.float64)
    if offset:
        places: NDArray[np.float64] = np.arange(-reach, reach + 1, dtype=np.float64) - offset
        wanted = np.concatenate((width * np.sinc(width * fitted), np.zeros(fitted.size)))
        weights, *_ = np.linalg.lstsq(_waves(fitted, places), wanted, rcond=negligible)
        cosines, sines = np.split(_waves(judged, places) @ weights / width, 2)
        deviation = np.hypot(cosines - np.sinc(width * judged), sines)
    else:
        half, *_ = np.linalg.lstsq(
            _cosines(fitted, reach), width * np.sinc(width * fitted), rcond=negligible
        )
        deviation = _cosines(judged, reach) @ half / width - np.sinc(width * judged)
        weights = np.concatenate((half[:0:-1], half))
    return np.asarray(weights, dtype=np.float64), _ERROR_MARGIN * float(np.abs(deviation).max())


def _waves(frequency: NDArray[np.float64], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transfer functions of samples at places around a pixel's centre.

    The cosines stand above the sines, (2 frequencies, places).
    """
    turns = 2 * np.pi * np.outer(frequency, places)
    return np.concatenate((np.cos(turns), np.sin(turns)))


def _cosines(frequency: NDArray[np.float64], reach: int) -> NDArray[np.float64]:
    """Return the transfer functions of pairs of samples at distances 0 to `reach` from a pixel."""
    cosines: NDArray[np.float64] = 2 * np.cos(2 * np.pi * np.outer(frequency, np.arange(reach + 1)))
    cosines[:, 0] = 1
    return cosines


def expected_reach(oversampling: float, tol: float) -> float:
    """Estimate how far the weights of a pixel reach, in samples."""
    digits = -math.log10(tol) if tol > 1e-16 else 16.0
    return _SAMPLES_PER_DIGIT * max(digits, 0.0) / max(oversampling - 1, 0.05)
