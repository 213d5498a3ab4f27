"""Search for the exposures that reach a signal-to-noise ratio over a range of rates.

Exposures in the order of their times make a chain. The shortest isn't clipped at the brightest
rate. All up to one of them reach the ratio from there down to some rate; the next exposure may be
as long as it stays unclipped at that rate, since it is not needed above. The fewest frames are
those that are each as long as the chain allows: at every rate that is left, a longer exposure tells
more.

The shortest time is another matter. What a frame tells is convex in its exposure time, so that at
the optimum all but few exposures are as long as the chain allows. Either the shortest exposure is
as long as it may be, and later ones are cut; or it is shorter, and the chain ends exactly at the
darkest rate. Both are tried, with several numbers of frames at each time. No bracket is quicker
than its number of frames times the read-out, and one exposure that reaches the ratio at the darkest
rate as if it couldn't clip; where that bound is met, the search ends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

from optics.hdr.exposures import (
    FIRST_MARGIN,
    MARGIN,
    AllowedTimes,
    ExposureLimits,
    ExposureSNR,
    Group,
)

Groups = tuple[Group, ...]
"""Exposure times with their numbers of frames, the shortest first."""

Chain = tuple[tuple[int, ...], Groups, float | None]
"""Numbers of frames at each time, exposures, and the lowest rate that they reach, if any."""

_NO_CHAIN: Chain = ((), (), None)

# Chains of each number of frames, the darkest: more made no bracket quicker by 1 %; chosen
_BEAM = 16
_OF_EACH = 4  # likewise of each number of times, where each takes dark frames of its own
# Frames at each time that share dark frames: finer steps change a few percent; chosen
_REPEATS = (1, 2, 3, 4, 6, 8, 12, 16, 24)
_KEPT = 3  # first exposures that stay as long as may be, at most; chosen likewise
_MORE_FRAMES = 4  # beyond the fewest, with which a shorter time is looked for; chosen likewise
_GOOD_ENOUGH = 1.003  # time over the lower bound at which the search ends; chosen

# Exposures whose information is computed, at most, after which the best bracket so far is taken:
# less than half a second. Only brackets of many frames come here, in which photons make the noise,
# so that all ways to divide the time are nearly alike; chosen
_MOST_TERMS = 120_000


class BracketSearch:
    """Search for exposures that reach a signal-to-noise ratio over a range of rates.

    noise: tells the ratio of exposures. limits: of the camera. low, high: electrons per second.
    snr: a ratio. dark_frames: taken at each exposure time as part of the bracket. taken: exposures
    that are there already, and are merged with those that are searched for.
    """

    def __init__(
        self, noise: ExposureSNR, limits: ExposureLimits, low: float, high: float, snr: float,
        dark_frames: float = 0, taken: Groups = (),
    ) -> None:  # fmt: skip
        self._taken = in_order(taken)
        safe = [noise.brightest(time, FIRST_MARGIN) >= high for time, _ in self._taken]
        self._taken_is_safe = any(safe)
        self._noise, self._limits = noise, limits
        self._low, self._high, self._snr = low, high, snr
        self._darks = dark_frames
        self._allowed = AllowedTimes(limits)
        self._terms = 0
        self._beams: list[list[Chain]] = [[_NO_CHAIN]]

    def duration(self, groups: Groups) -> float:
        """Return the seconds that exposures take, read-out and dark frames included."""
        return sum((n + self._darks) * (t + self._limits.readout) for t, n in groups)

    def fewest_frames(self) -> tuple[Groups, float]:
        """Return the chain of the fewest frames, and the lowest rate that it reaches, electrons/s.

        It is empty where the shortest exposure is clipped at the brightest rate, and doesn't reach
        the darkest one where too many frames would be needed.
        """
        groups: Groups = ()
        reached: float | None = None
        for _ in range(self._limits.most_frames):
            longer = self._extend(groups, reached, 1)
            if longer is None:
                return (), self._high
            groups, reached = longer
            if reached is not None and reached <= self._low:
                break
        return groups, self._high if reached is None else reached

    def shortest_time(self, most_frames: int) -> Groups:
        """Return the quickest bracket of at most some frames.

        `fewest_frames` must reach the darkest rate.
        """
        first, _ = self.fewest_frames()
        best = self._cut(first)
        fewest = sum(count for _, count in first)
        if self._darks:
            for groups in self._repeated_brackets(most_frames):
                best = min(best, groups, key=self._merit)
        self._terms = 0
        for frames in range(fewest, min(most_frames, fewest + _MORE_FRAMES) + 1):
            bound = _GOOD_ENOUGH * self._least_duration(frames)
            for counts in self._chains(frames):
                if self._terms > _MOST_TERMS or self.duration(best) <= bound:
                    return best
                for groups in self._quickest_brackets(counts):
                    best = min(best, groups, key=self._merit)
        return best

    def _repeated_brackets(self, most_frames: int) -> Iterator[Groups]:
        """Yield brackets whose exposures are repeated alike, the last ones more or less often.

        Repeated exposures share their dark frames, so that more frames may take less time.
        """
        found: list[tuple[tuple[float, int], tuple[int, ...]]] = []
        for count, last in itertools.product(_REPEATS, _REPEATS):
            chain = self._repeated_chain(count, last, most_frames)
            if chain:
                counts, groups, _ = chain
                found.append((self._merit(self._cut(groups)), counts))
        for _, counts in sorted(found)[:_OF_EACH]:
            yield from self._quickest_brackets(counts)

    def _repeated_chain(self, count: int, last: int, most_frames: int) -> Chain | None:
        """Return the chain of equal numbers of frames but for the last that ends dark enough."""
        counts, groups, reached = _NO_CHAIN
        while sum(counts) + last <= most_frames:
            end = self._extend(groups, reached, last)
            if end is not None and end[1] is not None and end[1] <= self._low:
                return (*counts, last), *end
            longer = end and self._extend(groups, reached, count)
            if longer is None:
                return None
            counts, (groups, reached) = (*counts, count), longer
        return None

    def _merit(self, groups: Groups) -> tuple[float, int]:
        """Return what to minimise: the time in seconds; where it is the same, the frames."""
        return round(self.duration(groups), 9), sum(count for _, count in groups)

    def _least_duration(self, frames: int) -> float:
        """Return a lower bound of the time that so many frames take, in seconds."""
        readout, longest = self._limits.readout, self._allowed.time(self._allowed.count - 1)
        target = self._snr**2
        single = self._first_true(lambda time: self._square(((time, 1),), self._low) >= target)
        if single is None:
            # Each of several frames tells less in its time than the longest.
            single = longest * target / self._square(((longest, 1),), self._low)
        return frames * readout + single + self._darks * (readout + self._limits.shortest)

    def _square(self, groups: Groups, rate: float) -> float:
        """Return the square of the ratio that unclipped frames reach at a rate."""
        self._terms += len(groups)
        return self._noise.information(groups, rate) * rate**2

    def _extend(
        self, groups: Groups, reached: float | None, count: int
    ) -> tuple[Groups, float | None] | None:
        """Add frames that are as long as may be; return the chain, and the rate that it reaches.

        reached: the lowest rate that it reaches from the brightest one, None if not even that.
        Returns None where no exposure is short enough.
        """
        margin = MARGIN if groups or self._taken_is_safe else FIRST_MARGIN
        time = self.longest_usable(self._high if reached is None else reached, margin)
        if time is None:
            return None
        if groups and groups[-1][0] >= time:
            last, before = groups[-1]
            longer = (*groups[:-1], (last, before + count))
        else:
            longer = (*groups, (time, count))
        return longer, self._reach(longer, reached)

    def _reach(self, groups: Groups, reached: float | None) -> float | None:
        """Return the lowest rate that frames reach which are all usable at the rate `reached`.

        Those that are there already become usable at some rate or other.
        """
        rate = self._high if reached is None else reached
        every = in_order((*groups, *self._taken)) if self._taken else groups
        while True:
            usable = tuple(one for one in every if self._noise.brightest(one[0]) >= rate)
            if self._square(usable, rate) < self._snr**2:
                return reached
            self._terms += 5 * len(usable)
            reached = self._noise.dimmest(usable, self._snr, rate)
            rest = [self._noise.brightest(one[0]) for one in every[len(usable) :]]
            rate = max(rest, default=0.0)
            if reached >= rate or rate <= self._low:
                return reached

    def longest_usable(self, rate: float, margin: float = MARGIN) -> float | None:
        """Return the longest allowed time in seconds that isn't clipped at a rate; None if none."""
        number = self._before_first(lambda time: self._noise.brightest(time, margin) < rate)
        return self._allowed.time(number - 1) if number else None

    def _chains(self, frames: int) -> list[tuple[int, ...]]:
        """Return numbers of frames at each time with which chains reach the darkest rate."""
        while len(self._beams) <= frames and self._terms <= _MOST_TERMS:
            self._beams.append(self._longer_chains())
        last = self._beams[frames] if len(self._beams) > frames else []
        return [
            counts for counts, _, reached in last if reached is not None and reached <= self._low
        ]

    def _longer_chains(self) -> list[Chain]:
        """Return the best chains with one frame more than those so far."""
        found: dict[Groups, Chain] = {}
        for count, beam in enumerate(reversed(self._beams), 1):
            for counts, groups, reached in beam:
                if reached is None or reached > self._low:
                    longer = self._extend(groups, reached, count)
                    if longer is not None:
                        found.setdefault(longer[0], ((*counts, count), *longer))
        order = sorted(found.values(), key=lambda one: one[2] or math.inf)
        if not self._darks:
            return order[:_BEAM]
        by_times: dict[int, list[Chain]] = {}
        for one in order:
            by_times.setdefault(len(one[0]), []).append(one)
        return [one for each in by_times.values() for one in each[:_OF_EACH]]

    def _quickest_brackets(self, counts: tuple[int, ...]) -> Iterator[Groups]:
        """Yield the brackets with so many frames at each time that may be the quickest."""
        longest = self._chain((), counts)
        if longest is None:
            return
        yield self._cut(longest)
        for kept in range(min(len(longest), _KEPT)):
            groups, index = longest, kept
            # Where exposures become alike, they are counted together.
            while index < len(groups) - 1:
                groups = self._shorten_exposure(groups, index)
                index += 1
            yield self._cut(groups)

    def _shorten_exposure(self, groups: Groups, index: int) -> Groups:
        """Shorten an exposure of a chain while that still reaches the darkest rate.

        Those after it are as long as they then may be.
        """
        before, (time, count) = groups[:index], groups[index]
        rest = tuple(count for _, count in groups[index + 1 :])

        def chain(time: float) -> Groups | None:
            return self._chain((*before, (time, count)), rest)

        first = before[-1][0] if before else 0.0
        shortest = self._first_true(
            lambda one: one > first and chain(one) is not None, self._allowed.last_up_to(time) + 1
        )
        return groups if shortest is None else chain(shortest) or groups

    def _chain(self, groups: Groups, counts: tuple[int, ...]) -> Groups | None:
        """Continue a chain with so many frames at each time; None if it ends too bright."""
        reached = self._reach(groups, None) if groups else None
        for count in counts:
            longer = self._extend(groups, reached, count)
            if longer is None:
                return None
            groups, reached = longer
        return groups if reached is not None and reached <= self._low else None

    def _cut(self, groups: Groups) -> Groups:
        """Shorten the exposures, the longest first, while they still suffice."""
        for index in reversed(range(len(groups))):
            time, count = groups[index]
            rest = (*groups[:index], *groups[index + 1 :])

            def enough(time: float, rest: Groups = rest, count: int = count) -> bool:
                return self.suffices(in_order((*rest, (time, count))))

            shorter = self._first_true(enough, self._allowed.last_up_to(time) + 1)
            if shorter is not None:
                groups = (*groups[:index], (shorter, count), *groups[index + 1 :])
        return in_order(groups)

    def suffices(self, groups: Groups) -> bool:
        """Return whether exposures reach the ratio over the whole range.

        The ratio falls with the rate but where an exposure becomes usable, so that the lower end
        and the rates right above those places tell.
        """
        noise, target = self._noise, self._snr**2 * (1 - 1e-9)
        groups = in_order((*groups, *self._taken)) if self._taken else groups
        ends = [noise.brightest(time) for time, _ in groups]
        if not ends or noise.brightest(groups[0][0], FIRST_MARGIN) < self._high:
            return False
        for number, end in enumerate([*ends[1:], 0.0], 1):
            rate = max(end, self._low)
            if rate < self._high or number == len(groups):
                rate = min(rate, self._high)
                if self._square(groups[:number], rate) < target:
                    return False
        return True

    def _first_true(self, test: Callable[[float], bool], count: int | None = None) -> float | None:
        """Return the shortest allowed time that passes a test, as all longer ones do, if any.

        count: of times that are tried, the shortest ones; all by default.
        """
        whole = self._allowed.count if count is None else count
        number = self._before_first(test, whole)
        return self._allowed.time(number) if number < whole else None

    def _before_first(self, test: Callable[[float], bool], count: int | None = None) -> int:
        """Return how many allowed times come before the first that passes a test, by bisection."""
        low, high = -1, self._allowed.count if count is None else count
        while high - low > 1:
            middle = (low + high) // 2
            if test(self._allowed.time(middle)):
                high = middle
            else:
                low = middle
        return high


def in_order(groups: Groups) -> Groups:
    """Sort exposures by time, each time once."""
    counts: dict[float, int] = {}
    for time, count in sorted(groups):
        counts[time] = counts.get(time, 0) + count
    return tuple(counts.items())
