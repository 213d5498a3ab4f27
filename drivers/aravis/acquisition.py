"""Take frames, and accept only those that have the settings that were set."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drivers.aravis.arrivals import BadFrame, FrameArrivals
from drivers.aravis.byte_checks import require_possible_layout, require_possible_numbers
from drivers.aravis.camera_options import AravisOptions
from drivers.aravis.frame_layout import line_distance, width_advice
from drivers.aravis.library_process import AravisProcess
from drivers.aravis.noise_checks import NoiseChecks
from drivers.aravis.pixel_formats import PixelFormat, unpack, unpack_lines
from drivers.errors import DeviceError
from drivers.latency import MOST_FRAMES, ExposureLatency

REPLY_TIMEOUT = 3.0
"""Seconds within which the library must answer any request except a wait for a frame."""


@dataclass(frozen=True)
class AcquisitionLimits:
    """Limit how long frames are waited for, and how many are rejected.

    poll_interval: seconds between checks of whether a wait was cancelled. Chosen.
    max_bad_frames: bad frames after which a capture fails; fewer if time runs out before. Chosen.
    max_outdated_frames: frames of an older exposure after which a capture fails, for a camera that
    reports the exposure of each frame: one more than are discarded of another camera.
    exposure_tolerance_us: microseconds by which the reported exposure may differ from the one that
    was set. Chosen.
    exposure_tolerance: the same as a share of the exposure; the larger of the two counts. Chosen.
    least_latency: frames after a change of exposure that are discarded at least if the camera
    doesn't report the exposure of each frame, unless an option tells their number. Chosen: a camera
    may take longer once than it took before.
    """

    poll_interval: float = 0.05
    max_bad_frames: int = 3
    max_outdated_frames: int = MOST_FRAMES + 1
    exposure_tolerance_us: float = 1.0
    exposure_tolerance: float = 1e-3
    least_latency: int = 3


_LIMITS = AcquisitionLimits()

_REOPEN = "Close what else sets the camera, and open the bench again"

_REMEDIES = {"repeated": "Take it again; if it goes on, restart the camera"}

_REMEDY = "Take it again; if it goes on, look at the network, the packet size and the cable"


class AcquiredFrame(NamedTuple):
    """A frame's pixels, its number, and the time.monotonic() when its exposure began."""

    image: NDArray[np.uint16]
    number: int
    began: float


class _OutdatedFrame(BadFrame):
    """A frame whose own metadata gives another exposure than the one that was set."""


@dataclass
class FrameAcquisition:
    """Take frames and reject those that don't have the settings that were made.

    A frame is accepted only if it is complete, has the region and format that were set, has the
    next number, and began after the call. If the camera reports the exposure of each frame, that
    must be the exposure that was set. Some cameras report what is set and still expose the next
    frames as before, so the first frames after a change are discarded as well; `latency` knows how
    many. After each frame the camera is asked whether it still has that exposure, and all else that
    changes pixels as on opening. A frame that no sensor can have sent is refused.

    region: x, y, width, height in pixels. exposure: seconds, as the camera has read it back.
    reports_exposure: whether the camera reports the exposure of each frame. timeout_margin:
    seconds beyond a frame's own time within which a call must have ended.
    """

    link: AravisProcess
    options: AravisOptions
    pixel_format: PixelFormat
    region: list[int]
    exposure: float
    reports_exposure: bool
    timeout_margin: float
    note_progress: Callable[[float], None]
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        least = 0 if self.reports_exposure else _LIMITS.least_latency
        self.latency = ExposureLatency(self.options.latency_frames, least)
        self._arrivals = FrameArrivals()
        self._running = False
        self._changed_at = 0.0
        self._frames_to_discard = 0
        self._buffer_to_return = -1
        across, down = self.options.binning
        self._noise = NoiseChecks(self.pixel_format, across * down)
        self.mark_settings_changed()

    @property
    def shape(self) -> tuple[int, int]:
        return self.region[3], self.region[2]

    @property
    def readout_time(self) -> float:
        """Estimate the seconds from the end of an exposure to the picture, at 1 Gbit/s."""
        return 0.02 + self.pixel_format.byte_count(self.shape) / 100e6

    @property
    def frame_time(self) -> float:
        """`readout_time` plus the seconds of the frames that are discarded first."""
        return self.readout_time + self._frames_to_discard * (self.exposure + self.readout_time)

    def change_exposure(self, exposure: float) -> float:
        """Set the exposure in seconds; return the one that is reported.

        Where the camera had this exposure already, frames that are under way have it, too.
        """
        before = float(self.link.ask("exposure", timeout=REPLY_TIMEOUT)) * 1e-6
        self.exposure = set_exposure(self.link, to_microseconds(exposure))
        if self.exposure != before:
            self.mark_settings_changed()
            self.latency.begin(before, self.exposure)
        return self.exposure

    def mark_settings_changed(self) -> None:
        """Note that exposure or gain changed, so that older frames are discarded."""
        self._changed_at = time.monotonic()
        # A free-running camera already exposes the next frame while it reads one out.
        ahead = self.options.trigger != "software"
        self._frames_to_discard = self.latency.frames + (ahead and not self.reports_exposure)
        if ahead:
            # It isn't known when the frames that are in transit left the camera.
            self._running = False

    def start(self) -> None:
        self._running = False
        memory = self.link.ask("start", self.options.buffers, timeout=REPLY_TIMEOUT)
        self._size, self._length = memory["size"], memory["length"]
        self._running, self._arrivals, self._buffer_to_return = True, FrameArrivals(), -1
        # Another program may have started an exposure or changed a setting before this.
        self._frames_to_discard = max(self._frames_to_discard, self.latency.frames)
        if not self._matches_exposure(float(self.link.ask("exposure", timeout=REPLY_TIMEOUT))):
            self._restore_exposure()

    def stop(self) -> None:
        self._running = False
        self.link.ask("stop", timeout=REPLY_TIMEOUT)

    def take(self, cancelled: Callable[[], bool]) -> AcquiredFrame:
        """Take a frame whose exposure begins after this call; DeviceError if none comes."""
        return self._take(cancelled, time.monotonic())

    def take_next(self, cancelled: Callable[[], bool]) -> AcquiredFrame:
        """Take the next frame that began after the settings changed, from a free-running camera."""
        return self._take(cancelled, self._changed_at)

    def _take(self, cancelled: Callable[[], bool], since: float) -> AcquiredFrame:
        late = time.monotonic() + self.exposure + self.frame_time + self.timeout_margin
        tries = 0
        while True:
            self.note_progress(self.exposure + self.readout_time)
            try:
                if not self._running:
                    self.start()
                taken = self._next_good_frame(cancelled, since)
                self.latency.add(taken.image)
                self._require_exposure()
                if self._frames_to_discard:
                    self._frames_to_discard -= 1
                    self.counts["thrown away"] += 1
                    continue
                self._require_state()
                self._noise.require_new(taken.image)
                self.counts["taken"] += 1
                return taken
            except _OutdatedFrame as old:
                # The camera hasn't applied the new exposure yet, so keep the stream running.
                self.counts[old.kind] += 1
                most = _LIMITS.max_outdated_frames
                bad: BadFrame = old
            except BadFrame as found:
                self.counts[found.kind] += 1
                self.latency.forget_change()
                # Start a new stream: frames that are in transit never arrive in it.
                self._running = False
                nobody = self.options.trigger == "hardware" and found.kind == "missing"
                most = 1 if nobody or found.remedy else _LIMITS.max_bad_frames
                bad = found
            tries += 1
            again = self.exposure + self.frame_time + self._frame_timeout
            if tries >= most or time.monotonic() + again > late:
                raise self._refusal(bad) from bad

    def _refusal(self, bad: BadFrame) -> DeviceError:
        advice = width_advice(self.pixel_format, self.shape[1])
        remedy = bad.remedy or _REMEDIES.get(bad.kind) or advice or _REMEDY
        error = DeviceError(self.link.model, "capture", f"{bad.kind} frame: {bad}", remedy)
        error.lasting = bool(bad.remedy)
        return error

    @property
    def _frame_timeout(self) -> float:
        """Seconds that a frame may be overdue before it counts as missing."""
        more = self.options.trigger_wait_s if self.options.trigger == "hardware" else 0.0
        return more + self.options.frame_timeout_ms * 1e-3

    def _next_good_frame(self, cancelled: Callable[[], bool], since: float) -> AcquiredFrame:
        """Return the next good frame whose exposure began after `since`."""
        triggered = self.options.trigger == "software"
        if triggered:
            self._return_buffer()
            self.counts["stale"] += len(self.link.ask("drain", timeout=REPLY_TIMEOUT))
            since = float(self.link.ask("trigger", timeout=REPLY_TIMEOUT))
        late = time.monotonic() + self.exposure + self.readout_time + self._frame_timeout
        if not triggered:
            late += self.exposure + self.readout_time
        bad = ""
        while True:
            note = self._pop(cancelled, late)
            if note is None:
                raise self._missing_frame_error(bad)
            began = since
            if not triggered:
                began = self._arrivals.departure_time(note) - self.exposure
                # Lost frames are only reported; they aren't an error.
                lost = self._arrivals.frames_lost_before(note)
                self.counts["dropped"] += lost
                if lost:
                    self.latency.forget_change()
            if began < since or (triggered and not self._arrivals.is_fresh(note, since)):
                self.counts["stale"] += 1
                continue
            try:
                image = self._image(note)
                self._arrivals.require_right_clock(note, since if triggered else None)
                return AcquiredFrame(image, note["number"], began)
            except BadFrame as found:
                if triggered or found.remedy:
                    raise
                self.counts[found.kind] += 1
                bad = f"; the last was {found.kind}: {found}"

    def _missing_frame_error(self, but: str) -> BadFrame:
        what = "good frame" if but else "frame"
        if self.options.trigger == "hardware" and not but:
            what = f"trigger at {self.options.trigger_line}, or no frame,"
        return BadFrame(
            "missing", f"no {what} within {self._frame_timeout:g} s after its time{but}"
        )

    def _pop(self, cancelled: Callable[[], bool], late: float) -> dict[str, Any] | None:
        """Return the library's note on the next frame, or None if none comes by the time `late`."""
        while time.monotonic() < late:
            if cancelled():
                self.stop()
                reply = "it was cancelled"
                raise DeviceError(self.link.model, "capture", reply, "Take it again")
            back, self._buffer_to_return = self._buffer_to_return, -1
            wait = min(_LIMITS.poll_interval, max(0.0, late - time.monotonic()))
            note: dict[str, Any] | None = self.link.ask("pop", wait, back, timeout=REPLY_TIMEOUT)
            if note is not None:
                self._buffer_to_return = note["place"]
                return note
        return None

    def _return_buffer(self) -> None:
        if self._buffer_to_return >= 0:
            self.link.ask("pop", 0.0, self._buffer_to_return, timeout=REPLY_TIMEOUT)
            self._buffer_to_return = -1

    def _image(self, note: dict[str, Any]) -> NDArray[np.uint16]:
        """Unpack the picture; BadFrame if the frame doesn't match the settings."""
        if note["status"] != "success":
            raise BadFrame("incomplete", f"number {note['number']}: {note['status']}")
        self._require_region(note)
        if self.reports_exposure:
            told = note.get("exposure_us")
            if told is None or not self._matches_exposure(told):
                raise _OutdatedFrame(
                    "wrong exposure", f"number {note['number']} was exposed {told} us"
                )
        stride = line_distance(note, self.pixel_format, self.shape)
        data = self.link.shared_bytes(note["place"], note["size"], self._length)
        if stride:
            image = unpack_lines(data, self.pixel_format, self.shape, stride)
        else:
            data = data[: self.pixel_format.byte_count(self.shape)]
            image = unpack(data, self.pixel_format, self.shape)
        require_possible_numbers(image, self.pixel_format)
        self._noise.require_noise(image)
        if not stride:
            require_possible_layout(data, image, self.pixel_format)
        return image

    def _require_region(self, note: dict[str, Any]) -> None:
        region, form = note["region"], self.pixel_format
        if note["code"] != form.code or region[2:] != self.region[2:]:
            raise BadFrame(
                "corrupt",
                f"number {note['number']} is {region[2:]} pixels of format {note['code']:#x}, not "
                f"{self.region[2:]} of {form.code:#x}",
            )
        # A camera may leave the offset out, and count it before or after binning.
        binned = tuple(self.options.binning) != (1, 1)
        if not binned and region[:2] not in (self.region[:2], [0, 0]):
            words = f"number {note['number']} begins at pixel {region[:2]}, not {self.region[:2]}"
            raise BadFrame("moved", words, _REOPEN)

    def _require_state(self) -> None:
        """Raise BadFrame if features aren't as they were on opening."""
        changes = self.link.ask("changes", timeout=REPLY_TIMEOUT) or []
        if changes:
            words = ", ".join(f"{name} from {then} to {now}" for name, then, now in changes)
            raise BadFrame("changed", f"the camera has changed by itself: {words}", _REOPEN)

    def _restore_exposure(self) -> None:
        self.exposure = set_exposure(self.link, to_microseconds(self.exposure))

    def _matches_exposure(self, us: float) -> bool:
        asked = self.exposure * 1e6
        return abs(us - asked) <= max(
            _LIMITS.exposure_tolerance_us, _LIMITS.exposure_tolerance * asked
        )

    def _require_exposure(self) -> None:
        """Raise BadFrame, and restore the exposure, if another program changed it."""
        us = float(self.link.ask("exposure", timeout=REPLY_TIMEOUT))
        if self._matches_exposure(us):
            return
        self._restore_exposure()
        self.mark_settings_changed()
        raise BadFrame("wrong exposure", f"the camera exposes {us:g} us by itself")


def to_microseconds(seconds: float) -> float:
    """Convert an exposure from seconds to microseconds, rounded to 1 ns.

    Some cameras truncate, so a rounding error below a whole number would cost a microsecond.
    """
    return round(seconds * 1e6, 3)


def set_exposure(link: AravisProcess, us: float) -> float:
    """Set the exposure in microseconds; return what the camera reports, in seconds."""
    return float(link.ask("set_exposure", us, timeout=REPLY_TIMEOUT)) * 1e-6
