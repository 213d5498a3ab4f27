"""Checks of a camera: its frames, and what their light says of its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Clock, Frame
from drivers.latency import light_level
from labapp.bench.camera_match import require_described_camera
from labapp.bench.selftest.checks import Check, SelfTestFailure, require_refusal, wait_until_ready
from labapp.common.errors import UserError
from optics.camera import Sensor
from optics.measuring.few_exposures import FewExposures, frame_flicker, repeated_linearity

_LONGEST = 1.0
"""Seconds of the longest exposure that is tried. Chosen: a lit bench clips pixels within it."""

_STEP = 4.0
"""Ratio of an exposure to the last, at most. Chosen: pixels that are open in one are clipped in the
next, or far enough from it to tell the linearity."""

_LINEAR = 0.03
"""Deviation of the exponent from 1 up to which a camera counts as linear. Chosen: lamps vary."""

_SIGMAS = 4.0
"""Deviations by which a result must differ from what is described to be a finding. Chosen."""

_BLACK_TOLERANCE = (1.0, 0.05)
"""Deviation of the black level from the described one that is none, in DN and relative. Chosen: it
depends on temperature and exposure."""

_WELL_TOLERANCE = 0.02
"""Share by which full pixels may clip below the described number. Chosen: wells differ so much."""

_NO_LIGHT = (
    "not measured: the picture doesn't change with the exposure. Take the cap off, point the "
    "camera at a steady light, and test it again"
)

_DIM = "not measured: the light is too dim, or too few pixels have it. Brighten it"

_LATENCY_STEP = 0.4
"""Change of the light level from which on two exposures tell the latency, relative. Chosen: twice
what the drivers want."""

_MOST_CLIPPED = 0.05
"""Share of the pixels at the largest number up to which a frame's level is light. Chosen."""

_NO_FRAMES = "not measured: too few frames came"

_FEWEST, _MOST_REPEATS, _REPEAT_SECONDS = 8, 40, 2.0
"""Frames at each exposure that tell flicker from a gamma, at least and at most, and seconds that
the longest of them may take. Chosen: the mean of 40 is sure to 5 % where the light changes by a
third."""

_FLICKER_PERIOD, _GOLDEN = 0.02, (math.sqrt(5) - 1) / 2
"""Seconds over which the repeated frames are spread, two periods of lamps on the mains or more, by
the fractions of the golden ratio: no lamp keeps step with them."""

_SURE = 0.25
"""Four deviations of the exponent up to which it tells a gamma from none. Chosen: a gamma of 1/2.2
lies at 0.45."""

_STEADY = "Light a lamp on direct current, and test it again"

_APART = 1.2
"""Ratio of two exposures from which on both are looked at. Chosen: cameras round them."""


@dataclass(frozen=True)
class DescribedCamera:
    """How a bench file describes its camera.

    sensor: with calibration; None if it isn't described.
    tells_clip_level: whether the file tells where its pixels clip, or a calibration does.
    options: of the driver.
    source: name of the file.
    lines: what the file should say; the checks add to it.
    """

    sensor: Sensor | None = None
    tells_clip_level: bool = True
    options: Mapping[str, Any] = field(default_factory=dict)
    source: str = "the bench file"
    lines: list[str] = field(default_factory=list)


def camera_checks(device: Any, clock: Clock, described: DescribedCamera) -> list[Check]:
    """Return the checks of a camera, on its own and against its description."""
    shortest, longest = device.exposure_range
    test = _CameraTest(device, clock, described)
    most = max(shortest, min(longest, _LONGEST))
    count = max(4, math.ceil(math.log(most / shortest) / math.log(_STEP)) + 1)
    tried = np.geomspace(shortest, most, count)

    def range_() -> str:
        rows, columns = device.shape
        return (
            f"{columns} x {rows} pixels, {shortest * 1e3:g} to {longest * 1e3:g} ms, "
            f"full scale {device.full_scale} DN"
        )

    def beyond() -> str:
        return require_refusal(lambda: device.set_exposure(longest * 10), f"{longest * 10:g} s")

    return [
        ("range", range_),
        *([] if described.sensor is None else [("as described", test.check_description)]),
        *((f"expose {t * 1e3:.3g} ms", partial(test.take, float(t))) for t in tried),
        ("beyond its range", beyond),
        ("black level", test.check_black_level),
        ("clip level", test.check_clip_level),
        ("linearity", test.check_linearity),
        ("latency", test.check_latency),
    ]


@dataclass
class _CameraTest:
    """Takes a camera's frames, and checks what they say of it, on its own or against the file."""

    device: Any
    clock: Clock
    described: DescribedCamera
    _frames: list[Frame] = field(default_factory=list)
    _latency: tuple[tuple[float, float], int | None] | None = None

    def check_description(self) -> str:
        """Check that the file describes a camera of this size and these numbers."""
        assert self.described.sensor is not None
        try:
            require_described_camera(self.device, self.described.sensor, self.described.source)
        except UserError as error:
            raise SelfTestFailure(str(error)) from error
        return "size, bits and colours are those of the bench file"

    def take(self, exposure: float) -> str:
        """Take a frame and keep it; say what is in it. `exposure` is in seconds."""
        device = self.device
        setting = device.set_exposure(exposure)
        wait_until_ready(setting, self.clock)
        frame: Frame = device.capture(lambda: False)
        if not math.isclose(frame.exposure, setting.actual, rel_tol=1e-6):
            raise SelfTestFailure(
                f"exposed {frame.exposure * 1e3:g} ms instead of {setting.actual * 1e3:g} ms"
            )
        if frame.image.shape != device.shape or frame.image.dtype != np.uint16:
            raise SelfTestFailure(
                f"a frame is {frame.image.shape} of {frame.image.dtype}, "
                f"not {device.shape} of uint16"
            )
        if self._frames and frame.number <= self._frames[-1].number:
            raise SelfTestFailure(
                f"frame {frame.number} came after frame {self._frames[-1].number}"
            )
        self._frames.append(frame)
        self._find_latency()
        top = int(frame.image.max())
        mean, spread = float(frame.image.mean()), float(frame.image.std())
        count = int(np.count_nonzero(frame.image == top))
        return (
            f"{frame.exposure * 1e3:g} ms, mean {mean:.1f} DN, deviation {spread:.1f} DN, "
            f"largest number {top}, {count} pixels"
        )

    @cached_property
    def _seen(self) -> FewExposures | None:
        """What the frames say of the camera; None if too few came."""
        rising: list[Frame] = []
        for frame in sorted(self._frames, key=lambda one: one.exposure):
            if not rising or frame.exposure > _APART * rising[-1].exposure:
                rising.append(frame)
        if len(rising) < 2:
            return None
        return FewExposures([one.exposure for one in rising], [one.image for one in rising])

    def check_black_level(self) -> str:
        """Measure the black level, and compare it with the described one."""
        seen, sensor = self._seen, self.described.sensor
        if seen is None:
            return _NO_FRAMES
        if seen.is_cut_at_zero:
            words = (
                f"{seen.share_at_zero:.0%} of the pixels are 0 in the shortest exposure: darkness "
                "is cut off there, and its mean is too high. Raise the camera's black level "
                "(BlackLevel, brightness, offset), or turn its clamp off"
            )
            if sensor is None or sensor.black_level == 0:
                return words
            raise SelfTestFailure(f"{words}. The bench file says {sensor.black_level:g} DN")
        black = seen.black_level
        told = f"{black.value:.4g} DN"
        if sensor is None:
            return told
        least, share = _BLACK_TOLERANCE
        tolerance = max(least, share * sensor.black_level, _SIGMAS * black.sigma)
        if abs(black.value - sensor.black_level) <= tolerance:
            return told
        self.described.lines.append(f"black_level_dn = {black.value:.4g}  # in [sensor]")
        raise SelfTestFailure(f"{told}, and the bench file says {sensor.black_level:g}")

    def check_clip_level(self) -> str:
        """Measure where pixels clip, and compare it with the described level."""
        seen, sensor = self._seen, self.described.sensor
        if seen is None:
            return _NO_FRAMES
        if not seen.sees_light:
            return _NO_LIGHT
        clip = seen.clip
        if clip is None:
            return (
                f"not reached: the largest number is {seen.top:.0f}. Brighten the light until "
                "pixels clip in the longest exposure, and test it again"
            )
        what = {"converter": "the converter ends", "well": "the pixels are full"}[clip.limit]
        told = f"{clip.number} DN, where {what}, by {clip.pixels} pixels"
        other = sensor is not None and (
            (clip.limit == "converter" and clip.number < sensor.full_scale)
            or clip.number < sensor.full_scale * (1 - _WELL_TOLERANCE)
            or clip.number > sensor.top_number
        )
        if other or not self.described.tells_clip_level:
            self.described.lines.append(f"clip_level_dn = {clip.number}  # in [sensor]")
        if sensor is None or not other:
            return told
        raise SelfTestFailure(f"{told}, and by the bench file they clip at {sensor.full_scale}")

    def check_linearity(self) -> str:
        """Check that numbers rise with the exposure as light does."""
        seen = self._seen
        if seen is None:
            return _NO_FRAMES
        if not seen.sees_light:
            return _NO_LIGHT
        found = seen.linearity
        if found is None:
            return _DIM
        power, (first, _, last) = found.exponent, found.exposures
        told = (
            f"light rises with the power {power.value:.3f} ± {power.sigma:.3f} of the exposure, "
            f"{first * 1e3:.3g} to {last * 1e3:.3g} ms, {found.pixels} pixels"
        )
        is_linear = abs(power.value - 1) <= _LINEAR + _SIGMAS * power.sigma
        if is_linear and not self._sees_flicker(first, seen):
            return told
        return self._check_linearity_of_means(told, found.exposures)

    def _sees_flicker(self, exposure: float, seen: FewExposures) -> bool:
        """Return whether a lamp flickers, so that a gamma may be missed."""
        if exposure > _FLICKER_PERIOD:
            return False
        images = self._repeat(exposure, _FEWEST)
        return frame_flicker(images, seen.black_level.value) > _LINEAR

    def _check_linearity_of_means(self, told: str, exposures: tuple[float, float, float]) -> str:
        """Check the linearity by the mean of repeated frames, if a lamp may flicker."""
        count = round(min(max(_FEWEST, _REPEAT_SECONDS / exposures[-1]), _MOST_REPEATS))
        repeats = [self._repeat(exposure, count) for exposure in exposures]
        found = repeated_linearity(exposures, repeats)
        if found is None:
            raise SelfTestFailure(f"{told}, and repeated frames have too little light. {_STEADY}")
        power = found.exponent
        told = (
            f"light rises with the power {power.value:.3f} ± {power.sigma:.3f} of the exposure in "
            f"the mean of {count} frames each"
        )
        if found.flicker:
            told += f", between which the light changes by {found.flicker:.1%}: the lamp flickers"
        if abs(power.value - 1) > _LINEAR + _SIGMAS * power.sigma:
            raise SelfTestFailure(
                f"{told}. A gamma, a table (LUT) or an automatic is on. Turn them off (Gamma 1, "
                "LUTEnable false, GainAuto Off)"
            )
        if _SIGMAS * power.sigma > _SURE:
            raise SelfTestFailure(f"{told} too much to tell the linearity. {_STEADY}")
        return told

    def _repeat(self, exposure: float, count: int) -> list[NDArray[np.uint16]]:
        """Take frames at one exposure in seconds, at uneven times."""
        wait_until_ready(self.device.set_exposure(exposure), self.clock)
        images = []
        for number in range(count):
            pause = _FLICKER_PERIOD * (number * _GOLDEN % 1)
            self.clock.wait_until(self.clock.now() + pause, lambda: False)
            images.append(self.device.capture(lambda: False).image)
        return images

    def check_latency(self) -> str:
        """Tell how many frames late the camera obeys a new exposure."""
        if self._latency is None:
            seen = self._seen
            return _NO_LIGHT if seen is None or not seen.sees_light else _DIM
        exposures, found = self._latency
        if found is None:
            return self._check_frames_obey(exposures)
        option = str(self.device.latency_option)
        if self.described.options.get(option) != found:
            self.described.lines.append(f"{option} = {found}  # in the options of [devices.camera]")
        return f"a new exposure holds after {found} frames, which are discarded from now on"

    def _find_latency(self) -> None:
        """Measure the latency as soon as the last two frames differ enough for it.

        The driver discards so many frames from then on. One that can't measure it must give frames
        of the new exposure, at whose light check_latency() looks.
        """
        if self._latency is not None or len(self._frames) < 2:
            return
        before, last = self._frames[-2:]
        old, new = (light_level(frame.image) for frame in (before, last))
        top = int(last.image.max())
        clipped = np.count_nonzero(last.image == top) > _MOST_CLIPPED * last.image.size
        if new - old < _LATENCY_STEP * new or clipped:
            return
        exposures = before.exposure, last.exposure
        try:
            measure: Callable[[tuple[float, float]], int] = self.device.measure_latency
        except AttributeError:
            self._latency = exposures, None
            return
        self._latency = exposures, measure(exposures)

    def _check_frames_obey(self, exposures: tuple[float, ...]) -> str:
        """Check that the first frame after a change has the new exposure's light."""
        levels = []
        for exposure in (*exposures, *exposures):
            wait_until_ready(self.device.set_exposure(exposure), self.clock)
            pair = [self.device.capture(lambda: False).image for _ in range(2)]
            levels.append([float(image.std()) for image in pair])
        (low, _), (high, _) = levels[:2]
        if any(abs(first - second) > 0.3 * abs(high - low) for first, second in levels):
            raise SelfTestFailure("the first frame after a new exposure has the old one's light")
        return "the first frame after a new exposure has its light"
