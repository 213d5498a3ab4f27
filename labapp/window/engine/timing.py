"""Times of a queued run: the time that has passed, and an estimate of the rest."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from labapp.runs.shots import Shot, ShotList
from labapp.window.engine.frame_costs import (
    PREPARING,
    PREPARING_KNOWN,
    FrameCosts,
    frame_kinds,
    setting_of,
)


class RunTiming:
    """Measure the real seconds of one queued run, and estimate those that are left.

    A frame takes its time on the bench's clock, where that is real, and a cost beyond it:
    computing, disks, failures. Costs are those measured in this run, by kind of frame. Kinds that
    are still to come cost what they did in earlier runs, times the ratio of this run's costs to the
    earlier ones.

    shots: the frames to be taken.
    virtual: whether the bench's clock takes no real time.
    costs: those of earlier runs; those of this run are added at its end.
    """

    def __init__(self, shots: Sequence[Shot], *, virtual: bool, costs: FrameCosts) -> None:
        self._rate = 0.0 if virtual else 1.0
        self._costs = costs
        self._began: float | None = None
        self._ended: float | None = None
        self._frame_began: float | None = None
        self._rested, self._rest_began = 0.0, 0.0
        self._measured: dict[str, list[float]] = defaultdict(list)
        self.replan(shots)

    def replan(self, shots: Sequence[Shot]) -> None:
        """Take over the frames of the run, before the first one."""
        self._shots, self._taken = ShotList.of(shots), 0
        self.expected_bench_seconds = self._shots.total_duration
        self._note_kinds()

    def begin(self) -> None:
        self._began = time.monotonic()
        # Runs before it may have taken its settings since it was put in line.
        self._note_kinds()

    def end(self, *, complete: bool = False) -> None:
        """Note the end of the run; a complete one's costs are kept."""
        self._ended = time.monotonic()
        if complete and self._measured:
            self._costs.add({kind: _mean(seen) for kind, seen in self._measured.items()})

    def rest(self) -> None:
        """Note a pause, which must not count as frame time."""
        self._frame_began = None
        if not self._rest_began:
            self._rest_began = time.monotonic()

    def go_on(self) -> None:
        """Note the end of a pause."""
        if self._rest_began:
            self._rested += time.monotonic() - self._rest_began
            self._rest_began = 0.0

    def count_frame(self) -> None:
        """Count the next stored frame."""
        now = time.monotonic()
        shot = self._shots[self._taken]
        kind, lasts = self._names[self._kinds[self._taken]], shot.duration
        if self._taken == 0 and self._began is not None:
            self._note_preparing(now - self._began - self._rested - self._rate * lasts)
        elif self._frame_began is not None:
            self._measured[kind].append(now - self._frame_began - self._rate * lasts)
        self._frame_began = now
        self._costs.known.add(setting_of(shot))
        self._taken += 1

    def _note_preparing(self, seconds: float) -> None:
        """Share what came before the first frame among the settings that were prepared."""
        new, known = self._count("new "), self._count("known ")
        if new:
            seconds -= known * (self._costs.seconds(PREPARING_KNOWN) or 0.0)
            self._measured[PREPARING].append(max(0.0, seconds) / new)
        elif known:
            self._measured[PREPARING_KNOWN].append(max(0.0, seconds) / known)

    def _count(self, kind: str) -> int:
        counted = zip(self._names, self._counts(), strict=True)
        return sum(count for one, count in counted if one.startswith(kind))

    @property
    def elapsed_seconds(self) -> float:
        if self._began is None:
            return 0.0
        return (time.monotonic() if self._ended is None else self._ended) - self._began

    @property
    def whole_seconds(self) -> float | None:
        """Return the real seconds that a waiting run will take; None if unknown."""
        new, preparing = self._count("new "), self._costs.seconds(PREPARING)
        rest = self._rest_of_frames()
        if rest is None or (new and preparing is None):
            return None
        # Settings that were taken in this session are prepared in no time, until it is measured.
        known = self._count("known ") * (self._costs.seconds(PREPARING_KNOWN) or 0.0)
        return new * (preparing or 0.0) + known + rest

    @property
    def seconds_left(self) -> float | None:
        """Return the real seconds that the run still needs; None if unknown."""
        if self._began is None or self._taken == 0:
            whole = self.whole_seconds
            passed = self.elapsed_seconds - self._rested
            rest = self._rest_of_frames()
            return None if whole is None or rest is None else max(rest, whole - passed)
        left = self._rest_of_frames()
        if left is None or self._frame_began is None or self._taken == len(self._kinds):
            return left
        # The frame under way has begun, and is no further than at its end.
        after = self._rest_of_frames(self._taken + 1)
        return max(left - (time.monotonic() - self._frame_began), after or 0.0)

    def _rest_of_frames(self, first: int | None = None) -> float | None:
        """Return the real seconds of the frames from one on; None if one isn't known."""
        first = self._taken if first is None else first
        left = self._rate * float(self._shots.column("duration")[first:].sum())
        for kind, count in zip(self._names, self._counts(first), strict=True):
            cost = self._cost(kind) if count else 0.0
            if cost is None:
                return None
            left += count * max(0.0, cost)
        return left

    def _counts(self, first: int = 0) -> list[int]:
        """Return how many of the frames from one on are of each kind."""
        return np.bincount(self._kinds[first:], minlength=len(self._names)).tolist()

    def _note_kinds(self) -> None:
        kinds = frame_kinds(self._shots, self._costs.known)
        numbers = {kind: number for number, kind in enumerate(dict.fromkeys(kinds))}
        self._names = list(numbers)
        self._kinds = np.array([numbers[kind] for kind in kinds], np.intp)

    def _cost(self, kind: str) -> float | None:
        """Return the seconds that a kind of frame costs in this run; None if unknown."""
        if seen := self._measured.get(kind):
            return _mean(seen)
        usual = self._costs.seconds(kind)
        if usual is not None:
            return usual * self._ratio
        if self._rate or _is_kept(kind):
            return self._cost_of_others()
        return None

    def _cost_of_others(self) -> float | None:
        """Return the mean cost of frames of other kinds, in this run or before it.

        On a virtual bench, a picture that is kept costs the same whatever it shows, and one that
        isn't may take a thousand times as long. On a real bench, kinds differ little.
        """
        seen = [
            one
            for kind, costs in self._measured.items()
            if not kind.startswith(PREPARING) and (self._rate or _is_kept(kind))
            for one in costs
        ]
        if not seen:
            usual = [self._costs.seconds(kind) for kind in self._costs.kinds if _is_kept(kind)]
            seen = [cost for cost in usual if cost is not None]
        if seen:
            return _mean(seen)
        return 0.0 if self._rate else None

    @property
    def _ratio(self) -> float:
        """Return how many times the usual cost frames cost in this run so far."""
        measured = usual = 0.0
        for kind, seen in self._measured.items():
            cost = self._costs.seconds(kind)
            if not kind.startswith(PREPARING) and cost is not None:
                measured += sum(seen)
                usual += cost * len(seen)
        return measured / usual if measured > 0 and usual > 0 else 1.0


def _is_kept(kind: str) -> bool:
    """Return whether a simulated bench has the picture of such frames already."""
    return kind.startswith(("same ", "known "))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)
