"""Compute the signal-to-noise ratio of a pixel that a set of exposures gives when it is merged.

A frame of exposure time t, in a pixel of r electrons per second, tells the rate with a variance of
(r t + f) / t², where f is the variance without light: read noise, quantisation and dark current.
Information, the inverse variance, adds up over frames. Frames of one exposure time share the noise
of their mean dark frame, f over the number of dark frames. A frame that may be clipped isn't
counted (Hasinoff, Durand and Freeman, CVPR 2010, doi 10.1109/CVPR.2010.5540167; here without a
change of gain).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from optics.camera import Sensor

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
