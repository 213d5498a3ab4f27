"""Meter a scene: find the range of its pixels' rates by few frames, whose exposures are adapted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optics.calibration.spots import frame_variance, without_hot_pixels
from optics.camera import Sensor
from optics.hdr.exposure_limits import AllowedTimes, ExposureLimits
from optics.hdr.exposure_snr import ExposureSNR, from_decibels
from optics.hdr.rate_distribution import RateDistribution, rate_distribution


@dataclass(frozen=True)
class MeteringSettings:
    """Tune the metering of a scene; all values are chosen.

    Attributes
    ----------
    dark_share : float
        Share of the pixels that are darker than the dark end of the range.
    shorter, longer : float
        Factors to the next exposure where pixels are clipped, and where nothing is seen. A frame of
        12 bits tells the brightest light over a range of about 50.
    least_fill : float
        Light of the brightest pixels over the clip level from which on it is known well enough.
    fill : float
        That to which the next exposure is adapted; more would take longer than it tells.
    dark_snr : float
        Signal over noise of the pixels at the dark end from which on it is known well enough.
    dark_effort : float
        The same over the ratio that is wanted of the bracket. Photons' noise makes the time of
        metering its square.
    most_frames : int
        Frames at most.
    """

    dark_share: float = 0.01
    shorter: float = 1 / 32
    longer: float = 32.0
    least_fill: float = 0.08
    fill: float = 0.2
    dark_snr: float = 4.0
    dark_effort: float = 0.15
    most_frames: int = 10


SETTINGS = MeteringSettings()


@dataclass(frozen=True)
class MeteredRange:
    """Range of the rates of a scene's pixels, as metered for an HDR bracket.

    low, high: electrons per second. is_noise_limited: whether the darkest pixels can't be told
    from darkness, so that `low` is where that begins. times: exposures of the metering frames in
    seconds.
    """

    low: float
    high: float
    is_noise_limited: bool
    times: tuple[float, ...]


class Meter:
    """Find the range of a scene's rates by metering frames, one after the other.

    As long as `next_time` is a time, take a frame with this exposure and `add` it; then `found` is
    the range.

    Parameters
    ----------
    sensor : Sensor
        Tells gain, noise, black level and full scale.
    limits : ExposureLimits
        Exposure times that are allowed.
    first : float
        Exposure to begin with, in seconds; the nearer to a good one, the fewer frames.
    snr_db : float
        Ratio that is wanted of the bracket: the metering shall take a small part of its time.
    decades : float, optional
        Depth of the range below the brightest pixels. By default the dark end is that of the scene.

    Raises
    ------
    ValueError
        For a depth that isn't positive.
    """

    def __init__(
        self, sensor: Sensor, limits: ExposureLimits, first: float, snr_db: float,
        decades: float | None = None,
    ) -> None:  # fmt: skip
        if decades is not None and not 0 < decades <= 12:
            raise ValueError(f"decades is {decades:g}; give a depth above 0 and up to 12")
        self._sensor, self._allowed = sensor, AllowedTimes(limits)
        self._decades = decades
        self._dark_snr = min(SETTINGS.dark_snr, SETTINGS.dark_effort * from_decibels(snr_db))
        self._seen: dict[float, RateDistribution] = {}
        self._pixels = 1
        self._noise = ExposureSNR(sensor)
        self._times: list[float] = []
        self.next_time: float | None = self._nearest(first)

    def add(self, time: float, numbers: NDArray[np.generic]) -> None:
        """Add a metering frame of the HDR scene: its exposure in seconds, and digital numbers.

        Raises ValueError if the scene is too bright for the shortest exposure, or if nothing is
        seen in the longest one.
        """
        clean = np.asarray(numbers, dtype=np.float64)
        clean = without_hot_pixels(clean, frame_variance(clean, self._sensor))
        self._pixels = clean.size
        self._seen[time] = rate_distribution(clean, time, self._sensor)
        self._times.append(time)
        wanted = self._time_for_bright() or self._time_for_dark()
        done = len(self._times) >= SETTINGS.most_frames or wanted in self._seen
        self.next_time = None if done else wanted
        if self.next_time is None:
            self._require_seen()

    @property
    def found(self) -> MeteredRange:
        """The range of the HDR scene; complete when `next_time` is None."""
        self._require_seen()
        high = self._brightest(self._open_times()[-1])
        if self._decades is not None:
            return MeteredRange(high / 10**self._decades, high, False, tuple(self._times))
        time = self._time_of_dark()
        darkest = self._noise.dimmest(((time, 1),), 1.0, high)
        low = self._seen[time].quantile(SETTINGS.dark_share)
        return MeteredRange(min(max(low, darkest), high), high, low < darkest, tuple(self._times))

    def _open_times(self) -> list[float]:
        """Return the metering exposures in which no pixel is clipped, the shortest first."""
        return sorted(time for time, one in self._seen.items() if not one.is_clipped)

    def _time_of_dark(self) -> float:
        """Return the longest metering exposure that clips at most half of the pixels."""
        return max(time for time, one in self._seen.items() if one.shares[-1] <= 0.5)

    def _brightest(self, time: float) -> float:
        return self._seen[time].quantile(1 - 0.5 / self._pixels)

    def _require_seen(self) -> None:
        """Raise ValueError unless metering frames tell the brightest rate."""
        opened = self._open_times()
        if not opened:
            raise ValueError(
                f"pixels are clipped in the shortest metering frame, of {min(self._seen) * 1e3:g} "
                "ms. Dim the light, or allow shorter exposures"
            )
        time = opened[-1]
        if self._noise.snr(((time, 1),), self._brightest(time)) < 3:
            raise ValueError(
                f"nothing is seen in the longest metering frame, of {time * 1e3:g} ms. Brighten "
                "the light, or allow longer exposures"
            )

    def _time_for_bright(self) -> float | None:
        """Return the next metering exposure if the brightest rate isn't known yet."""
        opened = self._open_times()
        clipped = [time for time in self._seen if time not in opened]
        if not opened:
            return self._nearest(min(clipped) * SETTINGS.shorter)
        time = opened[-1]
        fill = self._brightest(time) / self._noise.brightest(time)
        if fill >= SETTINGS.least_fill:
            return None
        longer = self._nearest(time * min(SETTINGS.fill / fill, SETTINGS.longer))
        if clipped and longer >= min(clipped):
            longer = self._nearest(math.sqrt(time * min(clipped)))
        return None if longer in self._seen else longer

    def _time_for_dark(self) -> float | None:
        """Return the next metering exposure if the dark end of the range isn't known yet."""
        if self._decades is not None:
            return None
        time = self._time_of_dark()
        low = self._seen[time].quantile(SETTINGS.dark_share)
        if self._noise.snr(((time, 1),), low) >= self._dark_snr:
            return None
        light, floor = low * time, self._noise.floor(time)
        square = self._dark_snr**2
        needed = (square + math.sqrt(square**2 + 4 * square * floor)) / 2
        return self._nearest(time * min(max(1.2 * needed / light, 1.5), SETTINGS.longer))

    def _nearest(self, time: float) -> float:
        """Return the longest allowed metering exposure up to a time, or the shortest of all."""
        return self._allowed.time(max(self._allowed.last_up_to(time), 0))
