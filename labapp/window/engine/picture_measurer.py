"""Measurements in live pictures, on raw pixels, in a thread of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from labapp.window.engine.channel import Channel
from labapp.window.measuring_messages import (
    LineReading,
    MeasurePictures,
    PictureMeasured,
    PixelLine,
    PixelRegion,
    RegionReading,
    StarFound,
    StarReading,
)
from labapp.window.messages import LiveFrame
from optics.camera import Sensor

if TYPE_CHECKING:
    from optics.measuring import Region

_INTERVAL = 0.1
"""Least seconds between measurements. Chosen: a person reads no faster, and live pictures need the
processor."""


class PictureMeasurer:
    """Measure the newest live picture as often as a person can read.

    Any thread may call the methods. Nothing is measured until the window asks for something.
    `complain` is called with an error of the measurements' own.
    """

    def __init__(
        self, channel: Channel, sensor: Sensor, complain: Callable[[Exception], None]
    ) -> None:
        self._channel, self._sensor, self._complain = channel, sensor, complain
        self._condition = threading.Condition()
        self._asked = MeasurePictures(None, None)
        self._finding = False
        self._frame: LiveFrame | None = None
        self._is_new = False
        threading.Thread(target=self._work, name="measuring", daemon=True).start()

    def ask(self, asked: MeasurePictures) -> None:
        """Set what is to be measured; the last picture is measured at once."""
        with self._condition:
            self._asked, self._is_new = asked, self._frame is not None
            self._condition.notify()

    def find_star(self) -> None:
        """Find the star that stands out most in the whole of the last live picture."""
        with self._condition:
            self._finding = True
            self._condition.notify()

    def offer(self, frame: LiveFrame) -> None:
        """Offer a live picture for measurements; only the newest counts."""
        with self._condition:
            self._frame, self._is_new = frame, True
            if self._is_wanted:
                self._condition.notify()

    @property
    def _is_wanted(self) -> bool:
        asked = self._asked.region is not None or self._asked.line is not None
        return self._finding or (self._is_new and asked)

    def _work(self) -> None:
        while not self._channel.closed:
            with self._condition:
                self._condition.wait_for(lambda: self._is_wanted, 1.0)
                asked, frame = self._asked, self._frame
                finding, is_new = self._finding, self._is_new
                self._finding = self._is_new = False
            try:
                if finding:
                    self._channel.send(find_star(frame, self._sensor))
                if is_new and frame is not None and (asked.region or asked.line):
                    self._channel.send(measure_picture(frame, asked, self._sensor))
            except Exception as error:
                # What fails once fails with every picture, which nobody wants to be told each time.
                self._asked = MeasurePictures(None, None)
                self._complain(error)
            time.sleep(_INTERVAL)


def measure_picture(frame: LiveFrame, asked: MeasurePictures, sensor: Sensor) -> PictureMeasured:
    """Measure a live picture in a region and along a line."""
    return PictureMeasured(
        number=frame.number,
        target=frame.target,
        wavelength=frame.wavelength,
        taken_at=time.monotonic(),
        region=None if asked.region is None else _read_region(frame, asked.region, sensor),
        line=None if asked.line is None else _read_line(frame, asked.line),
    )


def find_star(frame: LiveFrame | None, sensor: Sensor) -> StarFound:
    """Find the star that stands out most in a live picture."""
    if frame is None:
        return StarFound(None, "there is no picture yet; start live view with F5")
    import numpy as np

    from optics.measuring.focusing import without_hot
    from optics.measuring.spots import find_spot, frame_variance

    raw = frame.image.astype(np.float64)
    variance = frame_variance(raw, sensor)
    light = without_hot(raw, variance, sensor) - np.median(raw)
    try:
        return StarFound(find_spot(light, variance).place)
    except ValueError as error:
        return StarFound(None, str(error))


def _read_region(frame: LiveFrame, asked: PixelRegion, sensor: Sensor) -> RegionReading | None:
    """Measure a region of a live picture; None if it lies outside."""
    from optics.measuring import Region, focus_score, region_statistics

    try:
        region = Region(*asked).within((frame.image.shape[0], frame.image.shape[1]))
    except ValueError:
        return None
    statistics = region_statistics(frame.image, region, sensor.full_scale)
    focus, no_focus = None, ""
    try:
        focus = focus_score(region.of(frame.image), sensor)
    except ValueError as error:
        no_focus = str(error)
    star, no_star = _read_star(frame, region, sensor)
    return RegionReading(
        region=(region.top, region.left, region.rows, region.columns),
        mean=statistics.mean,
        deviation=statistics.deviation,
        lowest=statistics.lowest,
        highest=statistics.highest,
        saturated=statistics.saturated,
        at_zero=statistics.at_zero,
        focus=focus,
        no_focus=no_focus,
        star=star,
        no_star=no_star,
    )


def _read_star(frame: LiveFrame, region: Region, sensor: Sensor) -> tuple[StarReading | None, str]:
    """Measure the star in a region; or say why there is none."""
    from optics.measuring import star_shape

    try:
        found = star_shape(region.of(frame.image), sensor)
    except ValueError as error:
        return None, str(error)
    star = StarReading(
        y=region.top + found.y,
        x=region.left + found.x,
        fwhm_major=found.fwhm_major,
        fwhm_minor=found.fwhm_minor,
        angle=found.angle,
        peak=found.peak,
        saturated=found.saturated,
    )
    return star, ""


def _read_line(frame: LiveFrame, line: PixelLine) -> LineReading:
    """Measure along a line, whose ends are moved into the picture."""
    from optics.measuring import line_profile

    ends = [
        tuple(min(max(c, 0.0), n - 1.0) for c, n in zip(place, frame.image.shape, strict=True))
        for place in line
    ]
    profile = line_profile(frame.image, (ends[0][0], ends[0][1]), (ends[1][0], ends[1][1]))
    return LineReading(profile.distances, profile.values)
