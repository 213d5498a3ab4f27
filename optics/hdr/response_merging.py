"""Merge 8-bit pictures of a camera whose response curve is known.

The light of a pixel is that from which its numbers in all frames would follow best: least squares
of numbers, each over the noise that it has there. So a number tells nothing where the curve is
flat, as it is in the dark of a scanned film, whatever light the curve would give for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from optics.hdr.radiance import CLIPPED, DARK, VALID, RadianceEstimate
from optics.hdr.response_curve import HIGHEST, LOWEST, Numbers, ResponseCurve
from optics.validation import require_unmasked

Array = NDArray[np.float64]

_STEPS = 6
"""Gauss-Newton steps. Chosen: more change nothing."""

_LARGEST_STEP = 1.0
"""Largest step of the logarithm of light, against overshooting where the curve is flat. Chosen."""

_TILE = 1 << 18
"""Pixels that are merged together. Chosen."""

_DARK = 3.0
"""Standard deviations below which light counts as dark."""

_KNOWN = 1.0
"""Standard deviations from which on numbers tell light at all. Chosen: below it, the error is
larger than the light, and the estimate depends on where it started."""


def merge_by_response(
    frames: Sequence[Numbers] | Numbers,
    exposures: ArrayLike,
    curve: ResponseCurve,
    check: Callable[[float], None] = lambda share: None,
) -> RadianceEstimate:
    """Merge an exposure bracket of 8-bit pictures to light.

    Parameters
    ----------
    frames : sequence of NDArray
        Each (rows, columns), uint8.
    exposures : array_like
        Seconds, one for each frame.
    curve : ResponseCurve
        Of the camera: see `fit_response`.
    check : callable, optional
        Is called with the share that is done. It may raise, to end the work.

    Returns
    -------
    RadianceEstimate
        Light per second, in the curve's scale: 1 makes the number 128 in a second.

    Raises
    ------
    ValueError
        If frames aren't 8-bit, or their sizes or number don't match.
    """
    require_unmasked(frames, exposures)
    shapes = {np.shape(one) for one in frames}
    times = np.log(np.asarray(exposures, dtype=np.float64).ravel())
    if len(shapes) != 1 or len(frames) != len(times):
        raise ValueError(
            f"{len(frames)} frames of {len(shapes)} sizes and {len(times)} exposures don't match; "
            "give frames of one size, and an exposure time for each"
        )
    if any(np.asarray(one).dtype != np.uint8 for one in frames):
        raise ValueError("frames aren't 8-bit pictures; merge linear numbers with `merge`")
    ((rows, columns),) = shapes
    parts, step = [], max(1, _TILE // columns)
    for start in range(0, rows, step):
        check(start / rows)
        tile = np.array([one[start : start + step] for one in frames])
        parts.append(_merge_rows(tile, times, curve))
    return RadianceEstimate(
        *(torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    )


def _merge_rows(
    numbers: NDArray[np.uint8], times: Array, curve: ResponseCurve
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return light, variance and state of some rows of an 8-bit HDR bracket."""
    logs = _first_light(numbers, times, curve)
    for _ in range(_STEPS):
        slope, information = _slope(numbers, times, curve, logs)
        change = slope / np.maximum(information, 1e-9)
        logs += np.clip(change, -_LARGEST_STEP, _LARGEST_STEP)
    _, information = _slope(numbers, times, curve, logs)
    rate, (lowest, highest) = np.exp(logs), curve.ends
    variance = rate**2 / np.maximum(information, _KNOWN**2)
    state = np.where(information < _DARK**2, DARK, VALID).astype(np.uint8)
    # Without information on the light, it's above the curve's upper end or below the lower one.
    middle, shortest = len(curve.logs) / 2, numbers[times == times.min()].mean(axis=0)
    unknown = information < _KNOWN**2
    clipped = (numbers > HIGHEST).all(axis=0) | (unknown & (shortest > middle))
    rate[clipped] = np.exp(curve.logs[highest] - times.min())
    variance[clipped], state[clipped] = np.inf, CLIPPED
    least, dark = np.exp(curve.logs[lowest] - times.max()), unknown & ~clipped
    rate[dark], variance[dark] = np.minimum(rate[dark], least), least**2
    return rate.astype(np.float32), variance.astype(np.float32), state


def _first_light(numbers: NDArray[np.uint8], times: Array, curve: ResponseCurve) -> Array:
    """Return the logarithm of an 8-bit HDR bracket's light, by what each good number says."""
    level = np.arange(len(curve.logs))
    steep = np.gradient(curve.logs) ** -2.0 * ((level >= LOWEST) & (level <= HIGHEST)) + 1e-9
    above, below = (np.zeros(numbers.shape[1:]) for _ in range(2))
    for frame, time in zip(numbers, times, strict=True):
        weight = steep[frame]
        above += weight * (curve.logs[frame] - time)
        below += weight
    return np.asarray(above / below)


def _slope(
    numbers: NDArray[np.uint8], times: Array, curve: ResponseCurve, logs: Array
) -> tuple[Array, Array]:
    """Return the slope of an 8-bit HDR bracket's likelihood with the logarithm of light.

    The second value is the information on it.
    """
    slope, information = (np.zeros(logs.shape) for _ in range(2))
    for frame, time in zip(numbers, times, strict=True):
        expected, steep = curve.number(logs + time)
        variance = curve.number_noise**2 + (curve.light_noise * steep) ** 2
        # Whether a number is clipped is told by the light, and by the number itself.
        weight = ((frame <= HIGHEST) & (expected <= HIGHEST)) * steep / variance
        slope += weight * (frame - expected)
        information += weight * steep
    return slope, information
