"""Take single frames: set the devices, wait for settling, expose, and validate the frame."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting, checksum
from labapp.files.plan_file import Retry
from labapp.runs.acquisition.attendance import AskOperator
from labapp.runs.acquisition.feasibility import placement_prompt
from labapp.runs.bench_interface import Bench
from labapp.runs.frame_acceptance import (
    GAIN_TOLERANCE_DB,
    CaptureConditions,
    require_valid_frame,
)
from labapp.runs.readouts import AS_OPENED, MeanImage, Readout
from labapp.runs.record.writer import CorruptFrame
from labapp.runs.shots import Shot
from optics.progress import Progress

log = logging.getLogger(__name__)

StoreFrame = Callable[[Shot, Frame, float, int], None]
"""Stores a shot's frame on the disk, with its true wavelength and the number of attempts."""


class FrameTaker:
    """Takes frames, and makes every setting of the bench that a frame needs.

    Settings that were made before aren't relied upon.

    patterns: grey levels by name, (rows, columns), or (frames, rows, columns) of a video.
    seed: for simulated devices. ask: prompts a person to place targets; None if nobody is there.
    is_cancelled: returns whether the run was cancelled; called all the time during waits.
    """

    def __init__(
        self,
        bench: Bench,
        patterns: Mapping[str, NDArray[np.uint8]],
        seed: int,
        retry: Retry,
        ask: AskOperator | None,
        progress: Progress,
        is_cancelled: Callable[[], bool],
    ) -> None:
        self._is_cancelled = is_cancelled
        self._bench, self._patterns, self._seed = bench, patterns, seed
        self._retry, self._ask, self._progress = retry, ask, progress
        self._by_hand = bench.targets.by_hand
        self._placed_target = ""
        self._set: dict[str, str] = {}
        self._whole_frame = bench.camera.shape
        self._readout: Readout | None = AS_OPENED
        self._chosen_once: set[str] = set()
        self._last_number = -1

    def invalidate_settings(self) -> None:
        """Forget the settings of the bench, so that all are made again before the next frame.

        Somebody else may have used the bench during a pause.
        """
        self._set.clear()
        if self._chosen_once:
            self._readout = None

    def restore_camera(self) -> None:
        """Let the camera read its sensor as the bench opened it, for somebody else's use."""
        if self._readout != AS_OPENED:
            self._read_sensor(AS_OPENED)

    def take(self, shot: Shot, keep: StoreFrame) -> Frame:
        """Take and store the frame of a shot, and return it in whole digital numbers.

        It is tried again when a device fails. Raises DeviceError after as many failures as the plan
        allows, and at once if another try would fail in the same way. Raises Cancelled if the user
        cancels; no frame is begun or stored after that.
        """
        attempt = 1
        while True:
            try:
                return self._try(shot, attempt, keep)
            except DeviceError as error:
                self._progress.raise_if_cancelled()
                tried = f"frame {shot.index}, attempt {attempt} of {self._retry.attempts}"
                log.warning("%s: %s", tried, error)
                self.invalidate_settings()
                if error.lasting or attempt >= self._retry.attempts:
                    raise
                self._recover_device(error, attempt)
            attempt += 1

    def _try(self, shot: Shot, attempt: int, keep: StoreFrame) -> Frame:
        """Make one attempt to take and store the frame of a shot."""
        bench, progress = self._bench, self._progress
        self._request_placement(shot)
        # After the prompt: live pictures that were taken meanwhile leave no trace in this one.
        if bench.world is not None:
            bench.world.begin_frame(
                self._seed, shot.step, shot.repeat, index=shot.index, start_time=shot.start_time
            )
        ready = [bench.clock.now()]
        if shot.place:
            place = partial(bench.targets.place, shot.place)
            ready.append(self._apply("target", shot.place, place))
        ready += [
            self._apply("pattern", shot.pattern, lambda: self._show(shot.pattern)),
            self._apply("wavelength", _colour(shot), lambda: self._tune(shot)),
        ]
        if shot.readout != self._readout:
            ready.append(self._read_sensor(shot.readout))
        setting = bench.camera.set_exposure(shot.exposure)
        stands = max(*ready, setting.ready_at)
        bench.clock.wait_until(stands, self._is_cancelled)
        progress.raise_if_cancelled()
        shape = shot.readout.shape(self._whole_frame)
        stood = CaptureConditions(setting.actual, stands, self._last_number, shape)
        frame, wavelength = self._capture(shot, stood)
        if shot.readout.averaged > 1:
            frame = self._average(frame, shot, stood)
        try:
            keep(shot, frame, wavelength, attempt)
        except CorruptFrame as error:
            raise bench.device_error(
                "camera", "capture", f"the frame is corrupt: {error}"
            ) from error
        self._last_number = frame.number
        if shot.readout.averaged > 1:
            return replace(frame, image=shot.readout.whole_numbers(frame.image))
        return frame

    def _capture(self, shot: Shot, stood: CaptureConditions) -> tuple[Frame, float]:
        """Expose a frame; return it with its wavelength in metres."""
        progress = self._progress
        frame = self._bench.camera.capture(lambda: progress.is_cancelled)
        progress.raise_if_cancelled()
        return frame, require_valid_frame(frame, shot, stood, self._bench)

    def _average(self, first: Frame, shot: Shot, stood: CaptureConditions) -> Frame:
        """Take the other frames of a shot, and return the mean with the last one's number."""
        mean, last = MeanImage(first.image, self._bench.camera.full_scale), first
        self._require_intact(first)
        for _ in range(1, shot.readout.averaged):
            last, _ = self._capture(shot, replace(stood, last_number=last.number))
            self._require_intact(last)
            mean.add(last.image)
        image = mean.stored(shot.readout.steps_per_dn)
        return replace(last, image=image, time=first.time, checksum=None)

    def _require_intact(self, frame: Frame) -> None:
        """Raise DeviceError if a frame isn't what the camera sent, by its checksum."""
        if frame.checksum is not None and checksum(frame.image) != frame.checksum:
            raise self._bench.device_error("camera", "capture", "the frame is corrupt")

    def _read_sensor(self, readout: Readout) -> float:
        """Set how the camera reads its sensor; return the time when that stands.

        Not every camera has a gain or regions to be set. What a shot doesn't choose is as the bench
        opened the camera, and is set only where an earlier shot has chosen it.
        """
        camera: Any = self._bench.camera
        before, self._readout = self._readout, None
        ready, pixels = 0.0, (readout.region, readout.binning)
        self._chosen_once |= {"pixels"} if pixels != (None, None) else set()
        self._chosen_once |= {"gain"} if readout.gain_db is not None else set()
        if "pixels" in self._chosen_once:
            setting = camera.set_region(*pixels)
            ready = max(ready, self._require_set(setting, readout.region, 0))
        if "gain" in self._chosen_once:
            setting = camera.set_gain(readout.gain_db)
            ready = max(ready, self._require_set(setting, readout.gain_db, GAIN_TOLERANCE_DB))
        if before is not None or readout.describe():
            log.info("camera: %s", readout.describe() or "as the bench opened it")
        self._readout = readout
        return ready

    def _require_set(self, setting: Setting[Any], asked: Any, tolerance: float) -> float:
        """Return when a setting of the camera stands; DeviceError if it is another one."""
        if asked is not None and np.abs(np.subtract(setting.actual, asked)).max() > tolerance:
            raise self._bench.device_error("camera", f"set {asked}", f"it has set {setting.actual}")
        return setting.ready_at

    def _request_placement(self, shot: Shot) -> None:
        """Prompt a person to place the target of a shot, if it has changed."""
        if shot.target == self._placed_target:
            return
        text = placement_prompt(shot, self._by_hand)
        if text:
            assert self._ask is not None, "a run with prompts begins only where somebody answers"
            log.info("asked: %s", text)
            self._ask(text, self._progress)
        self._placed_target = shot.target

    def _show(self, name: str) -> Setting[str]:
        grey = self._patterns[name]
        slm = self._bench.slm
        return slm.show(name, grey) if grey.ndim == 2 else slm.play(name, grey)

    def _tune(self, shot: Shot) -> Setting[Any]:
        if shot.slot and (wheel := self._bench.wheel) is not None:
            return wheel.set_slot(shot.slot)
        return self._bench.filter.set_wavelength(shot.wavelength)

    def _apply(self, what: str, value: str, make: Callable[[], Setting[Any]]) -> float:
        """Make a setting if it has changed; return the time when it is settled."""
        if self._set.get(what) == value:
            return 0.0
        self._set.pop(what, None)
        setting = make()
        self._set[what] = value
        log.info("%s: %s", what, value)
        return setting.ready_at

    def _recover_device(self, error: DeviceError, attempt: int) -> None:
        """Wait, then open the device that failed again, if it was given up.

        From the second failure on, the device is opened again in any case. A device that was
        unplugged is first given a minute to come back, because attempts before would fail.
        """
        clock = self._bench.clock
        clock.wait_until(clock.now() + self._retry.wait_s, self._is_cancelled)
        self._progress.raise_if_cancelled()
        device = self._bench.supervised_devices.get(error.role)
        if device is None:
            return
        if device.unplugged_reason():
            clock.wait_until(
                clock.now() + 60.0,
                lambda: self._is_cancelled() or not device.unplugged_reason(),
            )
            self._progress.raise_if_cancelled()
        if not (device.failure_reason or attempt > 1):
            return
        try:
            device.revive()
            self._last_number = -1
        except DeviceError as again:
            log.warning("%s", again)


def _colour(shot: Shot) -> str:
    """Return a shot's wavelength in words for the log, with the wheel's slot if any."""
    nm = f"{shot.wavelength * 1e9:g} nm"
    return f"slot {shot.slot}, {nm}" if shot.slot else nm
