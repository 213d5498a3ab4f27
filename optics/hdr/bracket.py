"""An exposure bracket: its frames and dark frames, the noise of both, and defective pixels.

A hot pixel has more dark signal than others. Dark frames take its mean off, and leave its noise,
which no stated variance counts. A stuck pixel has the same number at every exposure time.
EMVA 1288 (release 4.0, chapter 8) calls both defect pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.camera import Sensor
from optics.validation import require_unmasked

Array = NDArray[np.float32]
Frames = NDArray[Any] | Sequence[Any]
"""(frames, rows, columns), or a sequence of what can be sliced by rows, as frames in a file."""


@dataclass(frozen=True)
class Exposure:
    """All frames of one time.

    time: seconds. frames: their indices in the bracket. floor: variance of a frame without light,
    electrons². darks: number of dark frames whose mean is subtracted from each of them. dark_level:
    mean digital number of these. clip_level: electrons of light from which a frame clips.
    """

    time: float
    frames: tuple[int, ...]
    floor: float
    darks: float
    dark_level: float
    clip_level: float


class Bracket:
    """Frames of one scene with several exposure times, from one sensor.

    Parameters
    ----------
    frames : NDArray or sequence
        (frames, rows, columns) digital numbers, or a sequence of (rows, columns) that can be
        sliced by rows, as frames in a file.
    exposures : array_like
        Exposure time of each frame in seconds. Frames of the same time share their dark frames.
    darks : NDArray or sequence
        Mean of the dark frames for each frame, as frames; or one number for each frame.
    dark_counts : array_like
        Number of dark frames in each mean; infinite for a level that is known without noise.
    sensor : Sensor
        Tells gain, read noise, dark current and full scale.

    Raises
    ------
    ValueError
        For no frames, frames of different sizes, times that aren't positive, numbers that aren't
        finite, and lengths that don't match.
    """

    def __init__(
        self,
        frames: Frames,
        exposures: ArrayLike,
        darks: Frames,
        dark_counts: ArrayLike,
        sensor: Sensor,
    ) -> None:
        require_unmasked(frames, darks, exposures, dark_counts)
        self.frames, self.darks, self.sensor = frames, darks, sensor
        self.times = np.asarray(exposures, dtype=np.float64).ravel()
        self.dark_counts = np.asarray(dark_counts, dtype=np.float64).ravel()
        self.shape = self._require_matching()
        self.exposures: list[Exposure] = []
        for time in np.unique(self.times):
            indices = np.flatnonzero(self.times == time)
            floor = sensor.read_noise**2 + sensor.gain**2 / 12 + sensor.dark_current * time
            count = float(self.dark_counts[indices].min())
            level = float(np.mean(darks[indices[0]], dtype=np.float64))
            # A number of full scale stands for all above half a number less.
            clip = (sensor.full_scale - 0.5 - level) * sensor.gain
            one = Exposure(float(time), tuple(indices.tolist()), floor, count, level, clip)
            self.exposures.append(one)

    def _require_matching(self) -> tuple[int, int]:
        """Return (rows, columns) of the frames; raise ValueError if anything doesn't match."""
        count = len(self.times)
        if count == 0:
            raise ValueError("there are no exposures to merge; give at least one")
        shapes = {np.shape(one) for one in self.frames}
        if len(self.frames) != count or len(self.darks) != count:
            raise ValueError(
                f"{len(self.frames)} frames, {len(self.darks)} darks and {count} "
                "exposures don't match; give one dark and one exposure time for each frame"
            )
        if len(shapes) > 1:
            listed = ", ".join(str(one) for one in sorted(shapes))
            raise ValueError(f"frames are {listed} pixels; all frames of a bracket have one size")
        (shape,) = shapes
        if len(shape) != 2 or not math.prod(shape):
            raise ValueError(f"frames have the shape {shape}; each needs rows and columns")
        for dark in self.darks:
            if np.shape(dark) not in ((), shape):
                raise ValueError(
                    f"a dark is {np.shape(dark)} and the frames {shape} pixels, which don't "
                    "match; give darks of the frames' size, or a number for each"
                )
        if not (np.isfinite(self.times) & (self.times > 0)).all():
            raise ValueError(f"exposures are {self.times.tolist()} s; all must be positive")
        if len(self.dark_counts) != count or not (self.dark_counts >= 1).all():
            raise ValueError(
                f"dark_counts are {self.dark_counts.tolist()}; each exposure needs at least 1"
            )
        return int(shape[0]), int(shape[1])

    def electrons(
        self, index: int, rows: slice, chosen: NDArray[np.intp] | None = None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return electrons of light in some rows of a frame, and which pixels are clipped.

        chosen: indices of pixels in these rows; all by default. Raises ValueError for numbers that
        aren't finite.
        """
        numbers = np.asarray(self.frames[index][rows]).ravel()
        light = np.empty(numbers.shape if chosen is None else chosen.shape, dtype=np.float32)
        return light, self.read_electrons(index, rows, light, chosen)

    def read_electrons(
        self,
        index: int,
        rows: slice,
        light: Array,
        chosen: NDArray[np.intp] | None = None,
        time: float = 1.0,
    ) -> NDArray[np.bool_]:
        """Write electrons of light in some rows of a frame to an array; return which are clipped.

        time: seconds by which electrons are divided. As `electrons` otherwise.
        """
        numbers, dark = np.asarray(self.frames[index][rows]).ravel(), self.darks[index]
        dark = np.asarray(dark[rows] if np.ndim(dark) else dark)
        dark = dark.ravel() if dark.ndim else dark
        if chosen is not None:
            numbers, dark = numbers[chosen], dark[chosen] if dark.ndim else dark
        for name, one in (("frame", numbers), ("dark", dark)):
            # A sum is finite if all is, and quicker than a look at each number.
            if one.dtype.kind == "f" and not (np.isfinite(one.sum()) or np.isfinite(one).all()):
                raise ValueError(f"{name} {index} has NaN or infinite numbers; leave it out")
        np.copyto(light, numbers, casting="unsafe")
        light -= dark.astype(np.float32)
        light *= np.float32(self.sensor.gain / time)
        return np.asarray(numbers >= self.sensor.full_scale)

    def with_factors(self, factors: ArrayLike) -> Bracket:
        """Return the same frames with each time multiplied by a factor."""
        times = self.times * np.asarray(factors, dtype=np.float64)
        return Bracket(self.frames, times, self.darks, self.dark_counts, self.sensor)


# Robust deviations of a dark frame: none of ten megapixels by chance, with heavy tails; chosen
_HOT = 8.0
_STUCK = 5.0  # deviations without light within which all numbers of a stuck pixel agree; chosen
# Such deviations by which it is above its dark level: more than two of _STUCK's; chosen
_LIT = 10.0
# Exposures, and their range, over which light isn't constant; chosen
_LEAST_FRAMES, _LEAST_RATIO = 3, 4.0
_LISTED = 5  # pixels that are listed by their places; chosen


@dataclass(frozen=True, eq=False)
class Defects:
    """Pixels that don't measure light, (rows, columns): hot in dark frames, or stuck in all."""

    hot: NDArray[np.bool_]
    stuck: NDArray[np.bool_]

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Return all defective pixels."""
        return self.hot | self.stuck

    def explain(self) -> list[str]:
        """Say in words how many pixels are defective; nothing if none is."""
        found = []
        for mask, what in (
            (self.hot, "hot: the dark frames say so"),
            (self.stuck, "stuck: they have one number at all exposure times"),
        ):
            pixels = np.argwhere(mask)
            if pixels.size:
                places = ", ".join(f"({y}, {x})" for y, x in pixels[:_LISTED])
                more = ", …" if len(pixels) > _LISTED else ""
                found.append(f"{len(pixels)} pixels are {what}; (row, column) {places}{more}")
        return found


def find_defects(bracket: Bracket) -> Defects:
    """Find hot pixels by the dark frames, and stuck ones by the frames.

    Parameters
    ----------
    bracket : Bracket
        Hot pixels are found where its darks are measured frames, and stuck ones in three exposure
        times or more.

    Returns
    -------
    Defects
    """
    hot, stuck = np.zeros((2, *bracket.shape), dtype=bool)
    exposures = bracket.exposures
    shortest, longest = exposures[0], exposures[-1]
    dark = bracket.darks[longest.frames[0]]
    if np.ndim(dark) and math.isfinite(longest.darks):
        hot = _is_hot(np.asarray(dark))
    if len(exposures) >= _LEAST_FRAMES and longest.time / shortest.time >= _LEAST_RATIO:
        stuck = _is_stuck(bracket)
    return Defects(hot, stuck & ~hot)


def _is_hot(dark: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return where a mean dark frame is far above its median."""
    middle = np.median(dark)
    spread = 1.4826 * float(np.median(np.abs(dark - middle)))
    if spread == 0:
        # Most pixels have the same whole number.
        spread = max(float(np.std(np.clip(dark, middle - 1, middle + 1))), 1 / math.sqrt(12))
    return np.asarray(dark - middle > _HOT * spread)


def _is_stuck(bracket: Bracket) -> NDArray[np.bool_]:
    """Return where all frames have one number that is neither that of no light nor clipped."""
    gain, full = bracket.sensor.gain, bracket.sensor.full_scale
    noise = math.sqrt(max(one.floor for one in bracket.exposures)) / gain
    level = max(one.dark_level for one in bracket.exposures)
    lowest, highest = (np.array(bracket.frames[0]) for _ in range(2))
    for frame in bracket.frames:
        np.minimum(lowest, frame, out=lowest)
        np.maximum(highest, frame, out=highest)
    constant = highest - lowest <= _STUCK * noise
    return np.asarray(constant & (lowest > level + _LIT * noise) & (highest < full))
