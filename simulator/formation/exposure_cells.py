"""Divide an exposure into cells, each with one mean PSF and one path of the object.

The panel's picture, the object's place and the lamp's brightness change with time. A cell's weight
is the time for which a pixel's row sees it, times the lamp's brightness during that time.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from optics.sensor.readout import row_starts
from optics.validation import require_positive
from simulator.panel_content import FrameSequence, PanelState, PictureShares, Span
from simulator.recipe import Recipe
from simulator.situation import Situation

Array = NDArray[np.float64]
K = TypeVar("K", str, tuple[int, int])

PanelStates = list[tuple[PanelState, Array]]
"""What the panel shows, with the weight of a cell."""


@dataclass(frozen=True, eq=False)
class ExposureCell:
    """A part of an exposure with one mean PSF and one path of the object.

    number: its index. panel_state: what the panel shows. shift: (y, x) metres on the object to the
    middle of its path. path: (y, x) metres that it moves. weight: seconds of the lamp's mean light
    that each row sees, (rows,), or (1,) if all rows see the same.
    """

    number: int
    panel_state: PanelState
    shift: tuple[float, float]
    path: tuple[float, float]
    weight: Array


def exposure_cells(s: Situation, recipe: Recipe) -> list[ExposureCell]:
    """Divide an exposure into cells, each with one mean PSF and one path of the object.

    Raises ValueError for an exposure that isn't positive and finite.
    """
    require_positive("exposure", s.exposure, "s")
    starts = row_starts(s.camera.sensor, s.exposure_start, rolling=recipe.rolling).numpy()
    if starts[0] == starts[-1]:
        starts = starts[:1]
    crystal = recipe.crystal and s.panel_content.is_changing
    found: list[ExposureCell] = []
    states: PanelStates
    for begin, end in _cuts(s, recipe, starts):
        shift, path = _shift_and_path(s, recipe, begin, end)
        if len(starts) == 1 and not recipe.lamp:
            look = s.panel_content.frame_sequence if crystal else s.panel_content.picture_shares
            seconds = end - begin
            states = [(look(begin, seconds), np.array([seconds]))]
        else:
            pieces = _PanelTimes(s, recipe, starts, begin, end)
            states = pieces.frame_weights() if crystal else pieces.picture_weights()
        for state, weight in states:
            found.append(ExposureCell(len(found), state, shift, path, weight))
    return found


def _cuts(s: Situation, recipe: Recipe, starts: Array) -> Iterator[tuple[float, float]]:
    """Yield begin and end of the parts into which the exposure of a moving target is cut.

    The recipe gives the number of parts per exposure time.
    """
    first, whole = float(starts[0]), float(starts[-1] - starts[0]) + s.exposure
    count = 1
    if s.target.is_moving and recipe.motion > 1:
        count = recipe.motion * max(1, math.ceil(whole / s.exposure))
    ends = first + whole * (np.arange(count + 1) / count)
    yield from zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)


def _shift_and_path(
    s: Situation, recipe: Recipe, begin: float, end: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return a target's shift and path between two times, (y, x) metres; 0 if it is still."""
    if not s.target.is_moving:
        return (0.0, 0.0), (0.0, 0.0)
    vy, vx = s.target.velocity
    if recipe.motion == 1:
        middle = s.exposure / 2
        return (vy * middle, vx * middle), (0.0, 0.0)
    middle, seconds = (begin + end) / 2 - s.exposure_start, end - begin
    return (vy * middle, vx * middle), (vy * seconds, vx * seconds)


@dataclass(frozen=True)
class _PanelTimes:
    """What each row sees of the panel's pictures between two times."""

    s: Situation
    recipe: Recipe
    starts: Array
    begin: float
    end: float

    def picture_weights(self) -> PanelStates:
        """Return what the panel shows, with each row's weight, if the crystal responds at once."""
        present = self._row_weights(1, lambda frame: self.s.panel_content.names[frame])
        return self._states(present, lambda shares: PictureShares(tuple(shares.items())))

    def frame_weights(self) -> PanelStates:
        """Return parts of video frames, with each row's weight, for a slow crystal."""
        parts = 8  # Rows and lamp weight each eighth of a frame by itself.
        shown, seconds = self.s.panel_content, self.s.panel_content.frame_time / parts
        present = self._row_weights(parts, lambda part: divmod(part, parts))

        def sequence(shares: dict[tuple[int, int], float]) -> FrameSequence:
            spans = tuple(
                Span(frame, part * seconds, (part + 1) * seconds, share)
                for (frame, part), share in shares.items()
            )
            return FrameSequence(shown.names, shown.frame_time, spans)

        return self._states({key: present[key] for key in sorted(present)}, sequence)

    def _states(
        self, weights: dict[K, Array], state: Callable[[dict[K, float]], PanelState]
    ) -> PanelStates:
        """Return the states of shares of items; a single one if all rows see the same."""
        if len(self.starts) > 1:
            return [(state({key: 1.0}), weights[key]) for key in sorted(weights)]
        total = sum(float(weight[0]) for weight in weights.values())
        shares = {key: float(weights[key][0]) / total for key in sorted(weights)}
        return [(state(shares), np.array([total]))] if weights else []

    def _row_weights(self, parts: int, of: Callable[[int], K]) -> dict[K, Array]:
        """Return the seconds of the lamp's mean light for which each row sees each item of a video.

        of: returns the item, such as a picture's name, of a part of a frame. Unseen items are left
        out.
        """
        weights: defaultdict[K, Array] = defaultdict(lambda: np.zeros(len(self.starts)))
        for numbers, begins, ends in self._intervals(parts):
            seen = self._light_seconds(begins, ends)
            for number in np.unique(numbers):
                key = of(int(number))
                weights[key] = weights[key] + seen[:, numbers == number].sum(1)
        return {key: weight for key, weight in weights.items() if weight.any()}

    def _intervals(self, parts: int) -> Iterator[tuple[NDArray[np.int64], Array, Array]]:
        """Yield when the panel shows each part of a frame: batches of (index, begins, ends)."""
        shown = self.s.panel_content
        if not shown.is_changing or math.isinf(shown.frame_time):
            yield np.zeros(1, dtype=np.int64), np.array([self.begin]), np.array([self.end])
            return
        unit = shown.frame_time / parts
        first, last = math.floor(self.begin / unit), math.ceil(self.end / unit)
        if last - first > 2_000_000:
            raise ValueError(
                f"the video shows {last - first} parts of frames within the exposure, more than "
                "are weighed one by one; expose shorter, or without flicker and rolling shutter"
            )
        for low in range(first, last, 4096):
            index = np.arange(low, min(low + 4096, last))
            begins = np.maximum(index * unit, self.begin)
            ends = np.minimum((index + 1) * unit, self.end)
            yield index % (parts * len(shown.names)), begins, np.maximum(ends, begins)

    def _light_seconds(self, begins: Array, ends: Array) -> Array:
        """Return the seconds of mean light that each row collects, (rows, intervals)."""
        low = np.maximum(begins, self.starts[:, None])
        high = np.maximum(np.minimum(ends, self.starts[:, None] + self.s.exposure), low)
        lamp = self.s.target.lamp
        if not self.recipe.lamp or lamp is None:
            return high - low
        return (high - low) * lamp.mean(low, high)
