"""Meter a scene: find the range of its pixels' rates, and where they clip, by few frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from optics.camera import Sensor
from optics.hdr.exposure_limits import AllowedTimes, ExposureLimits
from optics.hdr.exposure_snr import ExposureSNR, from_decibels
from optics.hdr.rate_distribution import RateDistribution, rate_distribution
from optics.measuring.spots import frame_variance, without_hot_pixels
from optics.sensor.readout import top_pile
from optics.validation import require_unmasked

Array = NDArray[np.float64]

_BRIGHTEST = 0.01
"""Share of the range below the largest number in which pixels count as the brightest. Chosen."""

_MISSED = 1.02
"""Light by the shorter exposure over that of the longer one, of the brightest pixels, from which on
these are clipped. Chosen: lamps vary by less from frame to frame."""

_SIGMAS = 3.0
"""Deviations by which light must be missed to be missed. Chosen."""

_PRECISE = 0.03
"""Three deviations of that ratio up to which it proves that pixels aren't clipped. Chosen."""

_APART = 1.25
"""Ratio of two exposures from which on they are compared. Chosen."""

_HIGHER = 1.1
"""Range of numbers of any frame over that of another one from which on the camera goes on above the
other's, so that this isn't clipped. Chosen."""

_LEAST_ROOM = 8.0
"""Numbers above the black level that a clip level must lie, at least. Chosen."""


def untold_clip_level(frames: Mapping[float, Array], sensor: Sensor) -> int | None:
    """Return the number at which pixels clip below the sensor's full scale; None if none is seen.

    frames: numbers of one scene by exposure time in seconds. Pixels clip where a shorter exposure
    says that they have more light, or where many share the largest number of all frames. If these
    happen to have the same light, a shorter exposure is taken in vain.
    """
    found = []
    highest = max(float(frame.max()) for frame in frames.values())
    for time, frame in frames.items():
        top = float(frame.max())
        if not sensor.black_level + _LEAST_ROOM <= top < sensor.full_scale:
            continue
        shorter = [one for one in frames if one * _APART <= time]
        told = [_missed_light(frames, one, time, sensor) for one in shorter]
        piled = top == highest and top_pile(frame) is not None
        if piled or any(missed > _MISSED + _SIGMAS * sigma for missed, sigma in told):
            found.append(int(top))
    return min(found, default=None)


def is_surely_open(frames: Mapping[float, Array], time: float, sensor: Sensor) -> bool:
    """Return whether frames of one scene prove that one of them isn't clipped.

    They do if another one has larger numbers, or if a shorter exposure says the same light. time:
    that of the frame in question, seconds.
    """
    room = float(frames[time].max()) - sensor.black_level
    highest = max(float(frame.max()) for frame in frames.values()) - sensor.black_level
    if highest > _HIGHER * max(room, 0.0):
        return True
    shorter = [one for one in frames if one * _APART <= time]
    told = (_missed_light(frames, one, time, sensor) for one in shorter)
    return any(missed <= _MISSED and _SIGMAS * sigma < _PRECISE for missed, sigma in told)


def _missed_light(
    frames: Mapping[float, Array], short: float, long: float, sensor: Sensor
) -> tuple[float, float]:
    """Return a frame's brightest light by a shorter frame over its own, and the ratio's deviation.

    The brightest pixels are chosen by the longer exposure, so that chance makes the ratio too
    small, if anything: where pixels clip, there is no chance in it.
    """
    frame, black = frames[long], sensor.black_level
    room = float(frame.max()) - black
    brightest = frame >= frame.max() - _BRIGHTEST * room
    own = float(frame[brightest].mean()) - black
    before = float(frames[short][brightest].mean()) - black
    electrons = max(before, 0.0) * sensor.gain
    variance = (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12
    deviation = math.sqrt(variance / np.count_nonzero(brightest))
    ratio = long / short / own
    return before * ratio, deviation * ratio


@dataclass(frozen=True)
class MeteringSettings:
    """Tune the metering of a scene; all values are chosen.

    dark_share: share of the pixels that are darker than the dark end of the range.
    shorter, longer: factors to the next exposure where pixels are clipped, and where nothing is
        seen. A frame of 12 bits tells the brightest light over a range of about 50.
    seen_snr, told_snr: signal over noise of a pixel from which on it counts as seen, and from which
        on an exposure is derived from it.
    rough_snr: that of the brightest pixels from which on they are known well enough if the dark end
        of the range doesn't follow from them.
    bright_snr, dark_snr: that of the pixels from which the dark end follows, the brightest or the
        darkest, from which on they are known well enough: at least, and where it takes little of
        the bracket's time.
    effort: part of the bracket's time that is little.
    most_fill: part of the range below clipping that the brightest pixels shall fill.
    hot_share: share of pixels that look hot beyond which none is left out as such.
    proof: factors to the exposure that shall prove pixels not to be clipped.
    proof_light: electrons of the brightest pixels from which on the shorter one tells their light
        to 3 %.
    most_frames: frames at most.
    """

    dark_share: float = 0.01
    shorter: float = 1 / 32
    longer: float = 8.0
    seen_snr: float = 3.0
    told_snr: float = 0.7
    rough_snr: float = 8.0
    bright_snr: tuple[float, float] = (20.0, 60.0)
    dark_snr: tuple[float, float] = (1.5, 4.0)
    effort: float = 0.03
    most_fill: float = 0.5
    hot_share: float = 1e-3
    proof: tuple[float, float] = (0.5, 2.0)
    proof_light: float = 10_000.0
    most_frames: int = 10


SETTINGS = MeteringSettings()

_ENOUGH = 0.7
"""Part of what metering wants with which no other frame is taken. Chosen."""

_BEYOND = 1.2
"""Light of a metering exposure over what its rate needs. Chosen: its rate isn't known well yet."""


@dataclass(frozen=True)
class MeteredRange:
    """Range of the rates of a scene's pixels, as metering frames tell it.

    low, high: electrons per second. is_noise_limited: whether the darkest pixels can't be told
    from darkness, so that `low` is where that begins. times: exposures of the metering frames in
    seconds. clip_level: number at which pixels were seen to clip below the sensor's full scale;
    None if they weren't. may_be_clipped: whether nobody told where pixels clip, and no other
    exposure proves that the brightest ones don't.
    """

    low: float
    high: float
    is_noise_limited: bool
    times: tuple[float, ...]
    clip_level: int | None = None
    may_be_clipped: bool = False

    def sensor_as_seen(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the clip level that metering found, if any."""
        return sensor if self.clip_level is None else replace(sensor, clip_level=self.clip_level)


class Meter:
    """Find the range of a scene's rates by metering frames, one after the other.

    As long as `next_time` is a time, take a frame with this exposure and `add` it; then
    `metered_range` is the range.

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
    is_clip_told : bool
        Whether it is known that pixels clip at the sensor's full scale. If it isn't, frames of
        different exposures are compared, and one more is taken where that needs it.

    Raises
    ------
    ValueError
        For a depth that isn't positive.
    """

    def __init__(
        self, sensor: Sensor, limits: ExposureLimits, first: float, snr_db: float,
        decades: float | None = None, is_clip_told: bool = True,
    ) -> None:  # fmt: skip
        if decades is not None and not 0 < decades <= 12:
            raise ValueError(f"decades is {decades:g}; give a depth above 0 and up to 12")
        self._sensor, self._allowed = sensor, AllowedTimes(limits)
        self._described, self._is_clip_told = sensor, is_clip_told
        self._clip_level: int | None = None
        self._decades = decades
        self._frames: dict[float, NDArray[np.float64]] = {}
        self._seen: dict[float, RateDistribution] = {}
        self._may_have_hot_pixels = True
        self._pixels = 1
        self._noise = ExposureSNR(sensor)
        wanted = from_decibels(snr_db)
        self._dark_snr = self._affordable_snr(wanted, 1.0, SETTINGS.dark_snr)
        self._bright_snr = SETTINGS.rough_snr
        if decades is not None:
            self._bright_snr = self._affordable_snr(wanted, 10**decades, SETTINGS.bright_snr)
        self._times: list[float] = []
        self.next_time: float | None = self._nearest(first)

    def add(self, time: float, numbers: NDArray[np.generic]) -> None:
        """Add a metering frame: its exposure in seconds, and digital numbers.

        Raises ValueError if the scene is too bright for the shortest exposure, or if nothing is
        seen in the longest one.
        """
        require_unmasked(numbers)
        self._frames[time] = np.asarray(numbers, dtype=np.float64)
        self._pixels = self._frames[time].size
        self._times.append(time)
        self._look_at(time)
        self._find_clip_level()
        wanted = self._time_for_bright() or self._time_for_dark() or self._time_for_proof()
        done = len(self._times) >= SETTINGS.most_frames or wanted in self._seen
        self.next_time = None if done else wanted
        if self.next_time is None:
            self._require_seen()

    def _look_at(self, time: float) -> None:
        """Find the distribution of the rates in a frame, hot pixels left out."""
        numbers = self._frames[time]
        if self._may_have_hot_pixels:
            clean = without_hot_pixels(numbers, frame_variance(numbers, self._sensor))
            if (clean != numbers).mean() > max(SETTINGS.hot_share, 2 * self._sensor.hot):
                self._may_have_hot_pixels = False
                for one in self._frames:
                    self._look_at(one)
                return
            numbers = clean
        self._seen[time] = rate_distribution(numbers, time, self._sensor)

    def _find_clip_level(self) -> None:
        """Look where pixels clip if nobody told, and at all frames again if that has changed."""
        level = None if self._is_clip_told else untold_clip_level(self._frames, self._described)
        if level == self._clip_level:
            return
        self._clip_level, self._sensor = level, self._described
        if level is not None:
            self._sensor = replace(self._described, clip_level=level)
        self._noise = ExposureSNR(self._sensor)
        for one in self._frames:
            self._look_at(one)

    @property
    def metered_range(self) -> MeteredRange:
        """The range of the scene's rates; complete when `next_time` is None."""
        self._require_seen()
        bright = self._open_times()[-1]
        high, level, unsure = self._brightest(bright), self._clip_level, not self._is_open(bright)
        times = tuple(self._times)
        if self._decades is not None:
            low = high / 10**self._decades
            return MeteredRange(low, high, False, times, level, unsure)
        time = self._time_of_dark()
        darkest = self._noise.dimmest(((time, 1),), 1.0, high)
        low = self._seen[time].quantile(SETTINGS.dark_share)
        low, limited = min(max(low, darkest), high), low < darkest
        return MeteredRange(low, high, limited, times, level, unsure)

    def _open_times(self) -> list[float]:
        """Return the times at which no pixel is clipped, the shortest first."""
        return sorted(time for time, one in self._seen.items() if not one.is_clipped)

    def _time_of_dark(self) -> float:
        """Return the longest time that clips at most half of the pixels."""
        return max(time for time, one in self._seen.items() if one.shares[-1] <= 0.5)

    def _brightest(self, time: float) -> float:
        return self._seen[time].quantile(1 - 0.5 / self._pixels)

    def _require_seen(self) -> None:
        """Raise ValueError unless the frames tell the brightest rate."""
        opened = self._open_times()
        if not opened:
            raise ValueError(
                f"pixels are clipped in the shortest metering frame, of {min(self._seen) * 1e3:g} "
                "ms. Dim the light, or allow shorter exposures"
            )
        time = opened[-1]
        if self._snr(time, self._brightest(time)) < SETTINGS.seen_snr:
            raise ValueError(
                f"nothing is seen in the longest metering frame, of {time * 1e3:g} ms. Brighten "
                "the light, or allow longer exposures"
            )

    def _snr(self, time: float, rate: float) -> float:
        """Return the signal-to-noise ratio of a rate in a frame, also where it nearly clips."""
        return math.sqrt(self._noise.information(((time, 1),), rate)) * rate

    def _time_for_bright(self) -> float | None:
        """Return the next time if the brightest rate isn't known yet."""
        opened = self._open_times()
        clipped = [time for time in self._seen if time not in opened]
        if not opened:
            return self._nearest(min(clipped) * SETTINGS.shorter)
        time = opened[-1]
        high = self._brightest(time)
        fill = high / self._noise.brightest(time)
        enough = self._snr(time, high) >= _ENOUGH * self._bright_snr
        if enough or fill >= _ENOUGH * SETTINGS.most_fill:
            return None
        fullest = time * SETTINGS.most_fill / fill
        longer = self._nearest(min(self._longer(time, high, self._bright_snr), fullest))
        if clipped and longer >= min(clipped):
            longer = self._nearest(math.sqrt(time * min(clipped)))
        return None if longer in self._seen else longer

    def _time_for_dark(self) -> float | None:
        """Return the next time if the dark end of the range isn't known yet."""
        if self._decades is not None:
            return None
        time = self._time_of_dark()
        low = self._seen[time].quantile(SETTINGS.dark_share)
        if self._noise.snr(((time, 1),), low) >= _ENOUGH * self._dark_snr:
            return None
        return self._nearest(self._longer(time, low, self._dark_snr))

    def _is_open(self, time: float) -> bool:
        """Return whether a frame that doesn't look clipped surely isn't."""
        return self._is_clip_told or is_surely_open(self._frames, time, self._sensor)

    def _time_for_proof(self) -> float | None:
        """Return a time that proves the brightest pixels not to be clipped, if that takes one.

        A shorter one has their light if it tells that well enough; a longer one has larger numbers.
        """
        opened = self._open_times()
        if not opened or self._is_open(opened[-1]):
            return None
        time = opened[-1]
        shorter, longer = (self._nearest(factor * time) for factor in SETTINGS.proof)
        light = self._brightest(time) * shorter
        for one in (shorter, longer) if light > SETTINGS.proof_light else (longer, shorter):
            if one not in self._seen and max(one / time, time / one) > 1.25:
                return one
        return None

    def _longer(self, time: float, rate: float, wanted: float) -> float:
        """Return the time at which a rate has a ratio, or a longer one if that isn't told."""
        if self._noise.snr(((time, 1),), rate) < SETTINGS.told_snr:
            return time * SETTINGS.longer
        needed = _light_for(wanted, self._noise.floor(time))
        return time * max(_BEYOND * needed / (rate * time), 1.5)

    def _affordable_snr(self, wanted: float, brighter: float, ends: tuple[float, float]) -> float:
        """Return the ratio for which metering takes a small part of the bracket's time.

        wanted: the bracket's ratio. brighter: the metered pixels' rate over that of the dark end.
        """
        floor = self._noise.floor(0.0)
        light = SETTINGS.effort * _light_for(wanted, floor) * brighter
        return min(max(ends[0], light / math.sqrt(light + floor)), ends[1])

    def _nearest(self, time: float) -> float:
        """Return the longest allowed time up to another, or the shortest of all."""
        return self._allowed.time(max(self._allowed.last_up_to(time), 0))


def _light_for(snr: float, floor: float) -> float:
    """Return the electrons of light that have a ratio in one frame.

    floor: variance without light, electrons².
    """
    return (snr**2 + math.sqrt(snr**4 + 4 * snr**2 * floor)) / 2
