"""Frames in pairs of the same exposure time, and the noise of a pair."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.validation import require_unmasked

Pairs = dict[float, list[tuple[int, int]]]
"""Indices of two frames each, by exposure time in seconds."""

MIN_EXPOSURES = 5
"""Fewest exposure times of a photon transfer curve. EMVA 1288 asks for 50."""

# Fewest pixels of an area: its variance is then known to 3 %, and about normal; chosen
_AREA_PIXELS = 2000
# Sixteen points for each exposure time tell whether the fit describes them; chosen
_AREAS_A_SIDE = 4
# Pixels: longest side of an area, which limits the memory for all of its frames
_LARGEST_AREA = 500


@dataclass(frozen=True, eq=False)
class PairedFrames:
    """Frames of even light and dark frames of one camera, two or more of each exposure time.

    Parameters
    ----------
    frames : sequence
        Digital numbers, (rows, columns) each: arrays, or what is sliced as they are.
    exposures : array_like of float
        Exposure time of each frame in seconds.
    lit : array_like of bool
        Whether a frame shows the light; the others are dark.
    top_number : int
        Largest number of the converter, 2**bits - 1.
    period : tuple of int, default (1, 1)
        Rows and columns after which the sensor's colour filters repeat.
    times : array_like of float, optional
        When each exposure began, in seconds, to tell a drift of the lamp.

    Raises
    ------
    ValueError
        If frames differ in size, a pair lacks a frame or its dark frames, there are fewer than
        five exposure times, or only light or only darkness.
    """

    frames: Sequence[Any]
    exposures: NDArray[np.float64]
    lit: NDArray[np.bool_]
    top_number: int
    period: tuple[int, int] = (1, 1)
    times: NDArray[np.float64] | None = None
    light: Pairs = field(init=False)
    dark: Pairs = field(init=False)

    def __post_init__(self) -> None:
        require_unmasked(self.frames, self.exposures, self.lit, self.times)
        times = None if self.times is None else np.asarray(self.times, dtype=np.float64).ravel()
        vars(self).update(
            exposures=np.asarray(self.exposures, dtype=np.float64).ravel(),
            lit=np.asarray(self.lit, dtype=bool).ravel(),
            times=times,
        )
        self._require_alike()
        vars(self)["light"] = _pairs(self.exposures, self.lit, "lit")
        vars(self)["dark"] = _pairs(self.exposures, ~self.lit, "dark")
        missing = [time for time in self.light if time not in self.dark]
        if missing:
            listed = ", ".join(f"{time * 1e3:g}" for time in missing[:5])
            more = f" and {len(missing) - 5} more" if len(missing) > 5 else ""
            raise ValueError(
                f"there are no dark frames of {listed} ms{more}; take two of every exposure time"
            )
        if len(self.light) < MIN_EXPOSURES:
            raise ValueError(
                f"the light was taken at {len(self.light)} exposure times, and a curve needs "
                f"{MIN_EXPOSURES} or more; take them evenly from darkness to saturation"
            )

    def _require_alike(self) -> None:
        """Raise ValueError unless all frames fit together."""
        count = len(self.frames)
        if not count or len(self.exposures) != count or len(self.lit) != count:
            raise ValueError(
                f"{count} frames, {len(self.exposures)} exposures and {len(self.lit)} marks of "
                "light don't match; give one of each for every frame"
            )
        shapes = {tuple(one.shape) for one in self.frames}
        if len(shapes) > 1 or len(min(shapes)) != 2:
            listed = ", ".join(str(one) for one in sorted(shapes))
            raise ValueError(f"frames are {listed} pixels; all need the same rows and columns")
        wrong = self.exposures[~((self.exposures > 0) & np.isfinite(self.exposures))]
        if wrong.size:
            raise ValueError(f"an exposure is {wrong[0]:g} s; all must be positive")
        if not self.lit.any():
            raise ValueError("all frames are dark; take frames of an evenly lit target, too")
        if self.lit.all():
            raise ValueError("no frame is dark; take two dark frames of every exposure time, too")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frames."""
        rows, columns = self.frames[0].shape
        return int(rows), int(columns)

    @property
    def areas(self) -> list[tuple[slice, slice]]:
        """Areas that cover the sensor, each with the same colour filter in its corner."""
        own = math.prod(self.shape) / math.prod(self.period)
        sides = max(1, min(_AREAS_A_SIDE, math.isqrt(int(own / _AREA_PIXELS))))
        found = []
        for length, step in zip(self.shape, self.period, strict=True):
            count = max(sides, math.ceil(length / (_LARGEST_AREA * step)))
            ends = np.linspace(0, length / step, count + 1).round().astype(int) * step
            ends[-1] = length
            pairs = itertools.pairwise(ends.tolist())
            found.append([slice(a, b) for a, b in pairs if b > a])
        rows, columns = found
        return [(y, x) for y in rows for x in columns]


def _pairs(exposures: NDArray[np.float64], chosen: NDArray[np.bool_], kind: str) -> Pairs:
    """Group the chosen frames in pairs, in the order in which they were taken."""
    found: Pairs = {}
    for time in np.unique(exposures[chosen]):
        indices = np.flatnonzero(chosen & (exposures == time)).tolist()
        if len(indices) < 2:
            raise ValueError(
                f"there is one {kind} frame of {time * 1e3:g} ms; noise is measured on two or more "
                "of the same exposure time"
            )
        found[float(time)] = list(zip(indices[0::2], indices[1::2], strict=False))
    return found


Frame = NDArray[Any]
Mask = NDArray[np.bool_]

_BLOCK = 16  # pixels: side of the blocks over which the light's change counts as even; chosen
_SURE_SIGNAL = 100.0  # signal over its noise from which frames tell a change of the lamp; chosen


@dataclass(frozen=True)
class PairNoise:
    """Mean and temporal noise of two frames of the same exposure time.

    mean: of both, DN.
    variance: temporal, of a frame, DN².
    spread: variance of a squared difference over the square of its mean, 2 for normal noise on
        evenly lit pixels.
    count: independent squared differences.
    ratio: light of the second frame over that of the first.
    """

    mean: float
    variance: float
    spread: float
    count: int
    ratio: float


def measure_pair(first: Frame, second: Frame, good: Mask, dark: float | None = None) -> PairNoise:
    """Measure mean and temporal noise of a pair of frames, on good pixels.

    dark: mean number without light; None for frames that are dark themselves.

    The estimate of the variance is unbiased for any light, even or not, that keeps its shape.
    """
    a, b = first.astype(np.float64), second.astype(np.float64)
    means = float(a[good].mean()), float(b[good].mean())
    ratio = 1.0
    if dark is not None:
        signals = means[0] - dark, means[1] - dark
        chance = float(np.std((a - b)[good])) / math.sqrt(int(good.sum()))
        if min(signals) > _SURE_SIGNAL * chance:
            ratio = signals[1] / signals[0]
            # Half the difference's variance stays K times the mean signal of both.
            root = math.sqrt(ratio)
            a, b = (a - dark) * root, (b - dark) / root
    left, freedom = _without_blocks(a - b, good)
    squares = left[good] ** 2
    mean_square = float(squares.mean())
    spread = float((squares**2).mean()) / mean_square**2 - 1 if mean_square else 2.0
    count = max(freedom, 1)
    return PairNoise(
        sum(means) / 2, float(squares.sum()) / count / 2, max(spread, 0.0), count, ratio
    )


def _without_blocks(difference: NDArray[np.float64], good: Mask) -> tuple[Frame, int]:
    """Return a difference less the mean of each block, and the degrees of freedom."""
    starts = [np.arange(0, n, _BLOCK) for n in difference.shape]
    sums, counts = (
        np.add.reduceat(np.add.reduceat(one, starts[0], axis=0), starts[1], axis=1)
        for one in (np.where(good, difference, 0.0), good.astype(np.int64))
    )
    means = sums / np.maximum(counts, 1)
    for axis, n in enumerate(difference.shape):
        means = means.repeat(np.diff(np.append(starts[axis], n)), axis=axis)
    return difference - means, int(np.maximum(counts - 1, 0).sum())
