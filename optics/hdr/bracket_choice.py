"""Choose the exposures that reach a wanted accuracy in the least time, or with the fewest frames.

Ladders of exposures that grow by a ratio are what they are compared with.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optics.camera import Sensor
from optics.hdr.bracket_search import BracketSearch, Groups, in_order
from optics.hdr.exposures import (
    FIRST_MARGIN,
    AllowedTimes,
    ExposureLimits,
    ExposureSNR,
    decibels,
    from_decibels,
)

Least = Literal["time", "frames"]

# Lowest ratio that is offered instead, and halvings, to .01 dB; chosen
_LEAST_DB, _DB_STEPS = -40.0, 14


@dataclass(frozen=True)
class WantedSNR:
    """Signal-to-noise ratio that merged pixels shall have over a range of rates.

    Parameters
    ----------
    snr_db : float
        20 log10 of the rate over its standard deviation.
    low, high : float
        Rates in electrons per second between which it is wanted.
    darks : float, default inf
        Dark frames whose mean is subtracted, for each exposure time; infinite for a level that is
        known without noise.
    counted_darks : float, default 0
        Dark frames at each exposure time whose time counts as the bracket's; a part of them where
        several brackets share them.

    Raises
    ------
    ValueError
        For a ratio that isn't finite, rates that aren't positive or in order, and no dark frames.
    """

    snr_db: float
    low: float
    high: float
    darks: float = math.inf
    counted_darks: float = 0.0

    def __post_init__(self) -> None:
        if not -40 <= self.snr_db <= 120:
            raise ValueError(f"snr_db is {self.snr_db:g}; give a ratio from -40 to 120 dB")
        if not 0 < self.low <= self.high < math.inf:
            raise ValueError(
                f"the range is {self.low:g} to {self.high:g} electrons/s; rates are positive, and "
                "the lower one comes first"
            )
        if not self.darks >= 1:
            raise ValueError(f"darks is {self.darks:g}; give 1 at least, or infinity")
        if not 0 <= self.counted_darks < math.inf:
            raise ValueError(f"counted_darks is {self.counted_darks:g}; it can't be negative")


@dataclass(frozen=True)
class ChosenBracket:
    """Exposures to take, and the signal-to-noise ratio that they reach.

    groups: exposure times in seconds with their numbers of frames, the shortest first. duration:
    seconds with read-out, and with dark frames where they count. noise: tells the ratio. taken:
    exposures that were there already, and are merged with these.
    """

    groups: Groups
    duration: float
    noise: ExposureSNR
    taken: Groups = ()

    @property
    def times(self) -> tuple[float, ...]:
        """Exposure time of each frame in seconds, the shortest first."""
        return tuple(time for time, count in self.groups for _ in range(count))

    @property
    def frames(self) -> int:
        """Number of frames, dark frames aside."""
        return sum(count for _, count in self.groups)

    def snr_db(self, rates: ArrayLike) -> NDArray[np.float64]:
        """Return the signal-to-noise ratio of merged pixels in dB, at rates in electrons/s."""
        flat = np.asarray(rates, dtype=np.float64)
        every = in_order((*self.groups, *self.taken))
        found = [decibels(self.noise.snr(every, float(rate))) for rate in flat.ravel()]
        return np.array(found).reshape(flat.shape)


class UnreachableSNR(ValueError):
    """Raised if nothing within the limits reaches the wanted ratio over the range."""


def choose_bracket(
    sensor: Sensor,
    wanted: WantedSNR,
    limits: ExposureLimits,
    least: Least = "time",
    taken: Groups = (),
) -> ChosenBracket:
    """Choose exposures that reach a signal-to-noise ratio over a range of rates.

    Parameters
    ----------
    sensor : Sensor
        Tells gain, read noise, dark current and full scale.
    wanted : WantedSNR
        Ratio, range and dark frames.
    limits : ExposureLimits
        Exposure times that are allowed, read-out time, and the largest number of frames.
    least : {"time", "frames"}, default "time"
        What to minimise. Of brackets that are alike in it, the other one decides.
    taken : tuple of (seconds, frames)
        Exposures that are there already, as from metering, and are merged with the chosen ones.
        They don't count as frames or time.

    Returns
    -------
    ChosenBracket
        The same exposure time may be there several times. For the fewest frames the number is
        exact, if each has dark frames of its own; the time is within some percent of the least.

    Raises
    ------
    UnreachableSNR
        If it can't be reached; the message says what can be.
    ValueError
        For another `least`.

    References
    ----------
    S. W. Hasinoff, F. Durand and W. T. Freeman, "Noise-optimal capture for high dynamic range
    photography", CVPR 2010, doi 10.1109/CVPR.2010.5540167.
    """
    if least not in ("time", "frames"):
        raise ValueError(f"least is {least!r}; choose time or frames")
    search = _search_for(sensor, wanted, limits, taken)
    noise = ExposureSNR(sensor, wanted.darks)
    if search.suffices(()):
        return ChosenBracket((), 0.0, noise, taken)
    fewest, reached = search.fewest_frames()
    if not fewest or reached > wanted.low * (1 + 1e-9):
        raise UnreachableSNR(_explain(sensor, wanted, limits, reached))
    frames = sum(count for _, count in fewest)
    groups = search.shortest_time(frames if least == "frames" else limits.most_frames)
    return ChosenBracket(groups, search.duration(groups), noise, taken)


def _search_for(
    sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits, taken: Groups = ()
) -> BracketSearch:
    """Set up the search for exposures that reach a wanted ratio within limits."""
    noise, snr = ExposureSNR(sensor, wanted.darks), from_decibels(wanted.snr_db)
    return BracketSearch(noise, limits, wanted.low, wanted.high, snr, wanted.counted_darks, taken)


def _explain(sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits, reached: float) -> str:
    """Say why the wanted ratio isn't reached, and what can be."""
    shortest = AllowedTimes(limits).time(0)
    brightest = ExposureSNR(sensor, wanted.darks).brightest(shortest, FIRST_MARGIN)
    if brightest < wanted.high:
        return (
            f"the brightest pixels, of {wanted.high:.3g} electrons/s, may be clipped in the "
            f"shortest exposure, {shortest * 1e3:g} ms, which takes up to {brightest:.3g} "
            "electrons/s. Dim the light, allow shorter exposures, or end the range there"
        )
    low, high = _LEAST_DB, wanted.snr_db
    for _ in range(_DB_STEPS):
        middle = (low + high) / 2
        _, reached_then = _search_for(
            sensor, replace(wanted, snr_db=middle), limits
        ).fewest_frames()
        suffices = reached_then <= wanted.low * (1 + 1e-9)
        low, high = (middle, high) if suffices else (low, middle)
    frames = "1 frame" if limits.most_frames == 1 else f"{limits.most_frames} frames"
    where = f"from {reached:.3g} electrons/s up" if reached < wanted.high else "at no rate"
    return (
        f"{wanted.snr_db:.4g} dB aren't reached from {wanted.low:.3g} to {wanted.high:.3g} "
        f"electrons/s with {frames} of at most {limits.longest * 1e3:g} ms: {where}; over the "
        f"whole range, {low:.1f} dB. Ask for less, or allow more frames, longer exposures or more "
        "dark frames"
    )


LADDER_RATIOS = (2.0, 4.0, 8.0)
"""Ratios of the ladders that chosen brackets are usually compared with."""

_STARTS = 24  # shortest exposures of a ladder that are tried for each of its steps; chosen


def choose_ladder(
    sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits, ratio: float
) -> ChosenBracket:
    """Find the quickest ladder that reaches a ratio over a range, to compare `choose_bracket` with.

    A ladder has exposures that grow by a ratio, each as often as the others. The arguments are
    those of `choose_bracket`; exposures that aren't allowed become the next shorter ones.

    Raises
    ------
    UnreachableSNR
        If no ladder of this ratio reaches it.
    ValueError
        For a ratio up to 1.
    """
    if not 1 < ratio < math.inf:
        raise ValueError(f"ratio is {ratio:g}; a ladder's exposures grow, by more than 1")
    search = _search_for(sensor, wanted, limits)
    first = search.longest_usable(wanted.high, FIRST_MARGIN)
    last = search.longest_usable(wanted.low)
    ladders: list[list[float]] = []
    if first is not None and last is not None:
        for shift in range(_STARTS):
            ladders += _ladder_times(limits, first * ratio ** (-shift / _STARTS), last, ratio)
    best: Groups | None = None
    for times in ladders:
        # As few frames at each time as suffice, if that's quicker.
        for count in range(1, limits.most_frames // len(times) + 1):
            groups = in_order(tuple((time, count) for time in times))
            if best is not None and search.duration(groups) >= search.duration(best):
                break
            if search.suffices(groups):
                best = groups
                break
    if best is None:
        raise UnreachableSNR(
            f"no ladder of x{ratio:g} with at most {limits.most_frames} frames reaches "
            f"{wanted.snr_db:g} dB from {wanted.low:.3g} to {wanted.high:.3g} electrons/s. Take "
            "another ratio, or more frames"
        )
    return ChosenBracket(best, search.duration(best), ExposureSNR(sensor, wanted.darks))


def _ladder_times(
    limits: ExposureLimits, time: float, last: float, ratio: float
) -> Iterator[list[float]]:
    """Yield the times of ladders from a time on with one step, two steps, and so on to the last."""
    allowed = AllowedTimes(limits)
    times: list[float] = []
    while time <= last * (1 + 1e-9) and len(times) < limits.most_frames:
        number = allowed.last_up_to(time)
        if number >= 0:
            times.append(allowed.time(number))
            yield list(times)
        time *= ratio
