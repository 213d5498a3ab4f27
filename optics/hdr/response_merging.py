"""Merge 8-bit pictures of a camera whose response curve is known.

The light of a pixel is that from which its numbers in all frames would follow best: least squares
of numbers, each over the noise that it has there. So a number tells nothing where the curve is
flat, as it is in the dark of a scanned film, whatever light the curve would give for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from optics.hdr.merging import CLIPPED, DARK, MOVED, VALID, RadianceEstimate
from optics.hdr.response_curve import HIGHEST, LOWEST, ResponseCurve
from optics.validation import require_unmasked

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEPS = 6  # Gauss-Newton steps: more change nothing; chosen
_LARGEST_STEP = 1.0  # of light's logarithm, against overshooting where the curve is flat; chosen
_TILE = 1 << 16  # pixels merged together: what is made of them stays near the processor; chosen
_DARK = 3.0  # standard deviations below which light counts as dark
_KNOWN = 1.0  # deviations: below, the error exceeds the light, and the start decides; chosen
# Deviations by which a frame contradicts the others where something moved; chosen
_CONTRADICTS = 6.0
_EDGES = 3.0  # numbers by which pixels at edges differ by compression and interpolation; chosen
# Squared deviations for each factor of e in time by which longer frames are kept; chosen
_LONGEST = 1.0


def merge_by_response(
    frames: Sequence[NDArray[Any]] | NDArray[Any],
    exposures: ArrayLike,
    curve: ResponseCurve,
    check: Callable[[float], None] = lambda share: None,
    outside: Sequence[NDArray[np.bool_]] | None = None,
) -> RadianceEstimate:
    """Merge 8-bit pictures to light by the response curve of their camera.

    Where one exposure contradicts the others, something moved, and it is left out.

    Parameters
    ----------
    frames : sequence of NDArray
        Each (rows, columns), uint8; or float32, numbers between those of 8-bit pixels.
    exposures : array_like
        Seconds, one for each frame.
    curve : ResponseCurve
        Of the camera: see `fit_response`.
    check : callable, optional
        Is called with the share that is done. It may raise, to end the work.
    outside : sequence of NDArray of bool, optional
        Where each frame shows nothing, as one that was aligned; nowhere by default.

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
    if any(np.asarray(one).dtype not in (np.uint8, np.float32) for one in frames):
        raise ValueError("frames aren't 8-bit pictures; merge linear numbers with `merge`")
    ((rows, columns),) = shapes
    parts, step = [], max(1, _TILE // columns)
    for start in range(0, rows, step):
        check(start / rows)
        tile = np.array([one[start : start + step] for one in frames])
        seen = np.ones(tile.shape, dtype=bool)
        if outside is not None:
            seen = ~np.array([one[start : start + step] for one in outside])
        parts.append(_merge_rows(tile, seen, times, curve))
    return RadianceEstimate(
        *(torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    )


def _merge_rows(
    numbers: NDArray[Any], seen: Mask, times: Array, curve: ResponseCurve
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return light, variance and state of some rows."""
    logs, information = _light(numbers, seen, times, curve)
    moved, used = np.zeros(logs.shape, dtype=bool), seen.copy()
    for _ in range(len(times) - 1):
        away = _contradictions(numbers, used, times, curve, logs)
        again = np.nonzero((away.max(axis=0) > _CONTRADICTS) & (used.sum(axis=0) > 1))
        if not again[0].size:
            break
        few, still = (np.stack([one[again] for one in every]) for every in (numbers, used))
        still, logs[again], information[again] = _without_one(few, still, times, curve)
        moved[again] |= (still != np.stack([one[again] for one in used])).any(axis=0)
        for one, kept in zip(used, still, strict=True):
            one[again] = kept
    rate, (lowest, highest) = np.exp(logs), curve.ends
    variance = rate**2 / np.maximum(information, _KNOWN**2)
    state = np.where(moved, MOVED, VALID).astype(np.uint8)
    state[information < _DARK**2] = DARK
    # Without information on the light, it's above the curve's upper end or below the lower one.
    middle, shortest = len(curve.logs) / 2, _of_shortest(numbers, seen, times)
    unknown = information < _KNOWN**2
    clipped = ((numbers > HIGHEST) | ~seen).all(axis=0) | (unknown & (shortest > middle))
    least_time = np.where(seen, times.reshape(-1, *[1] * logs.ndim), np.inf).min(axis=0)
    rate[clipped] = np.exp(curve.logs[highest] - least_time[clipped])
    variance[clipped], state[clipped] = np.inf, CLIPPED
    least, dark = np.exp(curve.logs[lowest] - times.max()), unknown & ~clipped
    rate[dark], variance[dark] = np.minimum(rate[dark], least), least**2
    return rate.astype(np.float32), variance.astype(np.float32), state


def _of_shortest(numbers: NDArray[Any], seen: Mask, times: Array) -> Array:
    """Return the number of each pixel in the shortest frame that shows it."""
    found = np.zeros(numbers.shape[1:])
    for one in np.argsort(-times, kind="stable"):
        alike = times == times[one]
        count = seen[alike].sum(axis=0)
        mean = (numbers[alike] * seen[alike]).sum(axis=0) / np.maximum(count, 1)
        found = np.where(count > 0, mean, found)
    return found


def _light(
    numbers: NDArray[Any], used: Mask, times: Array, curve: ResponseCurve
) -> tuple[Array, Array]:
    """Return the logarithm of light, and the information on it."""
    logs = _first_light(numbers, used, times, curve)
    for _ in range(_STEPS):
        slope, information = _slope(numbers, used, times, curve, logs)
        change = slope / np.maximum(information, 1e-9)
        logs += np.clip(change, -_LARGEST_STEP, _LARGEST_STEP)
    _, information = _slope(numbers, used, times, curve, logs)
    return logs, information


def _first_light(numbers: NDArray[Any], used: Mask, times: Array, curve: ResponseCurve) -> Array:
    """Return the logarithm of light by what each good number says."""
    level = np.arange(len(curve.logs))
    steep = np.gradient(curve.logs) ** -2.0 * ((level >= LOWEST) & (level <= HIGHEST)) + 1e-9
    # Numbers beyond the upper end are no light's.
    light = np.minimum(curve.logs, curve.logs[curve.ends[1]])
    above, below = (np.zeros(numbers.shape[1:]) for _ in range(2))
    for frame, one, time in zip(numbers, used, times, strict=True):
        nearest = frame if frame.dtype == np.uint8 else np.rint(frame).astype(np.uint8)
        weight = steep[nearest] * one
        above += weight * (light[nearest] - time)
        below += weight
    return np.asarray(above / np.maximum(below, 1e-12))


def _slope(
    numbers: NDArray[Any], used: Mask, times: Array, curve: ResponseCurve, logs: Array
) -> tuple[Array, Array]:
    """Return the slope of the likelihood with the logarithm of light, and the information on it."""
    slope, information = (np.zeros(logs.shape) for _ in range(2))
    for frame, one, time in zip(numbers, used, times, strict=True):
        expected, steep, variance = _expected(curve, logs + time)
        # Whether a number is clipped is told by the light, and by the number itself.
        weight = (one & (frame <= HIGHEST) & (expected <= HIGHEST)) * steep / variance
        slope += weight * (frame - expected)
        information += weight * steep
    return slope, information


def _expected(curve: ResponseCurve, logs: Array) -> tuple[Array, Array, Array]:
    """Return a frame's numbers, their slope and their variance, by exposures' logarithms."""
    expected, steep = curve.number(logs)
    return expected, steep, curve.number_noise**2 + (curve.light_noise * steep) ** 2


def _without_one(
    numbers: NDArray[Any], used: Mask, times: Array, curve: ResponseCurve
) -> tuple[Mask, Array, Array]:
    """Leave out, in each pixel, the frame whose absence leaves the least contradiction.

    Returns the frames that are still used, the logarithm of light, and the information on it.
    """
    found = []
    for place in range(len(times)):
        without = used.copy()
        without[place] = False
        logs, information = _light(numbers, without, times, curve)
        away = _contradictions(numbers, without, times, curve, logs)
        left = (away.astype(np.float64) ** 2).sum(axis=0)
        # Of those that contradict each other alike, the longest tells most and is kept.
        left += _LONGEST * (times[place] - times.min())
        left[~used[place] | (information < _KNOWN**2)] = np.inf
        found.append((left, without, logs, information))
    left, without, logs, information = (np.stack(one) for one in zip(*found, strict=True))
    best, every = left.argmin(axis=0), np.arange(used.shape[1])
    nothing = ~np.isfinite(left.min(axis=0))
    kept = without[best, :, every].T
    light, known = logs[best, every], information[best, every]
    # If nothing would be left, all stays.
    kept[:, nothing] = used[:, nothing]
    light[nothing], known[nothing] = _light(numbers[:, nothing], used[:, nothing], times, curve)
    return kept, light, known


def _contradictions(
    numbers: NDArray[Any], used: Mask, times: Array, curve: ResponseCurve, logs: Array
) -> NDArray[np.float32]:
    """Return by how many deviations frames contradict the others.

    A clipped number contradicts if the light of the others is far from clipping.
    """
    away, information = (np.zeros(numbers.shape, dtype=np.float32) for _ in range(2))
    for place, (frame, one, time) in enumerate(zip(numbers, used, times, strict=True)):
        expected, steep, variance = _expected(curve, logs + time)
        # Numbers beyond the curve's ends are no light's.
        shown = np.clip(frame, curve.ends[0], HIGHEST)
        away[place] = one * np.abs(shown - np.clip(expected, curve.ends[0], HIGHEST))
        away[place] /= np.sqrt(variance + _EDGES**2)
        information[place] = one & (frame <= HIGHEST) & (expected <= HIGHEST)
        information[place] *= steep**2 / variance
    whole = np.maximum(information.sum(axis=0), np.float32(1e-9))
    # The light follows each frame by its share of the information.
    away /= np.sqrt(np.maximum(1 - information / whole, 0.05))
    return away
