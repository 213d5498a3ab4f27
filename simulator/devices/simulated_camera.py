"""The virtual bench's camera, which renders frames with numbers, times and checksums."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Frame, Region, Setting, Surroundings, checksum
from optics.sensor import sensor_as_read
from optics.validation import require_positive
from simulator.devices.base import SimulatedDevice, require_duration
from simulator.world import countable_exposure


class SimulatedCamera(SimulatedDevice):
    """Simulate a camera; each frame follows from the virtual world's state and a seed.

    The camera computes what its frames share once, as long as nothing changes; each frame has its
    own noise.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock and its virtual world.
    readout_ms : float, default 8.0
        Time in milliseconds from the end of an exposure until the frame is in memory.
    reply_s : float, optional
        Seconds, beyond the exposure, that a step of a picture's computation may take. By default
        15, and 5 more per megapixel.

    Raises
    ------
    ValueError
        If `readout_ms` is negative or not finite, or `reply_s` isn't positive.
    DeviceError
        If the bench has no virtual world.
    """

    model = "simulated camera"
    role = "camera"
    gain_range = (0.0, 24.0)
    """Gain in decibels beyond that of the described sensor, as usual cameras have it."""

    def __init__(
        self, surroundings: Surroundings, readout_ms: float = 8.0, reply_s: float | None = None
    ) -> None:
        super().__init__(surroundings)
        require_duration("readout_ms", readout_ms)
        if reply_s is not None:
            require_positive("reply_s", reply_s, "s")
        self._sensor = self._world.camera.sensor
        self._region: Region | None = None
        self._binning, self._exposure, self._number = 1, 0.01, 0
        self.reply_time = reply_s or 15.0 + 5e-6 * math.prod(self.shape)
        self.alive_at, self.frame_time = 0.0, readout_ms * 1e-3
        self._queue: list[Frame] = []
        self._last: Frame | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Return the rows and columns of the frames."""
        return self._sensor.shape

    @property
    def full_scale(self) -> int:
        """Return the largest digital number of the frames."""
        return self._sensor.full_scale

    @property
    def gain_db(self) -> float:
        """Return the gain in decibels, beyond that of the described sensor."""
        return self._world.gain_db

    @property
    def exposure_range(self) -> tuple[float, float]:
        """Return the shortest and longest exposure time in seconds."""
        return self._world.camera.sensor.exposure_range

    def set_exposure(self, exposure: float) -> Setting[float]:
        """Set the exposure time in seconds.

        Raises DeviceError if the time is out of range.
        """
        low, high = self.exposure_range
        command = f"expose {exposure * 1e3:g} ms"
        self._faults.begin(command, self.reply_time)
        if not low <= exposure <= high:
            reply = f"out of range, {low * 1e3:g} to {high * 1e3:g} ms"
            raise self._refuse(command, reply, "Choose an exposure in the range")
        self._exposure = countable_exposure(exposure)
        return Setting(exposure, self._exposure, self._clock.now())

    def set_gain(self, gain_db: float | None) -> Setting[float]:
        """Set the gain in decibels; 0 if None.

        Raises DeviceError if it is out of range.
        """
        asked = 0.0 if gain_db is None else gain_db
        low, high = self.gain_range
        command = f"gain {asked:g} dB"
        self._faults.begin(command, self.reply_time)
        if not low <= asked <= high:
            reply = f"out of range, {low:g} to {high:g} dB"
            raise self._refuse(command, reply, "Choose a gain in the range")
        self._read(asked, self._region, self._binning)
        return Setting(asked, asked, self._clock.now())

    def set_region(self, region: Region | None, binning: int | None) -> Setting[Region]:
        """Set the region, x, y, width, height, and the pixels that are averaged.

        Raises DeviceError if it doesn't have these pixels.
        """
        rows, columns = self._world.camera.sensor.shape
        asked = region or (0, 0, columns, rows)
        command = f"region {list(asked)}, binning {binning or 1}"
        self._faults.begin(command, self.reply_time)
        try:
            self._read(self.gain_db, region, binning or 1)
        except ValueError as error:
            raise self._refuse(command, str(error), "Choose another region") from error
        return Setting(asked, asked, self._clock.now())

    def make_safe(self) -> None:
        """Give the gain, region and binning back that the camera was opened with."""
        self._read(0.0, None, 1)

    def _read(self, gain_db: float, region: Region | None, binning: int) -> None:
        """Read the sensor in another way from now on; ValueError if it can't be."""
        self._sensor = sensor_as_read(
            self._world.camera.sensor, amplification_db=gain_db, region=region, binning=binning
        )
        self._world.gain_db, self._region, self._binning = gain_db, region, binning

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """Expose, and return the next frame in the host's queue.

        The next frame is the one of this exposure, unless an earlier frame was late.
        """
        fault = self._faults.begin("capture", self.reply_time, frame=True)
        kind = fault.kind if fault else ""
        if fault and kind == "stale frame":
            if self._last is not None:
                return self._last
            # There is no earlier frame yet: the fault occurs at the next frame instead.
            self._world.faults.put_off(fault)
        seconds = self._exposure
        if kind == "wrong exposure":
            low, high = self.exposure_range
            seconds = seconds * 2 if seconds * 2 <= high else max(low, seconds / 2)
        frame = self._expose(cancelled, seconds)
        if kind == "dropped frame":
            raise self._refuse("capture", f"frame {frame.number} was lost", "Check the network")
        if kind == "corrupt frame":
            # The lower half is invalid, as after a lost packet.
            image = frame.image.copy()
            lower = image[len(image) // 2 :]
            lower[:] = 0 if lower.any() else 1
            frame = replace(frame, image=image)
        self._queue.append(frame)
        if kind == "late frame":
            raise self._refuse("capture", f"frame {frame.number} is late", "Check the network")
        self._last = self._queue.pop(0)
        return self._last

    def _expose(self, cancelled: Callable[[], bool], seconds: float) -> Frame:
        began = self._clock.now()

        def check() -> None:
            self.alive_at = time.monotonic()
            if cancelled() or self._world.is_picture_unwanted():
                raise self._refuse("capture", "it was cancelled", "Take it again")
            self._faults.require_alive("capture")

        try:
            stream, _ = self._world.stream(seconds, check)
        except ValueError as error:
            raise self._refuse("capture", str(error), "Change the scene or the bench") from error
        # A killed camera must not advance the world's random numbers.
        self._faults.require_alive("capture")
        image = self._read_pixels(stream.frame(self._world.random_generator()))
        self._clock.wait_until(
            began + seconds + self.frame_time, lambda: cancelled() or self._faults.is_killed
        )
        self._faults.require_alive("capture")
        self._number += 1
        gain = self._sensor.gain
        return Frame(image, seconds, gain, began, self._number, checksum(image))

    def _read_pixels(self, image: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return the region of a whole frame, with its pixels averaged."""
        if self._region is not None:
            x, y, width, height = self._region
            image = image[y : y + height, x : x + width]
        if (n := self._binning) > 1:
            rows, columns = self.shape
            blocks = image[: rows * n, : columns * n].reshape(rows, n, columns, n)
            image = np.rint(blocks.mean(axis=(1, 3))).astype(np.uint16)
        return np.ascontiguousarray(image)
