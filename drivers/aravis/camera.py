"""The camera that a bench opens: it is found, set, read out and opened again if it was lost."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import prod
from typing import Literal, Self

from drivers.aravis.acquisition import (
    REPLY_TIMEOUT,
    AcquiredFrame,
    FrameAcquisition,
    set_exposure,
    to_microseconds,
)
from drivers.aravis.applied_settings import SETTING_TOLERANCE, AppliedSettings
from drivers.aravis.camera_options import AravisOptions, Trigger
from drivers.aravis.library_process import AravisProcess, CameraLost, open_camera
from drivers.aravis.pixel_formats import ByteOrder, Justification
from drivers.errors import DeviceError
from drivers.interfaces import Frame, Identity, Region, Setting, Surroundings
from drivers.latency import light_level, measure_old_frames


class AravisCamera:
    """Take frames with a GigE Vision or USB3 Vision camera through Aravis 0.8.

    The same code drives both kinds of camera. The library runs in a child process, which is
    killed if it hangs. The next call then starts another one and opens the camera again, which
    must have the same serial number. `FrameAcquisition` says which frames are accepted.

    Parameters
    ----------
    surroundings : Surroundings
        The bench's clock.
    address : str
        Serial number, IP address or Aravis' id; the first camera found if empty. The search
        takes a second.
    pixel_format : str
        GenICam's name of the format, such as "Mono12p" or "BayerRG8"; the camera's current one
        if empty. Mosaics aren't demosaiced; `bayer` gives their pattern.
    gain_db : float
        Gain in decibels, within the camera's range.
    roi : sequence of int
        Region [x, y, width, height] in pixels; the whole sensor if empty.
    binning : sequence of int
        Pixels that are combined, [across, down].
    trigger : {"software", "hardware", "free"}
        "software": each frame is triggered by a call. "hardware": by the camera's input
        `trigger_line`. "free": the camera runs freely.
    trigger_line : str
        The camera's input for hardware triggers.
    frame_rate : float
        Frames per second of a free-running camera; 0 leaves the camera's own.
    packet_size : int
        Size of the network packets in bytes; negotiated if 0.
    buffers : int
        Number of frames that may wait in memory, at least 2.
    latency_frames : int, optional
        Number of frames after a change of exposure that may still have the old one, which are
        discarded; measure_latency() finds it. By default, 8 are discarded until their light has
        shown when the camera obeys, and then that many: 3 at least, or 0 for a camera that reports
        the exposure of each frame (chunk data). Frames that are reported with another exposure are
        discarded beside these.
    frame_timeout_ms : float
        Milliseconds beyond exposure and frame time after which a frame counts as missing.
    trigger_wait_s : float
        Seconds for which a hardware trigger is waited for.
    electrons_per_number : float
        Conversion gain in electrons per digital number at 0 dB, from the data sheet.
    byte_order : {"", "little", "big"}
        Which byte of a 16-bit word comes first. If empty, the least significant one, as GenICam's
        pixel formats have it, and frames that show otherwise are refused.
    justification : {"", "right", "left"}
        At which end of a 16-bit word a pixel of fewer bits stands. If empty, at the lower one, as
        GenICam's pixel formats have it, and frames that show otherwise are refused. "right" also
        accepts frames whose lowest bits are never set, as of a converter with fewer bits.
    keep_features : sequence of str
        GenICam's names of features that change pixels and are left as they are, such as
        "ReverseX"; all others that are known are turned off on opening.

    Raises
    ------
    ValueError
        If an option is invalid.
    """

    settling = 0.0
    latency_option = "latency_frames"
    is_left_safe_when_killed = True

    def __init__(
        self,
        surroundings: Surroundings,
        address: str = "",
        pixel_format: str = "",
        gain_db: float = 0.0,
        roi: Sequence[int] = (),
        binning: Sequence[int] = (1, 1),
        trigger: Trigger = "software",
        trigger_line: str = "Line0",
        frame_rate: float = 0.0,
        packet_size: int = 0,
        buffers: int = 8,
        latency_frames: int | None = None,
        frame_timeout_ms: float = 1000.0,
        trigger_wait_s: float = 5.0,
        electrons_per_number: float = 1.0,
        byte_order: ByteOrder | Literal[""] = "",
        justification: Justification | Literal[""] = "",
        keep_features: Sequence[str] = (),
    ) -> None:
        self._options = AravisOptions(
            address,
            pixel_format,
            gain_db,
            roi,
            binning,
            trigger,
            trigger_line,
            frame_rate,
            packet_size,
            buffers,
            latency_frames,
            frame_timeout_ms,
            trigger_wait_s,
            electrons_per_number,
            byte_order,
            justification,
            keep_features,
        )
        self._requested = self._options
        self._opened_region: list[int] = []
        self._clock = surroundings.clock
        self._model = f"camera {address}".strip()
        self._link: AravisProcess | None = None
        self._open_acquisition: FrameAcquisition | None = None
        self._applied_settings: AppliedSettings | None = None
        self._requested_exposure: float | None = None
        self._counts: Counter[str] = Counter()
        self._number = self._camera_number = 0
        self._entered = False
        self.alive_at = 0.0
        waits = trigger_wait_s if trigger == "hardware" else 0.0
        self.reply_time = 5.0 + frame_timeout_ms * 1e-3 + waits

    @property
    def identity(self) -> Identity:
        set_ = self._applied_settings
        return Identity(self._model, "", simulated=False) if set_ is None else set_.identity

    @property
    def shape(self) -> tuple[int, int]:
        return self._acquisition.shape

    @property
    def pixel_format(self) -> str:
        return self._acquisition.pixel_format.name

    @property
    def bayer(self) -> str:
        """First two mosaic colours, such as RG; empty without a mosaic."""
        return self._acquisition.pixel_format.bayer

    @property
    def full_scale(self) -> int:
        return self._acquisition.pixel_format.full_scale

    @property
    def exposure_range(self) -> tuple[float, float]:
        return self._settings.exposure_range

    @property
    def gain_range(self) -> tuple[float, float] | None:
        """Range of gain in decibels; None if the camera has no gain."""
        return self._settings.gain_range

    @property
    def exposure(self) -> float:
        """Exposure time in seconds that the camera reports."""
        return self._acquisition.exposure

    @property
    def frame_time(self) -> float:
        return self._acquisition.frame_time

    @property
    def counts(self) -> Counter[str]:
        """Frames since this object was made, by what became of them: taken, stale, missing, ..."""
        return Counter(self._counts)

    def set_exposure(self, exposure: float) -> Setting[float]:
        command = f"expose {exposure * 1e3:g} ms"
        with self._translate_errors(command):
            taking = self._ensure_open()
            low, high = self.exposure_range
            if not low <= exposure <= high:
                reply = f"out of range, {low * 1e3:g} to {high * 1e3:g} ms"
                raise self._error(command, reply, "Choose an exposure in the range")
            actual = taking.change_exposure(exposure)
            if abs(actual - exposure) > SETTING_TOLERANCE * exposure:
                reply = f"it has set {actual * 1e3:g} ms"
                raise self._error(command, reply, "Look at its frame rate and its other limits")
            self._requested_exposure = exposure
            return Setting(exposure, actual, self._clock.now())

    @property
    def gain_db(self) -> float:
        """Gain in decibels that the camera reports."""
        return self._settings.gain

    def set_gain(self, gain_db: float | None) -> Setting[float]:
        """Set the gain in decibels; that of the option `gain_db` if None."""
        asked = self._options.gain_db if gain_db is None else gain_db
        with self._translate_errors("set gain"):
            taking = self._ensure_open()
            before = self._settings.gain
            actual = self._settings.set_gain(asked)
            self._requested = replace(self._requested, gain_db=asked)
            if actual != before:
                taking.mark_settings_changed()
            return Setting(asked, actual, self._clock.now())

    def set_region(self, region: Region | None, binning: int | None) -> Setting[Region]:
        """Read only a region of the frames, and average the pixels that the camera can bin.

        region: x, y, width, height in pixels of the frames that the options `roi` and `binning`
        give, which are averaged `binning` times as much each way. None stands for the options.
        """
        with self._translate_errors(f"region {region}, binning {binning or 1}"):
            taking = self._ensure_open()
            x, y, width, height = region or (0, 0, *self._opened_region[2:])
            more = binning or 1
            if more > 1 and tuple(self._options.binning) != (1, 1):
                reply = f"the bench file's option binning is {list(self._options.binning)}"
                raise self._error(f"binning {more}", reply, "Leave one of the two out")
            left, top = self._opened_region[:2]
            part = [(left + x) // more, (top + y) // more, width // more, height // more]
            wanted = replace(self._options, gain_db=self._requested.gain_db)
            if (region, binning) != (None, None):
                binned = (more, more) if more > 1 else self._options.binning
                wanted = replace(wanted, roi=part, binning=binned, average_binned=more > 1)
            if wanted != self._requested:
                taking.stop()
                self._set_up_again(wanted)
            return Setting((x, y, width, height), (x, y, width, height), self._clock.now())

    def capture(self, cancelled: Callable[[], bool]) -> Frame:
        """Take a frame whose exposure begins after this call."""
        with self._translate_errors("capture"):
            return self._build_frame(self._ensure_open().take(cancelled))

    def measure_latency(self, exposures: Sequence[float], steps: int = 1, frames: int = 18) -> int:
        """Measure `latency_frames` by alternating between two exposures.

        The light must be steady. The result is used from now on.

        exposures: two, in seconds, of which neither gives dark or clipped frames. steps: how often
        each is set. frames: number of frames that are evaluated after each change.
        """
        with self._translate_errors("measure the latency"):
            latency = self._ensure_open().latency
        waiting, latency.told = latency.told, 0
        try:
            latency.told = self._old_frames(exposures, steps, frames)
        except ValueError as error:
            latency.told = waiting
            remedy = "Point it at a steady light"
            raise self._error("measure the latency", str(error), remedy) from error
        except BaseException:
            latency.told = waiting
            raise
        return latency.told

    def _old_frames(self, exposures: Sequence[float], steps: int, frames: int) -> int:
        def take_levels(exposure: float) -> list[tuple[int, float]]:
            self.set_exposure(exposure)
            with self._translate_errors("measure the latency"):
                images = (self._acquisition.take(lambda: False).image for _ in range(frames))
                return [(number, light_level(image)) for number, image in enumerate(images)]

        return measure_old_frames(take_levels, exposures, steps)

    def next_frame(self, cancelled: Callable[[], bool]) -> Frame:
        """Return a free-running camera's next frame; lost frames are counted.

        The exposure may have begun before the call, but not before the last change of settings.
        """
        if self._options.trigger == "software":
            raise self._error("next frame", "it isn't free-running", "Use capture()")
        with self._translate_errors("next frame"):
            return self._build_frame(self._ensure_open().take_next(cancelled))

    def health(self) -> dict[str, str]:
        with self._translate_errors("health"):
            link = self._ensure_open().link
            facts = self._settings.facts
            told = {name: str(facts[name]) for name in ("vendor", "model", "serial", "protocol")}
            told["pixel format"] = self.pixel_format
            told["packet size"] = str(self._settings.packet_size)
            told["turned off"] = self._settings.turned_off or "nothing"
            told["tells exposure"] = "yes" if self._acquisition.reports_exposure else "no"
            told |= link.ask("health", timeout=REPLY_TIMEOUT)
            told |= {f"frames {kind}": str(count) for kind, count in self._counts.items()}
            counted = link.ask("counts", timeout=REPLY_TIMEOUT)
            return told | {name.replace("_", " "): str(n) for name, n in counted.items()}

    def make_safe(self) -> None:
        """Stop taking frames, and give back the options' gain and region.

        If Aravis' process was killed, or the camera was lost, it is opened again for that.
        """
        if not self._entered:
            return
        try:
            self._stop()
        except CameraLost:
            self._stop()

    def _stop(self) -> None:
        with self._translate_errors("stop"):
            self._ensure_open().stop()
            if self._requested != self._options:
                self._set_up_again(self._options)

    def kill(self) -> None:
        """Kill the child process, from any thread; the next call starts another one."""
        link = self._link
        if link is not None:
            link.kill()

    def unplugged_reason(self) -> str | None:
        """Return why the camera counts as unplugged, empty while connected; see Device."""
        link = self._link
        return None if link is None else link.unplugged_reason()

    def __enter__(self) -> Self:
        with self._translate_errors("open"):
            self._ensure_open()
        self._entered = True
        return self

    def __exit__(self, *error: object) -> None:
        self._entered = False
        self._disconnect()

    @property
    def _settings(self) -> AppliedSettings:
        if self._applied_settings is None:
            raise self._error("ask", "it is not open", "Open it")
        return self._applied_settings

    @property
    def _acquisition(self) -> FrameAcquisition:
        if self._open_acquisition is None:
            raise self._error("ask", "it is not open", "Open it")
        return self._open_acquisition

    def _ensure_open(self) -> FrameAcquisition:
        """Return the open camera's acquisition; open the camera again if it was lost."""
        if self._link is not None:
            return self._acquisition
        # A camera forgets a controller that has died after 1.5 s.
        link = open_camera(self._model, self._options.address, timeout=2.0)
        try:
            self._open_acquisition = self._set_up(link)
        except BaseException:
            link.kill()
            link.close()
            raise
        self._link = link
        return self._open_acquisition

    def _set_up_again(self, options: AravisOptions) -> None:
        """Give the open camera other options; if it refuses one, it is opened anew later.

        It then gets the options of the bench file again.
        """
        assert self._link is not None
        self._requested = options
        try:
            self._open_acquisition = self._set_up(self._link)
        except BaseException:
            self._requested = self._options
            self._disconnect()
            raise

    def _set_up(self, link: AravisProcess) -> FrameAcquisition:
        settings = AppliedSettings(link, self._requested, self._applied_settings)
        self._applied_settings, self._model = settings, link.model
        if self._requested == self._options:
            self._opened_region = settings.region
        first = link.ask("exposure", timeout=REPLY_TIMEOUT)
        us = (
            float(first)
            if self._requested_exposure is None
            else to_microseconds(self._requested_exposure)
        )
        taking = FrameAcquisition(
            link,
            self._requested,
            settings.pixel_format,
            settings.region,
            set_exposure(link, us),
            settings.reports_exposure,
            self.reply_time,
            self._note_progress,
            self._counts,
        )
        if self._open_acquisition is not None:
            # A measured latency is the camera's, whatever its settings.
            taking.latency.told = self._open_acquisition.latency.told
        return taking

    def _build_frame(self, taken: AcquiredFrame) -> Frame:
        began = self._clock.now() - (time.monotonic() - taken.began)
        binned = prod(self._requested.binning) / prod(self._options.binning)
        gain = binned * self._options.electrons_per_number / 10 ** (self._settings.gain / 20)
        number = self._unwrap_number(taken.number)
        return Frame(taken.image, self._acquisition.exposure, gain, began, number)

    def _unwrap_number(self, number: int) -> int:
        """Return a frame number that always increases, although the camera's may restart.

        GigE Vision 1 counts only to 65535, and a new stream may begin again. Frames with the
        same number as the one before are rejected earlier.
        """
        step = number - self._camera_number
        self._number += step if step > 0 else 1
        self._camera_number = number
        return self._number

    def _note_progress(self, seconds: float) -> None:
        """Note that work goes on and will take some more seconds."""
        self.alive_at = time.monotonic() + seconds

    def _disconnect(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @contextlib.contextmanager
    def _translate_errors(self, command: str) -> Iterator[None]:
        """Turn errors into DeviceError; a lost camera is opened again at the next call."""
        try:
            yield
        except CameraLost:
            self._disconnect()
            raise
        except (OSError, EOFError, ValueError, KeyError, TypeError) as error:
            self.kill()
            self._disconnect()
            reply = f"{type(error).__name__}: {error}"
            raise self._error(command, reply, "Take it again") from error

    def _error(self, command: str, reply: str, remedy: str) -> DeviceError:
        return DeviceError(self._model, command, reply, remedy)
