"""Meter a scene: find the range of its pixels' rates, and where they clip, by few frames.

Noise makes the numbers of a frame vary more than the light does, above all in the dark. The
distribution of rates whose noisy numbers are the likeliest is found by expectation-maximisation
(Laird, JASA 73, 805, 1978, doi 10.1080/01621459.1978.10480103): no shape is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from optics.camera import Sensor
from optics.hdr.exposures import AllowedTimes, ExposureLimits, ExposureSNR, from_decibels
from optics.measuring.spots import frame_variance, without_hot_pixels
from optics.sensor.readout import top_pile
from optics.validation import require_unmasked

Array = NDArray[np.float64]

# Share of the range below the largest number that counts as the brightest; chosen
_BRIGHTEST = 0.01
# Brightest light by the shorter exposure over the longer one's: lamps vary less; chosen
_MISSED = 1.02
_SIGMAS = 3.0  # deviations by which light must be missed to be missed; chosen
# Three deviations of that ratio up to which it proves pixels not to be clipped; chosen
_PRECISE = 0.03
_APART = 1.25  # ratio of two exposures from which on they are compared; chosen
# Range of another frame's numbers over this one's that proves this isn't clipped; chosen
_HIGHER = 1.1
_LEAST_ROOM = 8.0  # numbers above the black level that a clip level must lie, at least; chosen


def _untold_clip_level(frames: Mapping[float, Array], sensor: Sensor) -> int | None:
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
        told = _missed_light(frames, time, sensor)
        piled = top == highest and top_pile(frame) is not None
        if piled or any(missed > _MISSED + _SIGMAS * sigma for missed, sigma in told):
            found.append(int(top))
    return min(found, default=None)


def _is_surely_open(frames: Mapping[float, Array], time: float, sensor: Sensor) -> bool:
    """Return whether frames of one scene prove that the one of a time isn't clipped.

    They do if another one has larger numbers, or if a shorter exposure says the same light.
    """
    room = float(frames[time].max()) - sensor.black_level
    highest = max(float(frame.max()) for frame in frames.values()) - sensor.black_level
    if highest > _HIGHER * max(room, 0.0):
        return True
    told = _missed_light(frames, time, sensor)
    return any(missed <= _MISSED and _SIGMAS * sigma < _PRECISE for missed, sigma in told)


def _missed_light(
    frames: Mapping[float, Array], long: float, sensor: Sensor
) -> list[tuple[float, float]]:
    """Return a frame's brightest light by each shorter frame over its own, and its deviation.

    The brightest pixels are chosen by the longer exposure, so that chance makes the ratio too
    small, if anything: where pixels clip, there is no chance in it.
    """
    found = []
    for short in (one for one in frames if one * _APART <= long):
        frame, black = frames[long], sensor.black_level
        brightest = frame >= frame.max() - _BRIGHTEST * (float(frame.max()) - black)
        own = float(frame[brightest].mean()) - black
        before = float(frames[short][brightest].mean()) - black
        electrons = max(before, 0.0) * sensor.gain
        variance = (electrons + sensor.read_noise**2) / sensor.gain**2 + 1 / 12
        deviation = math.sqrt(variance / np.count_nonzero(brightest))
        ratio = long / short / own
        found.append((before * ratio, deviation * ratio))
    return found


_PER_DECADE = 120  # rates for each factor of ten, 2 % from one to the next; chosen
_BIN = 0.5  # standard deviations of noise: width of the bins of numbers; chosen
_DARKEST = 0.3  # deviations of noise without light: rates below tell hardly anything; chosen
_EM_STEPS = 150  # the 1 % quantile is right to 4 % at twice the noise, to 20 % at the noise; chosen


@dataclass(frozen=True, eq=False)
class RateDistribution:
    """Distribution of the rates of a frame's pixels.

    rates: electrons per second, ascending; the first stands for all that the frame can't tell from
    darkness, the last for all that may be clipped. shares: of the pixels.
    """

    rates: Array
    shares: Array

    def quantile(self, share: float) -> float:
        """Return the rate below which a share of the pixels lies, electrons/s."""
        below = np.cumsum(self.shares)
        # Each rate stands for those half a step around it.
        middle = np.sqrt(self.rates[1:] * self.rates[:-1])
        return float(np.exp(np.interp(share, below[:-1], np.log(middle))))

    @property
    def is_clipped(self) -> bool:
        """Whether one pixel or more may be clipped in the frame."""
        return bool(self.shares[-1] > 0)


def rate_distribution(
    numbers: NDArray[np.generic], time: float, sensor: Sensor
) -> RateDistribution:
    """Estimate the distribution of rates from the numbers of a frame's pixels.

    numbers: digital numbers, of any shape.
    time: exposure time, seconds.
    """
    flat, gain = np.asarray(numbers, dtype=np.float64).ravel(), sensor.gain
    light = (flat - sensor.black_level) * gain - sensor.dark_current * time
    clipped = flat >= sensor.full_scale
    floor = ExposureSNR(sensor).floor(time)
    top = (sensor.full_scale - 0.5 - sensor.black_level) * gain
    top = max(top - sensor.dark_current * time, gain)
    # Bins lie between digital numbers.
    bounds = [float(light.min()) - gain / 2]
    while bounds[-1] < top:
        noise = math.sqrt(max(bounds[-1], 0.0) + floor)
        bounds.append(bounds[-1] + gain * max(1, int(_BIN * noise / gain)))
    edges = np.array(bounds)
    counts = np.histogram(light[~clipped], edges)[0].astype(np.float64)
    darkest = min(_DARKEST * math.sqrt(floor), 0.1 * top)
    steps = math.ceil(math.log10(top / darkest) * _PER_DECADE)
    levels = np.geomspace(darkest, top, steps)
    chance = np.diff(ndtr((edges - levels[:, None]) / np.sqrt(levels + floor)[:, None]), axis=1)
    # The shares of rates that make the frame's numbers the likeliest.
    shares = np.zeros(steps)
    if counts.any():
        seen, chance = counts[counts > 0] / counts.sum(), chance[:, counts > 0]
        shares = np.full(steps, 1 / steps)
        for _ in range(_EM_STEPS):
            shares = shares * (chance @ (seen / np.maximum(shares @ chance, 1e-300)))
            shares /= shares.sum()
    # Clipped pixels stand one step above the brightest rate that isn't clipped.
    rates = np.append(levels, top * 10 ** (1 / _PER_DECADE)) / time
    share = float(clipped.mean())
    return RateDistribution(rates, np.append(shares * (1 - share), share))


_DARK_SHARE = 0.01
# Next exposure where pixels clip, where nothing is seen; 12 bits tell a range of 50
_SHORTER, _LONGER = 1 / 32, 8.0
_SEEN_SNR, _TOLD_SNR = 3.0, 0.7  # of a pixel that counts as seen; from which an exposure is derived
_ROUGH_SNR = 8.0  # of the brightest pixels, where the dark end doesn't follow from them
# Of the brightest pixels, if the dark end follows: at least, and at little effort
_BRIGHT_SNR = (20.0, 60.0)
_DARK_SNR = (1.5, 4.0)  # the same of the darkest pixels
_EFFORT = 0.03  # part of the bracket's time that is little
_MOST_FILL = 0.5  # part of the range below clipping that the brightest pixels shall fill
_HOT_SHARE = 1e-3  # of pixels that look hot, beyond which none is left out as such
_PROOF = (0.5, 2.0)  # factors to the exposure that shall prove pixels not to be clipped
# Electrons of the brightest pixels, whose light the shorter one tells to 3 %
_PROOF_LIGHT = 10_000.0
_MOST_FRAMES = 10  # of a metering
_ENOUGH = 0.7  # part of what metering wants with which no other frame is taken
_BEYOND = 1.2  # light of an exposure over what its rate needs, which isn't known well yet


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
        self._frames: dict[float, Array] = {}
        self._seen: dict[float, RateDistribution] = {}
        self._may_have_hot_pixels = True
        self._noise = ExposureSNR(sensor)
        wanted = from_decibels(snr_db)
        self._dark_snr, self._bright_snr = self._affordable_snr(wanted, 1.0, _DARK_SNR), _ROUGH_SNR
        if decades is not None:
            self._bright_snr = self._affordable_snr(wanted, 10**decades, _BRIGHT_SNR)
        self._times: list[float] = []
        self.next_time: float | None = self._nearest(first)

    def add(self, time: float, numbers: NDArray[np.generic]) -> None:
        """Add a metering frame: its exposure in seconds, and digital numbers.

        Raises ValueError if the scene is too bright for the shortest exposure, or if nothing is
        seen in the longest one.
        """
        require_unmasked(numbers)
        self._frames[time] = np.asarray(numbers, dtype=np.float64)
        self._times.append(time)
        self._look_at(time)
        # Where pixels clip if nobody told; if that has changed, all frames look otherwise.
        level = None if self._is_clip_told else _untold_clip_level(self._frames, self._described)
        if level != self._clip_level:
            self._clip_level, self._sensor = level, self._described
            if level is not None:
                self._sensor = replace(self._described, clip_level=level)
            self._noise = ExposureSNR(self._sensor)
            for one in self._frames:
                self._look_at(one)
        wanted = self._time_for_bright() or self._time_for_dark() or self._time_for_proof()
        done = len(self._times) >= _MOST_FRAMES or wanted in self._seen
        self.next_time = None if done else wanted
        if self.next_time is None:
            self._require_seen()

    def _look_at(self, time: float) -> None:
        """Find the distribution of the rates in a frame, hot pixels left out."""
        numbers = self._frames[time]
        if self._may_have_hot_pixels:
            clean = without_hot_pixels(numbers, frame_variance(numbers, self._sensor))
            if (clean != numbers).mean() > max(_HOT_SHARE, 2 * self._sensor.hot):
                self._may_have_hot_pixels = False
                for one in self._frames:
                    self._look_at(one)
                return
            numbers = clean
        self._seen[time] = rate_distribution(numbers, time, self._sensor)

    @property
    def metered_range(self) -> MeteredRange:
        """The range of the scene's rates; complete when `next_time` is None."""
        self._require_seen()
        bright = self._open_times()[-1]
        high, limited = self._brightest(bright), False
        if self._decades is not None:
            low = high / 10**self._decades
        else:
            time = self._time_of_dark()
            darkest = self._noise.dimmest(((time, 1),), 1.0, high)
            told = self._seen[time].quantile(_DARK_SHARE)
            low = min(max(told, darkest), high)
            limited = told < darkest
        unsure = not self._is_open(bright)
        return MeteredRange(low, high, limited, tuple(self._times), self._clip_level, unsure)

    def _open_times(self) -> list[float]:
        """Return the times at which no pixel is clipped, the shortest first."""
        return sorted(time for time, one in self._seen.items() if not one.is_clipped)

    def _time_of_dark(self) -> float:
        """Return the longest time that clips at most half of the pixels."""
        return max(time for time, one in self._seen.items() if one.shares[-1] <= 0.5)

    def _brightest(self, time: float) -> float:
        return self._seen[time].quantile(1 - 0.5 / self._frames[self._times[-1]].size)

    def _require_seen(self) -> None:
        """Raise ValueError unless the frames tell the brightest rate."""
        opened = self._open_times()
        if not opened:
            raise ValueError(
                f"pixels are clipped in the shortest metering frame, of {min(self._seen) * 1e3:g} "
                "ms. Dim the light, or allow shorter exposures"
            )
        time = opened[-1]
        if self._snr(time, self._brightest(time)) < _SEEN_SNR:
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
            return self._nearest(min(clipped) * _SHORTER)
        time = opened[-1]
        high = self._brightest(time)
        fill = high / self._noise.brightest(time)
        enough = self._snr(time, high) >= _ENOUGH * self._bright_snr
        if enough or fill >= _ENOUGH * _MOST_FILL:
            return None
        fullest = time * _MOST_FILL / fill
        longer = self._nearest(min(self._longer(time, high, self._bright_snr), fullest))
        if clipped and longer >= min(clipped):
            longer = self._nearest(math.sqrt(time * min(clipped)))
        return None if longer in self._seen else longer

    def _time_for_dark(self) -> float | None:
        """Return the next time if the dark end of the range isn't known yet."""
        if self._decades is not None:
            return None
        time = self._time_of_dark()
        low = self._seen[time].quantile(_DARK_SHARE)
        if self._noise.snr(((time, 1),), low) >= _ENOUGH * self._dark_snr:
            return None
        return self._nearest(self._longer(time, low, self._dark_snr))

    def _is_open(self, time: float) -> bool:
        """Return whether a frame that doesn't look clipped surely isn't."""
        return self._is_clip_told or _is_surely_open(self._frames, time, self._sensor)

    def _time_for_proof(self) -> float | None:
        """Return a time that proves the brightest pixels not to be clipped, if that takes one.

        A shorter one has their light if it tells that well enough; a longer one has larger numbers.
        """
        opened = self._open_times()
        if not opened or self._is_open(opened[-1]):
            return None
        time = opened[-1]
        shorter, longer = (self._nearest(factor * time) for factor in _PROOF)
        light = self._brightest(time) * shorter
        for one in (shorter, longer) if light > _PROOF_LIGHT else (longer, shorter):
            if one not in self._seen and max(one / time, time / one) > _APART:
                return one
        return None

    def _longer(self, time: float, rate: float, wanted: float) -> float:
        """Return the time at which a rate has a ratio, or a longer one if that isn't told."""
        if self._noise.snr(((time, 1),), rate) < _TOLD_SNR:
            return time * _LONGER
        needed = _light_for(wanted, self._noise.floor(time))
        return time * max(_BEYOND * needed / (rate * time), 1.5)

    def _affordable_snr(self, wanted: float, brighter: float, ends: tuple[float, float]) -> float:
        """Return the ratio for which metering takes a small part of the bracket's time.

        wanted: the bracket's ratio. brighter: the metered pixels' rate over that of the dark end.
        """
        floor = self._noise.floor(0.0)
        light = _EFFORT * _light_for(wanted, floor) * brighter
        return min(max(ends[0], light / math.sqrt(light + floor)), ends[1])

    def _nearest(self, time: float) -> float:
        """Return the longest allowed time up to another, or the shortest of all."""
        return self._allowed.time(max(self._allowed.last_up_to(time), 0))


def _light_for(snr: float, floor: float) -> float:
    """Return the electrons that have a ratio in one frame; floor: variance without light, e²."""
    return (snr**2 + math.sqrt(snr**4 + 4 * snr**2 * floor)) / 2
