"""Hold a camera's frames of even light and of darkness, in pairs of the same exposure time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optics.validation import require_unmasked

Area = tuple[slice, slice]
Pairs = dict[float, list[tuple[int, int]]]
"""Indices of two frames each, by exposure time in seconds."""

MIN_EXPOSURES = 5
"""Fewest exposure times of a photon transfer curve. EMVA 1288 asks for 50."""

_AREA_PIXELS = 2000
"""Fewest pixels of an area: its variance is then known to 3 %, and about normal. Chosen."""

_AREAS_A_SIDE = 4
"""Areas along either side of a sensor with pixels enough. Chosen: sixteen points for each exposure
time tell whether the fit describes them."""

_LARGEST_AREA = 500
"""Longest side of an area in pixels, which limits the memory for all of its frames."""


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
        for name, value in (
            ("exposures", np.asarray(self.exposures, dtype=np.float64).ravel()),
            ("lit", np.asarray(self.lit, dtype=bool).ravel()),
            ("times", times),
        ):
            object.__setattr__(self, name, value)
        self._require_alike()
        object.__setattr__(self, "light", _pairs(self.exposures, self.lit, "lit"))
        object.__setattr__(self, "dark", _pairs(self.exposures, ~self.lit, "dark"))
        self._require_darks()

    def _require_alike(self) -> None:
        """Raise ValueError unless all of the camera's frames fit together."""
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

    def _require_darks(self) -> None:
        """Raise ValueError unless the camera's exposures are enough, each with its dark frames."""
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

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the camera's frames."""
        rows, columns = self.frames[0].shape
        return int(rows), int(columns)

    @property
    def areas(self) -> list[Area]:
        """Areas that cover the sensor, each with the same colour filter in its corner."""
        rows, columns = self.shape
        own = rows * columns / math.prod(self.period)
        sides = max(1, min(_AREAS_A_SIDE, math.isqrt(int(own / _AREA_PIXELS))))
        edges = [
            _edges(n, max(sides, math.ceil(n / (_LARGEST_AREA * step))), step)
            for n, step in zip((rows, columns), self.period, strict=True)
        ]
        return [(y, x) for y in edges[0] for x in edges[1]]


def _edges(length: int, count: int, step: int) -> list[slice]:
    """Divide one side of a camera's frame into slices that begin at multiples of a step."""
    ends = np.linspace(0, length / step, count + 1).round().astype(int) * step
    ends[-1] = length
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends) if b > a]


def _pairs(exposures: NDArray[np.float64], chosen: NDArray[np.bool_], kind: str) -> Pairs:
    """Group the camera's chosen frames in pairs, in the order in which they were taken."""
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
