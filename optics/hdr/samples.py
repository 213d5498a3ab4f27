"""Hold what the frames of a bracket tell of some of its pixels, for each exposure time.

All is in the unit of the merged rate, so that little is computed in each pass over the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.hdr.bracket import Bracket, Exposure

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Samples:
    """Pixels of an exposure bracket: one entry in each list for each exposure, the shortest first.

    Where the light is at a rate, the mean of an exposure has the variance (rate + floor) / time.

    rates: mean of the frames that aren't clipped, electrons per second. times: total time of these
    frames in seconds; 0 where all are clipped. floors: electrons per second that would make as much
    noise as reading, dark current, quantisation and the dark frames do.
    """

    exposures: list[Exposure]
    rates: list[Array]
    times: list[Array]
    floors: list[Array | np.float32]

    def part(self, where: NDArray[np.intp]) -> Samples:
        """Return some pixels of an exposure bracket, by their indices."""
        rates, times = ([one[where] for one in every] for every in (self.rates, self.times))
        floors = [one[where] if isinstance(one, np.ndarray) else one for one in self.floors]
        return Samples(self.exposures, rates, times, floors)

    def without(self, out: list[Mask]) -> Samples:
        """Return the exposure bracket without exposures that are left out, pixel by pixel."""
        times = [
            np.where(left_out, np.float32(0), one)
            for one, left_out in zip(self.times, out, strict=True)
        ]
        return Samples(self.exposures, self.rates, times, self.floors)

    def clip_rate(self, number: int) -> float:
        """Return the electrons per second from which an exposure of the bracket clips."""
        exposure = self.exposures[number]
        return exposure.clip_level / exposure.time


def join_samples(parts: list[Samples]) -> Samples:
    """Return the pixels of several parts of an exposure bracket as those of one."""

    rates, times, floors = (
        [
            np.concatenate(every) if isinstance(every[0], np.ndarray) else every[0]
            for every in zip(*(getattr(one, name) for one in parts), strict=True)
        ]
        for name in ("rates", "times", "floors")
    )
    return Samples(parts[0].exposures, rates, times, floors)


def read_samples(bracket: Bracket, rows: slice) -> Samples:
    """Return what all pixels in some rows of an exposure bracket tell, as Samples."""
    rates, times, floors = [], [], list[Array | np.float32]()
    for exposure in bracket.exposures:
        time, shared = np.float32(exposure.time), exposure.floor / exposure.darks
        frames = (bracket.electrons(index, rows, exposure.time) for index in exposure.frames)
        rate, clipped = next(frames)
        spent = (~clipped).astype(np.float32)
        spent *= time
        if len(exposure.frames) == 1:
            floor: Array | np.float32 = np.float32((exposure.floor + shared) / exposure.time)
        else:
            count = (~clipped).astype(np.float32)
            rate *= count
            for other, clipped in frames:
                is_open = ~clipped
                rate += other * is_open
                count += is_open
            rate /= np.maximum(count, 1)
            spent = count * time
            # All frames of an exposure share the noise of one mean dark frame.
            floor = (np.float32(exposure.floor) + np.float32(shared) * count) / time
        rates.append(rate)
        times.append(spent)
        floors.append(floor)
    return Samples(bracket.exposures, rates, times, floors)
