"""What the panel shows, and what an exposure sees of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_EVEN = 1e-4
"""Share of an exposure by which it may miss whole periods of a video and show its frames
evenly: cameras count whole microseconds."""


def picture_name(grey: NDArray[np.uint8]) -> str:
    """Patterns with the same grey levels have the same name."""
    return hashlib.sha256(grey.tobytes()).hexdigest()


@dataclass(frozen=True)
class PictureShares:
    """Pictures by name, and the share of an exposure that each has: they stand while they last."""

    shares: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Span:
    """A part of a frame, from `begin` to `end` seconds after it began, and its share of an
    exposure."""

    frame: int
    begin: float
    end: float
    share: float


@dataclass(frozen=True)
class FrameSequence:
    """A video's frames by name, in their order, for what moves from one to the next.

    spans: what is seen of them, in the frames' order.
    """

    names: tuple[str, ...]
    frame_time: float
    spans: tuple[Span, ...]


@dataclass(frozen=True, eq=False)
class PanelContent:
    """What the panel shows: names of frames in their order, and seconds that each stands.

    pictures: the different frames by name.
    """

    names: tuple[str, ...]
    pictures: Mapping[str, NDArray[np.uint8]]
    frame_time: float

    @staticmethod
    def of(video: NDArray[np.uint8], frame_time: float) -> PanelContent:
        # Named once, when it is shown, and not for every picture that is taken of it.
        names = tuple(picture_name(grey) for grey in video)
        pictures: dict[str, NDArray[np.uint8]] = {}
        for name, grey in zip(names, video, strict=True):
            if name not in pictures:
                pictures[name] = grey.copy()
                pictures[name].flags.writeable = False
        return PanelContent(names, pictures, frame_time)

    @property
    def first(self) -> NDArray[np.uint8]:
        return self.pictures[self.names[0]]

    @property
    def is_changing(self) -> bool:
        """Whether it is more than one picture."""
        return len(self.pictures) > 1

    def _covers_whole_periods(self, seconds: float) -> bool:
        """Whether a time sees all frames alike; no time sees them all."""
        n = len(self.names)
        periods = seconds / (n * self.frame_time)
        return n == 1 or seconds == 0 or abs(periods - round(periods)) <= _EVEN * round(periods)

    def picture_shares(self, start: float, seconds: float) -> PictureShares:
        """The share of a time that each picture has, by name; of no time, that it has of all."""
        n = len(self.names)
        if self._covers_whole_periods(seconds):
            shares: tuple[float, ...] = (1.0,) * n
        else:
            shares = shares_of_time(n, start / self.frame_time, seconds / self.frame_time)
        # In whichever order the pictures come.
        mixed = dict.fromkeys(sorted(self.pictures), 0.0)
        for name, share in zip(self.names, shares, strict=True):
            mixed[name] += share
        total = sum(mixed.values())
        return PictureShares(tuple((name, share / total) for name, share in mixed.items()))

    def frame_sequence(self, start: float, seconds: float) -> FrameSequence:
        """The same with the order of the frames, and with what is seen of each."""
        n, frame_time = len(self.names), self.frame_time
        if self._covers_whole_periods(seconds):
            spans = [(k, 0.0, 1.0, 1 / n) for k in range(n)]
        else:
            spans = spans_of_time(n, start / frame_time, seconds / frame_time)
        return FrameSequence(
            self.names,
            frame_time,
            tuple(Span(k, a * frame_time, b * frame_time, share) for k, a, b, share in spans),
        )


def shares_of_time(n: int, start: float, length: float) -> tuple[float, ...]:
    """What each of `n` frames, shown in turn for a unit of time each, has of an interval."""

    def shown_until(time: float) -> NDArray[np.float64]:
        """Time for which each frame was shown since 0."""
        rounds, rest = divmod(time, n)
        return rounds + np.clip(rest - np.arange(n), 0, 1)

    seen = shown_until(start % n + length) - shown_until(start % n)
    return tuple((seen / seen.sum()).tolist())


def spans_of_time(n: int, start: float, length: float) -> list[tuple[int, float, float, float]]:
    """The parts of `n` frames, shown in turn for a unit of time each, that an interval sees.

    (frame, from, to, share of the interval), in the frames' order; the shares add up to one.
    """
    rounds, rest = divmod(length, n)
    seen = {(k, 0.0, 1.0): rounds for k in range(n)} if rounds else {}
    begin = start % n
    for cell in range(int(begin), int(np.ceil(begin + rest))):
        part = (cell % n, max(begin - cell, 0.0), min(begin + rest - cell, 1.0))
        if part[2] > part[1]:
            seen[part] = seen.get(part, 0.0) + part[2] - part[1]
    return [(*part, time / length) for part, time in sorted(seen.items())]
