"""What the panel shows, a pattern or a video, and which part of it an exposure sees."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def picture_name(grey: NDArray[np.uint8]) -> str:
    """Return a pattern's name; the same grey levels have the same name."""
    return hashlib.sha256(grey.tobytes()).hexdigest()


@dataclass(frozen=True)
class PictureShares:
    """Pictures that an exposure sees, by name, with the share of the exposure of each.

    The panel's phase is constant while a picture is shown.
    """

    shares: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Span:
    """A part of a video's frame, and its share of an exposure.

    begin, end: seconds after the beginning of the frame.
    """

    frame: int
    begin: float
    end: float
    share: float


@dataclass(frozen=True)
class FrameSequence:
    """A video's frames by name, in their order, for a liquid crystal that responds slowly.

    spans: the parts of the frames that an exposure sees, in the frames' order.
    """

    names: tuple[str, ...]
    frame_time: float
    spans: tuple[Span, ...]


PanelState = PictureShares | FrameSequence
"""What the panel shows during an exposure, for a crystal that responds at once, or slowly."""


@dataclass(frozen=True, eq=False)
class PanelContent:
    """What the panel shows: a pattern, or a video as names of its frames in their order.

    frame_time: seconds of each frame; infinite for a pattern. pictures: the different frames by
    name.
    """

    names: tuple[str, ...]
    pictures: Mapping[str, NDArray[np.uint8]]
    frame_time: float

    @staticmethod
    def of(video: NDArray[np.uint8], frame_time: float) -> PanelContent:
        """Return the content that is a video, (frames, rows, columns)."""
        # Names are hashes, computed once per video and not once per exposure.
        names = tuple(picture_name(grey) for grey in video)
        pictures: dict[str, NDArray[np.uint8]] = {}
        for name, grey in zip(names, video, strict=True):
            if name not in pictures:
                pictures[name] = grey.copy()
                pictures[name].flags.writeable = False
        return PanelContent(names, pictures, frame_time if len(names) > 1 else math.inf)

    @property
    def first(self) -> NDArray[np.uint8]:
        """Return the first frame's grey levels."""
        return self.pictures[self.names[0]]

    @property
    def is_changing(self) -> bool:
        """Return whether there is more than one picture."""
        return len(self.pictures) > 1

    def covers_whole_periods(self, seconds: float) -> bool:
        """Return whether an exposure sees all frames of the video equally.

        This also holds for an exposure of zero length. An exposure may differ from whole periods of
        the video by 1e-4, because cameras count whole microseconds.
        """
        n = len(self.names)
        periods = seconds / (n * self.frame_time)
        return n == 1 or seconds == 0 or abs(periods - round(periods)) <= 1e-4 * round(periods)

    def picture_shares(self, start: float, seconds: float) -> PictureShares:
        """Return the share of an exposure in which each picture is shown, by name.

        An exposure of zero length has the shares of a whole period.
        """
        n = len(self.names)
        if self.covers_whole_periods(seconds):
            shares: tuple[float, ...] = (1.0,) * n
        else:
            shares = shares_of_time(n, start / self.frame_time, seconds / self.frame_time)
        # Sorted by name, so that the result doesn't depend on the order of the frames.
        mixed = dict.fromkeys(sorted(self.pictures), 0.0)
        for name, share in zip(self.names, shares, strict=True):
            mixed[name] += share
        total = sum(mixed.values())
        return PictureShares(tuple((name, share / total) for name, share in mixed.items()))

    def frame_sequence(self, start: float, seconds: float) -> FrameSequence:
        """Return the video, and the spans of it that an exposure sees, in the video's order."""
        n, frame_time = len(self.names), self.frame_time
        if self.covers_whole_periods(seconds):
            spans = [(k, 0.0, 1.0, 1 / n) for k in range(n)]
        else:
            spans = spans_of_time(n, start / frame_time, seconds / frame_time)
        return FrameSequence(
            self.names,
            frame_time,
            tuple(Span(k, a * frame_time, b * frame_time, share) for k, a, b, share in spans),
        )


def shares_of_time(n: int, start: float, length: float) -> tuple[float, ...]:
    """Return the share of an interval in which each of a video's `n` frames is shown.

    The frames are shown in turn for one unit of time each.
    """

    def shown_until(time: float) -> NDArray[np.float64]:
        """Return how long each frame is shown between 0 and `time`."""
        rounds, rest = divmod(time, n)
        return rounds + np.clip(rest - np.arange(n), 0, 1)

    seen = shown_until(start % n + length) - shown_until(start % n)
    return tuple((seen / seen.sum()).tolist())


def spans_of_time(n: int, start: float, length: float) -> list[tuple[int, float, float, float]]:
    """Return the parts of a video's `n` frames, of one unit of time each, that an interval sees.

    Each is (frame, begin, end, share of the interval), in the frames' order.
    """
    rounds, rest = divmod(length, n)
    seen = {(k, 0.0, 1.0): rounds for k in range(n)} if rounds else {}
    begin = start % n
    for cell in range(int(begin), int(np.ceil(begin + rest))):
        part = (cell % n, max(begin - cell, 0.0), min(begin + rest - cell, 1.0))
        if part[2] > part[1]:
            seen[part] = seen.get(part, 0.0) + part[2] - part[1]
    return [(*part, time / length) for part, time in sorted(seen.items())]
