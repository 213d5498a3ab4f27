"""Exposures that a camera can take, and the signal-to-noise ratio that they give when merged.

A frame of exposure time t, in a pixel of r electrons per second, tells the rate with a variance of
(r t + f) / t², where f is the variance without light: read noise, quantisation and dark current.
Information, the inverse variance, adds up over frames. Frames of one exposure time share the noise
of their mean dark frame, f over the number of dark frames. A frame that may be clipped isn't
counted (Hasinoff, Durand and Freeman, CVPR 2010, doi 10.1109/CVPR.2010.5540167; here without a
change of gain).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from optics.camera import Sensor

# Share of the shorter period by which a common one may miss its multiple: light that flickers fully
# then errs by less than 1e-3 of one period's light; chosen
_WITHIN_PERIOD = 1e-3

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


Group = tuple[float, int]
"""An exposure time in seconds, and the number of frames that have it."""

MARGIN = 4.0
"""Standard deviations below the clip level from which an exposure counts. Measured: merged there,
it tells 0.8 to 1 of what it would without clipping, the less the less shorter exposures tell."""

FIRST_MARGIN = 8.0
"""The same for the shortest exposure at the brightest rate, where no shorter one tells whether it
is clipped. A pixel is said to be perhaps clipped within five, and its own noise is three more."""

_ROUNDS = 60  # Newton steps at most: beyond the precision of a float


@dataclass(frozen=True)
class ExposureSNR:
    """Signal-to-noise ratios of merged pixels of one sensor.

    sensor: tells gain, read noise, dark current and clip level. darks: number of dark frames whose
    mean is subtracted from each frame; infinite for a level that is known without noise.
    """

    sensor: Sensor
    darks: float = math.inf

    def floor(self, time: float) -> float:
        """Return the variance of a frame without light, in electrons²."""
        sensor = self.sensor
        return sensor.read_noise**2 + sensor.gain**2 / 12 + sensor.dark_current * time

    def brightest(self, time: float, margin: float = MARGIN) -> float:
        """Return the highest rate, in electrons/s, at which a frame surely isn't clipped.

        margin: standard deviations from the clip level. 0 if dark current alone fills the pixel.
        """
        sensor, floor = self.sensor, self.floor(time)
        level = (sensor.full_scale - 0.5 - sensor.black_level) * sensor.gain
        level -= sensor.dark_current * time
        if level + floor <= 0:
            return 0.0
        # light + margin * sqrt(light + floor) = level
        root = (math.sqrt(margin**2 + 4 * (level + floor)) - margin) / 2
        return max(root**2 - floor, 0.0) / time

    def information(self, groups: Iterable[Group], rate: float) -> float:
        """Return the information on a rate from frames that aren't clipped, in s²/electrons²."""
        return self._with_slope(groups, rate)[0] / rate**2

    def snr(self, groups: Iterable[Group], rate: float) -> float:
        """Return the signal-to-noise ratio of a merged pixel, as a ratio.

        rate: electrons per second, positive. The ratio is 0 where all may be clipped.
        """
        usable = [one for one in groups if self.brightest(one[0]) >= rate]
        return math.sqrt(self.information(usable, rate)) * rate

    def dimmest(self, groups: Iterable[Group], snr: float, start: float) -> float:
        """Return the lowest rate at which frames reach a ratio, from a rate where they do.

        All of the exposures count, as if none were clipped.
        """
        groups, rate = tuple(groups), start
        # The ratio's square is convex in the rate, so that Newton's steps come from above.
        for _ in range(_ROUNDS):
            square, slope = self._with_slope(groups, rate)
            step = (square - snr**2) / slope
            rate -= step
            if abs(step) < 1e-9 * rate:
                break
        return rate

    def _with_slope(self, groups: Iterable[Group], rate: float) -> tuple[float, float]:
        """Return the square of the signal-to-noise ratio, and its derivative by rate."""
        square = slope = 0.0
        still, current = self.floor(0), self.sensor.dark_current
        for time, count in groups:
            light = rate * time
            variance = light + (still + current * time) * (1 + count / self.darks)
            part = count * light**2 / variance
            square += part
            slope += part * (2 / rate - time / variance)
        return square, slope


def decibels(snr: float) -> float:
    """Convert a signal-to-noise ratio to dB, 20 log10."""
    return 20 * math.log10(snr) if snr > 0 else -math.inf


def from_decibels(snr_db: float) -> float:
    """Convert dB, 20 log10, to a signal-to-noise ratio."""
    return float(10 ** (snr_db / 20))
