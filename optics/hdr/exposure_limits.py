"""Say which exposure times a camera can take, and what a frame costs besides."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

_WITHIN_PERIOD = 1e-3
"""Share of the shorter period by which a common period may miss a multiple of it. Chosen: light
that flickers fully then errs by less than 1e-3 of one period's light."""

_MOST_PERIODS = 50  # multiples of the longest period that are tried as the common one; chosen


@dataclass(frozen=True)
class ExposureLimits:
    """Limits of a camera's exposure times, and of the number of frames.

    Parameters
    ----------
    shortest, longest : float
        Exposure times in seconds.
    readout : float, default 0
        Seconds that each frame takes besides its exposure.
    step : float, default 1e-6
        Seconds; exposure times are whole multiples.
    period : float, optional
        Seconds; exposures last whole periods, as of a flickering lamp or a phase video, rounded to
        `step`.
    times : tuple of float
        The only allowed exposure times; if it is empty, all that the other numbers allow.
    most_frames : int, default 64
        Frames of a bracket at most.

    Raises
    ------
    ValueError
        For numbers that are negative or not finite, and if no exposure time is left.
    """

    shortest: float
    longest: float
    readout: float = 0.0
    step: float = 1e-6
    period: float | None = None
    times: tuple[float, ...] = ()
    most_frames: int = 64

    def __post_init__(self) -> None:
        if not 0 < self.shortest <= self.longest < math.inf:
            raise ValueError(
                f"exposures are limited to {self.shortest:g} to {self.longest:g} s; both must be "
                "positive, and the shorter comes first"
            )
        if not (0 <= self.readout < math.inf and 0 < self.step < math.inf):
            raise ValueError(
                f"readout is {self.readout:g} s and step {self.step:g} s; give a positive step, "
                "and a read-out time that isn't negative"
            )
        if self.period is not None and not 0 < self.period < math.inf:
            raise ValueError(f"period is {self.period:g} s; it must be positive")
        if self.most_frames < 1:
            raise ValueError(f"most_frames is {self.most_frames}; give one at least")
        if not AllowedTimes(self).count:
            kind = f"whole periods of {self.period:g} s" if self.period else f"{self.times}"
            raise ValueError(
                f"no exposure time from {self.shortest:g} to {self.longest:g} s is among {kind}. "
                "Allow longer or other exposures"
            )


class AllowedTimes:
    """The times that limits allow, the shortest first, by their number from 0."""

    def __init__(self, limits: ExposureLimits) -> None:
        self._step, self._unit = limits.step, limits.period or limits.step
        low, high = limits.shortest * (1 - 1e-9), limits.longest * (1 + 1e-9)
        self._listed = sorted({one for one in limits.times if low <= one <= high})
        self._first = math.ceil(low / self._unit)
        self.count = len(self._listed)
        if not limits.times:
            self.count = max(0, math.floor(high / self._unit) - self._first + 1)

    def time(self, number: int) -> float:
        """Return the time of a number, in seconds."""
        if self._listed:
            return self._listed[number]
        steps = round((self._first + number) * self._unit / self._step)
        # Without rounding, 3 * 1e-6 isn't 3e-6.
        return round(steps * self._step, 12)

    def last_up_to(self, time: float) -> int:
        """Return the number of the longest allowed time up to another; -1 for none."""
        if self._listed:
            return bisect_right(self._listed, time * (1 + 1e-9)) - 1
        number = math.floor(time * (1 + 1e-9) / self._unit) - self._first
        return max(-1, min(number, self.count - 1))


def common_period(periods: Sequence[float]) -> float:
    """Return the shortest time that is whole periods of several, as a lamp's and a video's.

    Parameters
    ----------
    periods : sequence of float
        Seconds, positive, one at least.

    Returns
    -------
    float
        A multiple of the first. It may miss multiples of the others by a thousandth of them.

    Raises
    ------
    ValueError
        If there is none up to fifty times the longest.
    """
    first = periods[0]
    for count in range(1, math.floor(_MOST_PERIODS * max(periods) / first) + 1):
        whole = count * first
        if all(abs(whole / one - round(whole / one)) <= _WITHIN_PERIOD for one in periods):
            return whole
    listed = ", ".join(f"{one * 1e3:g}" for one in periods)
    raise ValueError(f"periods of {listed} ms have no common one. Leave one of them out")
