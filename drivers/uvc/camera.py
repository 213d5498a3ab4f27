"""Take frames, and return only those that have the exposure that was set.

Sources: the USB Video Class 1.5; the kernel's documentation of V4L2's camera controls (absolute
exposure in units of 100 us, exposure_auto 1 for manual); OpenCV's documentation of VideoCapture.
A UVC camera runs freely and doesn't report the exposure of a frame. Frames are therefore
discarded until one must have begun with the exposure that was set.

Calls to the camera may hang in the operating system. They are made in a thread, which is
abandoned if that happens. With own_process = true in the bench file, the whole driver runs in a
child process, which can be killed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

from drivers.interfaces import Frame, Identity, Setting, Surroundings
from drivers.latency import light_level, measure_old_frames
from drivers.uvc.camera_connection import CALL_TIMEOUT, CameraConnection
from drivers.uvc.capture import (
    CaptureFactory,
    CaptureMode,
    read_exposure_units,
    read_settings,
    resolve_source,
    set_exposure_units,
)
from drivers.uvc.frame_selection import ExposureInForce
from drivers.uvc.pixel_decoding import FULL_SCALES, decode_pixels
from drivers.uvc.stream import QUEUE_LENGTH, Stream, StreamFrame, StreamStopped


@dataclass(frozen=True)
class UVCTiming:
    """Times that a camera may take beyond a frame, in seconds.

    stall_margin: after a frame should have come, from which the stream counts as stopped. Chosen.
    set_margin: for setting an exposure. Chosen.
    """

    stall_margin: float = 0.8
    set_margin: float = 1.5


_TIMING = UVCTiming()


class UVCCamera:
    """Take single frames with a UVC camera, which runs freely.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    device : str or int
        "/dev/video0", a permanent name such as "/dev/v4l/by-id/...", or a number.
    width, height : int
        Size of the picture in pixels, 1 to 16384.
    pixel_format : str
        V4L2's four letters of the format, one of `drivers.uvc.pixel_decoding.FULL_SCALES`.
    frame_rate : float
        Frames per second, up to 1000; 0 leaves the camera's own.
    exposure_range_ms : sequence of float
        Shortest and longest exposure in milliseconds.
    exposure_unit_us : float
        The camera's unit of exposure in microseconds.
    discard_frames : int
        Number of frames after a new exposure was set that may still have the old one, 0 to 100;
        measure_latency() finds it.
    gain : float, optional
        Amplification in the camera's units; left as it is by default.
    electrons_per_number : float
        Conversion gain in electrons per digital number, for Frame.gain.
    source : callable, optional
        Function that opens a device and returns an object like cv2.VideoCapture; OpenCV's by
        default. It is for scripts: a bench file can't name one.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    model = "UVC camera"
    latency_option = "discard_frames"
    # The system stops the stream when the process ends.
    is_left_safe_when_killed = True
    settling = 0.0
    reply_time = 2 * CALL_TIMEOUT

    def __init__(
        self,
        surroundings: Surroundings,
        device: str | int = "/dev/video0",
        width: int = 640,
        height: int = 480,
        pixel_format: str = "YUYV",
        frame_rate: float = 0.0,
        exposure_range_ms: Sequence[float] = (0.1, 500.0),
        exposure_unit_us: float = 100.0,
        discard_frames: int = 3,
        gain: float | None = None,
        electrons_per_number: float = 1.0,
        source: CaptureFactory | None = None,
    ) -> None:
        self._mode = CaptureMode(
            device, width, height, pixel_format, frame_rate, exposure_unit_us / 1e6, gain
        )
        self._range = _range(exposure_range_ms)
        if type(discard_frames) is not int or not 0 <= discard_frames <= 100:
            raise ValueError(f"discard_frames is {discard_frames!r}; it must be from 0 to 100")
        if not 0 < electrons_per_number < math.inf:
            raise ValueError(
                f"electrons_per_number is {electrons_per_number}; it must be greater than 0"
            )
        self._clock = surroundings.clock
        self._gain = electrons_per_number
        self.discard_frames = discard_frames
        self.alive_at = 0.0
        """When measure_latency() last made progress; see Device."""
        self._in_force = ExposureInForce()
        self._first_settings: dict[str, float] = {}
        self._connection = CameraConnection(
            self.model, self._mode, resolve_source(source), self._restore_exposure
        )

    @property
    def identity(self) -> Identity:
        told = self._connection.description
        return Identity(self._connection.model, told.get("serial number", ""), simulated=False)

    @property
    def shape(self) -> tuple[int, int]:
        return self._mode.shape

    @property
    def full_scale(self) -> int:
        return FULL_SCALES[self._mode.pixel_format]

    @property
    def exposure_range(self) -> tuple[float, float]:
        return self._range

    @property
    def frame_time(self) -> float:
        """Seconds for the frames that are discarded and the one that is kept."""
        return (self.discard_frames + QUEUE_LENGTH + 4) * self._period

    @property
    def _period(self) -> float:
        stream = self._connection.stream
        given = stream.period if stream else 0.0
        return max(given, self._in_force.exposure)

    def health(self) -> dict[str, str]:
        """Return the camera's description, and the frame time and counts of its stream."""
        stream = self._connection.ensure_stream("read its state")
        return {
            **self._connection.description,
            "seconds a frame": f"{self._period:.4f}",
            "frames taken": str(stream.frame_count),
            "frames missed": str(stream.missing_count),
            "frames discarded after a new exposure": str(self.discard_frames),
        }

    def set_exposure(self, exposure: float) -> Setting[float]:
        """Set the exposure in seconds, and read back the value that is in force."""
        command = f"set the exposure to {exposure * 1e3:g} ms"
        low, high = self._range
        if not low <= exposure <= high:
            raise self._connection.refuse(
                command,
                f"out of range, {low * 1e3:g} to {high * 1e3:g} ms",
                "Choose an exposure in the range",
            )
        stream = self._connection.ensure_stream(command)
        self._set(command, stream, max(round(exposure / self._mode.unit), 1))
        return Setting(exposure, self._in_force.exposure, self._clock.now())

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """Return the first frame with the current exposure that began after this call.

        DeviceError if the stream stops for a second, or if the call is cancelled.
        """
        stream = self._connection.ensure_stream("capture")
        shot = self._next_valid_frame(stream, cancelled)
        self._require_settings("capture", stream)
        try:
            image = decode_pixels(shot.image, self._mode.pixel_format, self._mode.shape)
        except (ValueError, TypeError) as error:
            raise self._connection.refuse("capture", str(error), "Ask for it again") from error
        begun = self._clock.now() - (time.monotonic() - shot.time) - self._in_force.exposure
        return Frame(image, self._in_force.exposure, self._gain, begun, shot.number)

    def measure_latency(self, exposures: Sequence[float], steps: int = 3, frames: int = 16) -> int:
        """Measure `discard_frames` by alternating between two exposures.

        The light must be steady. The result is used from now on.

        exposures: two, in seconds, of which neither gives dark or clipped frames. steps: how often
        each is set. frames: number of frames that are evaluated after each change.
        """
        command = "measure the latency"

        def take_levels(exposure: float) -> list[tuple[int, float]]:
            self.set_exposure(exposure)
            return self._light_levels(command, 2 * frames)

        try:
            latency = measure_old_frames(take_levels, exposures, steps)
        except ValueError as error:
            raise self._connection.refuse(
                command, str(error), "Point it at a steady light"
            ) from error
        self.discard_frames = latency
        return latency

    def make_safe(self) -> None:
        """Stop the stream; the next command starts it again."""
        self._connection.stop()

    def unplugged_reason(self) -> str | None:
        """Return why the camera counts as unplugged, empty while it is connected."""
        return self._connection.unplugged_reason()

    def __enter__(self) -> Self:
        self._connection.ensure_stream("open")
        return self

    def __exit__(self, *error: object) -> None:
        self._connection.stop()

    def _light_levels(self, command: str, count: int) -> list[tuple[int, float]]:
        """Return the light levels of the next frames, to measure the latency.

        Each comes with the number of frames since the exposure was set.
        """
        stream, number = self._connection.ensure_stream(command), 0
        levels: list[tuple[int, float]] = []
        while len(levels) < count:
            shot = self._next_shot(stream, number, _never)
            number, self.alive_at = shot.number, time.monotonic()
            between = stream.count_frames_since(self._in_force.set_at, number) - 1
            if between >= 0:
                image = decode_pixels(shot.image, self._mode.pixel_format, self._mode.shape)
                levels.append((between, light_level(image)))
        return levels

    def _next_valid_frame(self, stream: Stream, cancelled: Callable[[], bool]) -> StreamFrame:
        """Return the first frame with the exposure in force that began after the call."""
        called, number, now = time.monotonic(), stream.frame_count, self._in_force
        late = called + now.exposure + self.frame_time + CALL_TIMEOUT
        while time.monotonic() < late:
            shot = self._next_shot(stream, number, cancelled)
            number = shot.number
            shows = now.is_in_frame(stream, shot, self.discard_frames)
            if shows and now.is_begun_after(called, stream, shot):
                self._require_frame_interval(stream, shot)
                return shot
        raise self._connection.end_with_error("capture", "no frame of the new exposure came")

    def _require_frame_interval(self, stream: Stream, shot: StreamFrame) -> None:
        """Raise DeviceError if frames come faster than the exposure allows."""
        gap = self._in_force.too_short_interval(stream, shot)
        if gap:
            raise self._connection.refuse(
                "capture",
                f"frames come every {gap * 1e3:.0f} ms, so that none is exposed for "
                f"{self._in_force.exposure * 1e3:.0f} ms, whatever the camera says",
                "Choose a lower frame_rate, or let it slow down: v4l2-ctl -c "
                "exposure_dynamic_framerate=1",
            )

    def _next_shot(self, stream: Stream, after: int, cancelled: Callable[[], bool]) -> StreamFrame:
        """Return the next frame; on cancel, or if none comes in time, DeviceError."""
        began = time.monotonic()
        while True:
            if cancelled():
                raise self._connection.refuse("capture", "it was cancelled", "Take it again")
            try:
                shot = stream.next_shot(after, 0.02)
            except StreamStopped as stopped:
                raise self._connection.end_with_error("capture", str(stopped)) from None
            if shot is not None:
                return shot
            waited = time.monotonic() - max(began, stream.last_frame_at)
            if waited > self._period + _TIMING.stall_margin:
                raise self._connection.end_with_error("capture", "the stream has stopped")

    def _set(self, command: str, stream: Stream, units: int) -> None:
        seconds = self._period + _TIMING.set_margin
        actual = self._connection.ask(
            command, stream, lambda capture: set_exposure_units(capture, units), seconds
        )
        self._in_force = self._in_force.with_exposure(units, actual * self._mode.unit)

    def _require_settings(self, command: str, stream: Stream) -> None:
        """Raise DeviceError if the camera has changed what it does to its pictures."""
        seconds = self._period + _TIMING.set_margin
        now = self._connection.ask(command, stream, read_settings, seconds)
        then = self._first_settings = self._first_settings or now
        changed = [
            f"{name} from {then[name]:g} to {value:g}"
            for name, value in now.items()
            if value != then[name]
        ]
        if changed:
            reply = f"the camera has changed by itself: {', '.join(changed)}"
            error = self._connection.refuse(command, reply, "Set it back: v4l2-ctl -l lists all")
            error.lasting = True
            raise error

    def _restore_exposure(self, command: str, stream: Stream) -> None:
        """Set the last exposure again on a new stream.

        On the first stream, the camera's own exposure is set, moved into the range.
        """
        low, high = (round(limit / self._mode.unit) for limit in self._range)
        units = self._in_force.units or round(
            self._connection.ask(command, stream, read_exposure_units)
        )
        self._set(command, stream, min(max(units, low, 1), high))
        self._require_settings(command, stream)


def _range(exposure_range_ms: Sequence[float]) -> tuple[float, float]:
    """Convert the range of exposures to seconds; ValueError if it isn't a range."""
    try:
        low, high = (float(limit) for limit in exposure_range_ms)
    except (TypeError, ValueError):
        low = high = math.nan
    if not 0 < low < high < math.inf:
        raise ValueError(
            f"exposure_range_ms is {exposure_range_ms}; give the shorter exposure first"
        )
    return low * 1e-3, high * 1e-3


def _never() -> bool:
    return False
