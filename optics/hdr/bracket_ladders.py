"""Ladders of exposures that grow by a ratio, with which chosen brackets are compared."""

from __future__ import annotations

import math
from collections.abc import Iterator

from optics.camera import Sensor
from optics.hdr.bracket_choice import ChosenBracket, UnreachableSNR, WantedSNR, search_for
from optics.hdr.bracket_search import BracketSearch, Groups, in_order
from optics.hdr.exposure_limits import AllowedTimes, ExposureLimits
from optics.hdr.exposure_snr import FIRST_MARGIN, ExposureSNR

LADDER_RATIOS = (2.0, 4.0, 8.0)
"""Ratios of the ladders that chosen brackets are usually compared with."""

_STARTS = 24
"""Shortest exposures of a ladder that are tried for each of its steps. Chosen."""


def choose_ladder(
    sensor: Sensor, wanted: WantedSNR, limits: ExposureLimits, ratio: float
) -> ChosenBracket:
    """Return the quickest ladder of exposures that reaches a ratio over a range, for comparison.

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
    search = search_for(sensor, wanted, limits)
    best: Groups | None = None
    for shift in range(_STARTS):
        for times in _ladder_times(search, wanted, limits, ratio, ratio ** (-shift / _STARTS)):
            quickest = math.inf if best is None else search.duration(best)
            found = _fewest_repeats(search, times, limits.most_frames, quickest)
            best = found or best
    if best is None:
        raise UnreachableSNR(
            f"no ladder of x{ratio:g} with at most {limits.most_frames} frames reaches "
            f"{wanted.snr_db:g} dB from {wanted.low:.3g} to {wanted.high:.3g} electrons/s. Take "
            "another ratio, or more frames"
        )
    return ChosenBracket(best, search.duration(best), ExposureSNR(sensor, wanted.darks))


def _ladder_times(
    search: BracketSearch, wanted: WantedSNR, limits: ExposureLimits, ratio: float, shift: float
) -> Iterator[list[float]]:
    """Yield the exposure times of HDR ladders with one step, two steps, and so on.

    shift: the first time over the longest that isn't clipped at the brightest rate.
    """
    allowed = AllowedTimes(limits)
    first = search.longest_usable(wanted.high, FIRST_MARGIN)
    last = search.longest_usable(wanted.low)
    if first is None or last is None:
        return
    times: list[float] = []
    time = first * shift
    while time <= last * (1 + 1e-9) and len(times) < limits.most_frames:
        number = allowed.last_up_to(time)
        if number >= 0:
            times.append(allowed.time(number))
            yield list(times)
        time *= ratio


def _fewest_repeats(
    search: BracketSearch, times: list[float], most_frames: int, quickest: float
) -> Groups | None:
    """Return an HDR ladder with as few frames at each time as suffice, if it is quicker."""
    for count in range(1, most_frames // len(times) + 1):
        groups = in_order(tuple((time, count) for time in times))
        if search.duration(groups) >= quickest:
            return None
        if search.suffices(groups):
            return groups
    return None
