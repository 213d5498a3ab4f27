"""Merge 8-bit pictures of a camera whose response curve is known.

The light of a pixel is that from which its numbers in all frames would follow best: least squares
of numbers, each over the noise that it has there. So a number tells nothing where the curve is
flat, as it is in the dark of a scanned film, whatever light the curve would give for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
        parts.append(_Pixels(tile, times, curve).merge(seen))
    return RadianceEstimate(
        *(torch.from_numpy(np.concatenate(one)) for one in zip(*parts, strict=True))
    )


@dataclass(frozen=True, eq=False)
class _Pixels:
    """Numbers of some pixels in all frames, (frames, ...), and logarithms of the frames' times.

    Masks of the methods, of the same shape, say which frames are used where.
    """

    numbers: NDArray[Any]
    times: Array
    curve: ResponseCurve

    def merge(
        self, seen: Mask
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
        """Return light, variance and state of pixels that the frames show where they are seen."""
        numbers, times, curve = self.numbers, self.times, self.curve
        logs, information = self._light(seen)
        moved, used = np.zeros(logs.shape, dtype=bool), seen.copy()
        for _ in range(len(times) - 1):
            away = self._contradictions(used, logs)
            again = (away.max(axis=0) > _CONTRADICTS) & (used.sum(axis=0) > 1)
            if not again.any():
                break
            before = used[:, again]
            few = _Pixels(numbers[:, again], times, curve)
            used[:, again], logs[again], information[again] = few._without_one(before)
            moved[again] |= (used[:, again] != before).any(axis=0)
        rate, (lowest, highest) = np.exp(logs), curve.ends
        variance = rate**2 / np.maximum(information, _KNOWN**2)
        state = np.where(moved, MOVED, VALID).astype(np.uint8)
        state[information < _DARK**2] = DARK
        # Without information on the light, it's above the curve's upper end or below the lower one.
        middle, unknown = len(curve.logs) / 2, information < _KNOWN**2
        clipped = ((numbers > HIGHEST) | ~seen).all(axis=0)
        clipped |= unknown & (self._of_shortest(seen) > middle)
        least_time = np.where(seen, times.reshape(-1, *[1] * logs.ndim), np.inf).min(axis=0)
        rate[clipped] = np.exp(curve.logs[highest] - least_time[clipped])
        variance[clipped], state[clipped] = np.inf, CLIPPED
        least, dark = np.exp(curve.logs[lowest] - times.max()), unknown & ~clipped
        rate[dark], variance[dark] = np.minimum(rate[dark], least), least**2
        return rate.astype(np.float32), variance.astype(np.float32), state

    def _of_shortest(self, seen: Mask) -> Array:
        """Return the number of each pixel in the shortest frame that shows it."""
        found = np.zeros(self.numbers.shape[1:])
        for time in self.times[np.argsort(-self.times, kind="stable")]:
            alike = self.times == time
            count = seen[alike].sum(axis=0)
            mean = (self.numbers[alike] * seen[alike]).sum(axis=0) / np.maximum(count, 1)
            found = np.where(count > 0, mean, found)
        return found

    def _light(self, used: Mask) -> tuple[Array, Array]:
        """Return the logarithm of light, and the information on it."""
        level = np.arange(len(self.curve.logs))
        good = (level >= LOWEST) & (level <= HIGHEST)
        steep = np.gradient(self.curve.logs) ** -2.0 * good + 1e-9
        # Numbers beyond the upper end are no light's.
        light = np.minimum(self.curve.logs, self.curve.logs[self.curve.ends[1]])
        above, below = np.zeros((2, *self.numbers.shape[1:]))
        for frame, one, time in zip(self.numbers, used, self.times, strict=True):
            nearest = frame if frame.dtype == np.uint8 else np.rint(frame).astype(np.uint8)
            weight = steep[nearest] * one
            above += weight * (light[nearest] - time)
            below += weight
        logs = np.asarray(above / np.maximum(below, 1e-12))
        for _ in range(_STEPS):
            slope, information = self._slope(used, logs)
            change = slope / np.maximum(information, 1e-9)
            logs += np.clip(change, -_LARGEST_STEP, _LARGEST_STEP)
        return logs, self._slope(used, logs)[1]

    def _slope(self, used: Mask, logs: Array) -> tuple[Array, Array]:
        """Return the slope of the likelihood with light's logarithm, and the information on it."""
        slope, information = np.zeros((2, *logs.shape))
        for frame, one, time in zip(self.numbers, used, self.times, strict=True):
            expected, steep, variance = self._expected(logs + time)
            # Whether a number is clipped is told by the light, and by the number itself.
            weight = (one & (frame <= HIGHEST) & (expected <= HIGHEST)) * steep / variance
            slope += weight * (frame - expected)
            information += weight * steep
        return slope, information

    def _expected(self, logs: Array) -> tuple[Array, Array, Array]:
        """Return a frame's numbers, their slope and their variance, by exposures' logarithms."""
        curve = self.curve
        expected, steep = curve.number(logs)
        return expected, steep, curve.number_noise**2 + (curve.light_noise * steep) ** 2

    def _without_one(self, used: Mask) -> tuple[Mask, Array, Array]:
        """Leave out, in each pixel, the frame whose absence leaves the least contradiction.

        Returns the frames that are still used, the logarithm of light, and the information on it.
        """
        found = []
        for place, time in enumerate(self.times):
            without = used.copy()
            without[place] = False
            logs, information = self._light(without)
            left = (self._contradictions(without, logs).astype(np.float64) ** 2).sum(axis=0)
            # Of those that contradict each other alike, the longest tells most and is kept.
            left += _LONGEST * (time - self.times.min())
            left[~used[place] | (information < _KNOWN**2)] = np.inf
            found.append((left, without, logs, information))
        left, without, logs, information = (np.stack(one) for one in zip(*found, strict=True))
        best, every = left.argmin(axis=0), np.arange(used.shape[1])
        nothing = ~np.isfinite(left.min(axis=0))
        kept = without[best, :, every].T
        light, known = logs[best, every], information[best, every]
        # If nothing would be left, all stays.
        rest = _Pixels(self.numbers[:, nothing], self.times, self.curve)
        kept[:, nothing] = used[:, nothing]
        light[nothing], known[nothing] = rest._light(used[:, nothing])
        return kept, light, known

    def _contradictions(self, used: Mask, logs: Array) -> NDArray[np.float32]:
        """Return by how many deviations frames contradict the others.

        A clipped number contradicts if the light of the others is far from clipping.
        """
        away, information = np.zeros((2, *self.numbers.shape), dtype=np.float32)
        lowest = self.curve.ends[0]
        for place, (frame, one, time) in enumerate(
            zip(self.numbers, used, self.times, strict=True)
        ):
            expected, steep, variance = self._expected(logs + time)
            # Numbers beyond the curve's ends are no light's.
            shown = np.clip(frame, lowest, HIGHEST)
            away[place] = one * np.abs(shown - np.clip(expected, lowest, HIGHEST))
            away[place] /= np.sqrt(variance + _EDGES**2)
            information[place] = one & (frame <= HIGHEST) & (expected <= HIGHEST)
            information[place] *= steep**2 / variance
        whole = np.maximum(information.sum(axis=0), np.float32(1e-9))
        # The light follows each frame by its share of the information.
        away /= np.sqrt(np.maximum(1 - information / whole, 0.05))
        return away
