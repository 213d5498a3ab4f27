"""An eye on a screen that plays a video, and what it says of the player's own account."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.screen import Presentations
from drivers.screen.refreshes import Refresh, RefreshEvents
from drivers.x11 import ScreenReader, XConnection

_PAUSE = 0.5e-3
"""Seconds between looks."""

_EARLY = 0.1
"""Of the time between refreshes: what a server that makes them up may tell too early."""

_LASTING = 9
"""Frames of whose lags the median is taken: such a server may draw one refresh nearer."""


class Look(NamedTuple):
    """before, after: seconds of time.monotonic() between which the screen was read.

    frame: what stood there, as an index into the video; -1 is none of its frames, whole.
    """

    before: float
    after: float
    frame: int


@dataclass(frozen=True)
class Seen:
    """What an eye saw: its looks, and the screen's refreshes as the X server told them."""

    looks: list[Look]
    refreshes: list[Refresh]


def watch(
    display: str,
    region: tuple[int, int, int, int],
    video: NDArray[np.uint8],
    seconds: float,
    meanwhile: Callable[[float], None] = lambda now: None,
) -> Seen:
    """Look at the left column of a screen that plays a video, some ten times a refresh.

    The column tells frames apart, and a frame that is whole from one that isn't. meanwhile:
    called between looks with time.monotonic(). XError as `ScreenReader`.
    """
    x, y, _, height = region
    known = {frame[:, 0].tobytes(): index for index, frame in enumerate(video)}
    looks: list[Look] = []
    refreshes: list[Refresh] = []
    with ScreenReader(display, (x, y, 1, height)) as reader:
        clock = _refreshes_of(display)
        try:
            late = time.monotonic() + seconds
            while (before := time.monotonic()) < late:
                column = reader.grey().tobytes()
                looks.append(Look(before, time.monotonic(), known.get(column, -1)))
                if (told := clock.poll_refresh()) is not None:
                    refreshes.append(told)
                    clock.request_refresh(told.number + 1)
                meanwhile(before)
                time.sleep(_PAUSE)
        finally:
            clock.close()
    return Seen(looks, refreshes)


def _refreshes_of(display: str) -> RefreshEvents:
    with XConnection(display) as x:
        root = x.setup.root
    clock = RefreshEvents(display, root)
    clock.request_refresh(0)
    return clock


@dataclass(frozen=True)
class Verdict:
    """What an eye's looks say of a player's account of the same frames.

    frames: that were judged. unseen: those that came and went between two looks. backwards:
    frames out of order. torn: looks at something that isn't a frame. period: seconds between
    refreshes. missed: refreshes by which the video was seen to fall behind. reported: misses
    that the player counted meanwhile. untrue: frames that weren't on the screen yet when it
    tells that they were.
    """

    frames: int = 0
    unseen: int = 0
    backwards: int = 0
    torn: int = 0
    period: float = 0.0
    missed: int = 0
    reported: int = 0
    untrue: int = 0

    @property
    def unreported(self) -> int:
        return max(0, self.missed - self.reported)

    @property
    def good(self) -> bool:
        """Every frame in order and whole, and no miss that isn't reported."""
        wrong = self.backwards + self.torn + self.unreported + self.untrue
        return not wrong and self.frames > 0


def judge(seen: Seen, told: Presentations, frames: int) -> Verdict:
    """Compare looks with an account whose times are of time.monotonic().

    frames: of the video. The account must be whole: all its times are kept. When a frame was
    drawn is known to a look, and the refresh at which it is told to have come must not be
    before. A refresh that brings no frame puts all later ones back by one, since none is left
    out: so the lag behind a frame a refresh counts the misses, and the account must have as
    many. It is asked for once the last frame looked at is no longer the latest.
    """
    whole = [look for look in seen.looks if look.frame >= 0]
    if len(whole) < 2 or len(seen.refreshes) < 2 or not told.count:
        return Verdict(torn=len(seen.looks) - len(whole))
    period, phase = _grid(seen.refreshes)
    steps = np.diff([look.frame for look in whole]) % frames
    back = steps > frames // 2
    numbers = np.concatenate([[0], np.cumsum(np.where(back, 0, steps))])
    numbers += _first(whole[0], told, frames)
    drawn = _drawn(whole, numbers)
    judged = np.array([number for number in drawn if number < told.count], np.int64)
    if not len(judged):
        return Verdict(torn=len(seen.looks) - len(whole))
    earliest, latest = np.array([drawn[number] for number in judged]).T
    behind = _lasting(np.floor((earliest - phase) / period + _EARLY) - judged)
    began = _lasting(np.floor((latest - phase) / period) - judged)[0]
    first, last = judged[0], judged[-1]
    aside = _behind(told.times[: first + 1], period) + _behind(told.times[last:], period)
    return Verdict(
        frames=len(judged),
        unseen=len(judged) - len(set(judged.tolist()) & set(numbers.tolist())),
        backwards=int(back.sum()),
        torn=len(seen.looks) - len(whole),
        period=period,
        missed=max(0, int(behind[-1] - began)),
        reported=told.missed - aside,
        untrue=int((told.times[judged] < earliest).sum()),
    )


def _grid(refreshes: list[Refresh]) -> tuple[float, float]:
    """Seconds between refreshes, and when number 0 would have been; few may be told late."""
    numbers = np.array([refresh.number for refresh in refreshes])
    times = np.array([refresh.time for refresh in refreshes])
    half = len(numbers) // 2
    apart = numbers[half:] - numbers[: len(numbers) - half]
    period = float(np.median((times[half:] - times[: len(times) - half]) / apart))
    return period, float(np.median(times - numbers * period))


def _first(look: Look, told: Presentations, frames: int) -> int:
    """Which presentation the first look saw: of those of that frame, the nearest in time."""
    candidates = np.arange(look.frame, max(told.count, look.frame + 1), frames)
    times = told.times[np.minimum(candidates, told.count - 1)]
    return int(candidates[np.abs(times - look.after).argmin()])


def _drawn(looks: list[Look], numbers: NDArray[np.int64]) -> dict[int, tuple[float, float]]:
    """By presentation: between which times, of the last look without it and the first with."""
    found = {}
    for before, after, low, high in zip(looks, looks[1:], numbers, numbers[1:], strict=False):
        for number in range(low + 1, high + 1):
            found[number] = before.before, after.after
    return found


def _lasting(lags: NDArray[np.float64]) -> NDArray[np.float64]:
    """Without what is made up for at once: a miss puts back all that comes after it."""
    half = _LASTING // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(lags, half, "edge"), _LASTING)
    return np.asarray(np.median(windows, axis=1))


def _behind(times: NDArray[np.float64], period: float) -> int:
    """Refreshes between the first of these times and the last that brought no frame."""
    return max(0, round((times[-1] - times[0]) / period) - len(times) + 1)
