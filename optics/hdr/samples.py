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
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Samples:
    """Pixels of an exposure bracket, (exposures, pixels), the shortest exposure first.

    Where the light is at a rate, the mean of an exposure has the variance (rate + floor) / time.

    rates: mean of the frames that aren't clipped, electrons per second. times: total time of these
    frames in seconds; 0 where all are clipped. floors: electrons per second that would make as much
    noise as reading, dark current, quantisation and the dark frames do; (exposures, 1) if each
    exposure has one frame. scratch: two more arrays, to compute in.
    """

    exposures: list[Exposure]
    rates: Array
    times: Array
    floors: Array
    scratch: Array

    @property
    def clip_rate(self) -> np.float32:
        """Electrons per second from which the shortest exposure of the bracket clips."""
        return np.float32(self.exposures[0].clip_level / self.exposures[0].time)

    def part(self, where: Indices) -> Samples:
        """Return some pixels of an exposure bracket, by their indices."""
        rates, times, floors = (
            one.take(where, axis=1) if one.shape[1] == self.rates.shape[1] else one
            for one in (self.rates, self.times, self.floors)
        )
        return Samples(self.exposures, rates, times, floors, _scratch(rates))

    def without(self, out: Mask) -> Samples:
        """Return the exposure bracket without exposures that are left out, pixel by pixel."""
        times = np.where(out, np.float32(0), self.times)
        return Samples(self.exposures, self.rates, times, self.floors, self.scratch)


def _scratch(rates: Array) -> Array:
    """Return two arrays as large as the rates of a bracket, to compute in."""
    return np.empty((2, *rates.shape), dtype=np.float32)


def join_samples(parts: list[Samples]) -> Samples:
    """Return the pixels of several parts of an exposure bracket as those of one."""
    first = parts[0]
    rates, times, floors = (
        np.concatenate([getattr(one, name) for one in parts], axis=1)
        for name in ("rates", "times", "floors")
    )
    floors = first.floors if first.floors.shape[1] == 1 else floors
    return Samples(first.exposures, rates, times, floors, _scratch(rates))


def read_samples(bracket: Bracket, rows: slice, space: Array) -> Samples:
    """Return what all pixels in some rows of an exposure bracket tell, as Samples.

    space: (4, exposures, as many pixels or more), which holds them: memory that is used again stays
    in the processor's cache.
    """
    exposures, pixels = bracket.exposures, len(range(*rows.indices(bracket.shape[0])))
    pixels *= bracket.shape[1]
    rates, times = space[:2, :, :pixels]
    single = all(len(exposure.frames) == 1 for exposure in exposures)
    floors = np.empty((len(exposures), 1 if single else pixels), dtype=np.float32)
    for exposure, rate, time, floor in zip(exposures, rates, times, floors, strict=True):
        _read_exposure(bracket, exposure, rows, rate, time)
        count = 1.0 if single else time.copy()
        time *= np.float32(exposure.time)
        # All frames of an exposure share the noise of one mean dark frame.
        floor[:] = (exposure.floor + exposure.floor / exposure.darks * count) / exposure.time
    return Samples(exposures, rates, times, floors, space[2:, :, :pixels])


def _read_exposure(
    bracket: Bracket, exposure: Exposure, rows: slice, rate: Array, count: Array
) -> None:
    """Read the mean rate of an exposure of the bracket, and the number of its frames, in place.

    Frames that are clipped don't count.
    """
    first, *others = exposure.frames
    np.copyto(count, ~bracket.read_electrons(first, rows, rate, time=exposure.time))
    if others:
        rate *= count
    for index in others:
        light = np.empty_like(rate)
        is_open = ~bracket.read_electrons(index, rows, light, time=exposure.time)
        light *= is_open
        rate += light
        count += is_open
    if others:
        rate /= np.maximum(count, 1)
