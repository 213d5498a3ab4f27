"""How many frames a camera still delivers with the old exposure after a change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_FRAMES = 8
"""Frames after a change that are discarded while a camera's latency is unknown. Chosen: the cameras
that take longest to obey have queues of about so many frames."""

_LEAST_CHANGE = 1.25
"""Ratio of two exposures from which on the light of their frames tells them apart. Chosen."""

_ALIKE = 0.1
"""Deviation of light from the ratio of the exposures, relative, up to which it follows. Chosen."""

_SAMPLES = 1_000_000
"""Pixels of a frame that are looked at, at most. Chosen: that takes some milliseconds."""

_BRIGHTEST = 16
"""The brightest pixels whose mean is the level of a picture, or a thousandth of all. Chosen."""

TakeLevels = Callable[[float], Sequence[tuple[int, float]]]
"""Sets an exposure in seconds and returns, for each picture after it in order, how many frames came
since, and its light level."""


def measure_old_frames(take_levels: TakeLevels, exposures: Sequence[float], steps: int) -> int:
    """Set two exposures in turn, each `steps` times; return the most frames with the old one.

    ValueError if the light doesn't tell.
    """
    before, latency = take_levels(exposures[0])[-1][1], 0
    for step in range(2 * steps):
        levels = take_levels(exposures[(step + 1) % 2])
        latency = max(latency, count_old_frames(before, levels))
        before = levels[-1][1]
    return latency


def count_old_frames(before: float, levels: Sequence[tuple[int, float]]) -> int:
    """Count the frames that still have the old exposure after a change.

    before: light level of pictures with the old exposure. levels: for each picture after
    the change, in order: how many frames came since the change, and its light level.
    ValueError if the pictures don't change clearly, or not in time.
    """
    if len(levels) < 8:
        raise ValueError(f"{len(levels)} pictures are too few")
    after = float(np.median([level for _, level in levels[-len(levels) // 4 :]]))
    step = after - before
    if abs(step) < 0.2 * max(abs(after), abs(before), 1.0):
        raise ValueError(
            f"pictures of {before:.0f} became pictures of {after:.0f}; give two exposures that "
            "differ more, neither of them too dark or clipped"
        )
    # A picture has the new exposure if its level is within a tenth of the step from the last.
    late = [index for index, level in levels if abs(level - after) > 0.1 * abs(step)]
    latency = late[-1] + 1 if late else 0
    if latency > levels[len(levels) // 2][0]:
        raise ValueError("the pictures don't settle; see that the light is steady")
    return latency


@dataclass
class ExposureLatency:
    """Keep how many frames after a change of exposure are still exposed as before.

    told: this number, as an option tells it or a measurement found it. None: MOST_FRAMES are
    discarded until the light of the discarded frames shows when the exposure was obeyed, and from
    then on that many, and `least` at least.
    """

    told: int | None
    least: int
    _exposures: tuple[float, float] | None = None
    _before: tuple[float, float] | None = None
    _last: tuple[float, float] | None = None
    _seen: list[tuple[float, float]] = field(default_factory=list)

    @property
    def frames(self) -> int:
        """Frames to discard after a change of exposure."""
        return MOST_FRAMES if self.told is None else self.told

    def begin(self, old: float, new: float) -> None:
        """Note that the exposure changes, both in seconds."""
        self._before, self._exposures, self._seen = self._last, (old, new), []

    def forget_change(self) -> None:
        """Note that the frames since the last change aren't all there to be counted."""
        self._exposures = None

    def add(self, image: NDArray[np.generic]) -> None:
        """Look at a frame's light; to be called for each frame, in order."""
        if self.told is not None:
            return
        self._last = _light(image)
        if self._exposures is None:
            return
        self._seen.append(self._last)
        if len(self._seen) > MOST_FRAMES:
            found = self._found(*self._exposures)
            self._exposures = None
            self.told = None if found is None else max(found, self.least)

    def _found(self, old: float, new: float) -> int | None:
        """Return the latency that the light of the frames since a change shows, if any."""
        ratio = new / old
        if max(ratio, 1 / ratio) < _LEAST_CHANGE:
            return None
        levels = [level for level, _ in self._seen]
        try:
            return count_old_frames(levels[0], list(enumerate(levels)))
        except ValueError:
            pass
        if self._before is None or np.ptp(levels) > _ALIKE * levels[-1]:
            return None
        # The black level is in the level, and not in the contrast of the picture.
        pairs = zip(self._seen[-1], self._before, strict=True)
        follows = [then > 0 and abs(now / then / ratio - 1) < _ALIKE for now, then in pairs]
        return 0 if any(follows) else None


def light_level(image: NDArray[np.generic]) -> float:
    """Return the mean of the brightest pixels; a small star has them, too."""
    flat: NDArray[Any] = image.reshape(-1)
    part = flat[:: max(1, flat.size // _SAMPLES)]
    count = min(part.size, max(_BRIGHTEST, part.size // 1000))
    return float(np.partition(part, part.size - count)[part.size - count :].mean())


def _light(image: NDArray[np.generic]) -> tuple[float, float]:
    """Return level and contrast (standard deviation) of a picture."""
    flat: NDArray[Any] = image.reshape(-1)
    return light_level(image), float(flat[:: max(1, flat.size // _SAMPLES)].std())
