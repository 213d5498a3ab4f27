"""Control of the bench: requested settings, their settling, and live frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting
from labapp.bench.opening import Bench
from labapp.window.engine.device_monitor import DeviceMonitor
from labapp.window.engine.live_tolerance import LiveTolerance
from labapp.window.engine.shown_patterns import ShownPatterns
from labapp.window.messages import BenchOpened, BenchState, LiveFrame


@dataclass(frozen=True)
class RequestedSettings:
    """What the person requested last; None sets nothing."""

    target: str | None = None
    wavelength: float | None = None
    exposure: float | None = None
    pattern_number: int | None = None


class BenchController:
    """Set the bench's devices, and take frames once the settings have settled.

    A run leaves the bench safe; `restore_settings()` brings back the person's settings. Methods
    raise DeviceError if a device is dead or fails; the requested setting is kept all the same.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.devices = DeviceMonitor(bench)
        self.live_tolerance = LiveTolerance(bench.camera_world)
        self._opened = _describe_capabilities(bench)
        self._requested = RequestedSettings()
        self._shown = ShownPatterns(
            bench.slm.displayed_pattern, np.zeros(bench.description.panel.shape, np.uint8)
        )
        self._asked_target = self._target_doubt = ""
        self._target_unseen = False
        self._ready = bench.clock.now()
        self._exposure = self._opened.exposure_range[0]
        try:
            self._apply_exposure(self._exposure)
        except DeviceError as error:
            self.devices.mark_failed(error)

    def place_target(self, target: str) -> None:
        self._asked_target = self._target_doubt = ""
        self._target_unseen = self._bench.targets.by_hand
        self._requested = replace(self._requested, target=target)
        self.devices.require_alive("targets")
        self._note_settling("targets", self._bench.targets.place(target))

    def ask_for_target(self, target: str) -> None:
        """Note which target a person is asked to place; "" if none."""
        self._asked_target = target

    def set_wavelength(self, wavelength: float) -> None:
        """Set the wavelength that the person requests, m."""
        self._requested = replace(self._requested, wavelength=wavelength)
        self.devices.require_alive("filter")
        self._note_settling("filter", self._bench.filter.set_wavelength(wavelength))

    def set_exposure(self, exposure: float) -> None:
        """Set the exposure that the person requests, s."""
        self._requested = replace(self._requested, exposure=exposure)
        self._apply_exposure(exposure)

    @property
    def exposure(self) -> float:
        """Return the exposure time in seconds that the camera was set to last."""
        return self._exposure

    def try_exposure(self, exposure: float) -> float:
        """Set an exposure that nobody requests, as for metering; return the real one.

        `restore_settings()` and `set_exposure()` bring back what is wanted.
        """
        self._apply_exposure(exposure)
        return self._exposure

    def show_pattern(self, name: str, grey: NDArray[np.uint8]) -> None:
        self.show_again(self._shown.keep(name, grey))

    def show_again(self, number: int) -> None:
        """Show a pattern that was on the SLM before, by its number; UserError if it isn't kept."""
        name, grey = self._shown.pattern(number)
        self._requested = replace(self._requested, pattern_number=number)
        self.devices.require_alive("slm")
        self._note_settling("slm", self._bench.slm.show(name, grey))

    def restore_settings(self) -> None:
        """Set the devices to the settings last requested.

        A target that a person places stays as it is; the person is asked for the next one.
        """
        wanted = self._requested
        if wanted.target is not None and not self._bench.targets.by_hand:
            self.place_target(wanted.target)
        if wanted.wavelength is not None:
            self.set_wavelength(wanted.wavelength)
        if wanted.exposure is not None:
            self.set_exposure(wanted.exposure)
        if wanted.pattern_number is not None:
            self.show_again(wanted.pattern_number)

    def take_frame(self, cancelled: Callable[[], bool]) -> LiveFrame:
        """Take a live frame, with its settings, when all settings have settled."""
        bench = self._bench
        self.devices.require_alive()
        bench.clock.wait_until(self._ready, cancelled)
        frame = bench.camera.capture(cancelled)
        self.devices.mark_working("camera")
        self._judge_target(frame)
        return self.label_frame(frame.image, frame.exposure, frame.number)

    def label_frame(self, image: NDArray[np.uint16], exposure: float, number: int) -> LiveFrame:
        """Return a live frame: an image with the settings of the devices."""
        bench = self._bench
        return LiveFrame(
            image=image,
            target=self._target_words(),
            pattern=bench.slm.displayed_pattern,
            wavelength=bench.filter.wavelength,
            exposure=exposure,
            number=number,
        )

    @property
    def frame_seconds(self) -> float:
        """Return the seconds that the next frame takes: settling, and the exposure."""
        return max(0.0, self._ready - self._bench.clock.now()) + self._exposure

    def note_run_frame(self, frame: Frame) -> None:
        """Note of a run's frame that every device works, and that the exposure is the run's."""
        self._exposure = frame.exposure
        self.devices.mark_working()

    def reconnect(self, role: str) -> None:
        """Open a failed device again; raises DeviceError if that fails, too."""
        self.devices.reopen(role)
        if role == "camera":
            self._apply_exposure(self._exposure)

    def read_state(self, live: bool, running: bool, *, query_devices: bool = True) -> BenchState:
        """Return the state of the bench.

        query_devices: whether the devices are asked for their settings; otherwise, the last known
            ones are returned.
        """
        infos = self.devices.device_infos(
            self._exposure, live=live, running=running, query_devices=query_devices
        )
        said = self.devices.last_settings
        return BenchState(
            devices=infos,
            target=said["targets"],
            pattern=said["slm"],
            wavelength=said["filter"],
            exposure=self._exposure,
            live=live,
            in_run=running,
            pattern_number=self._requested.pattern_number or 0,
            target_doubt=self._target_doubt,
        )

    def describe_bench(self) -> BenchOpened:
        infos = self.devices.device_infos(self._exposure, live=False, running=False)
        return replace(self._opened, devices=infos)

    def _judge_target(self, frame: Frame) -> None:
        """Judge by the first frame whether a target is there that a person confirmed."""
        if not self._target_unseen:
            return
        # It is loaded only where a person places targets.
        from labapp.runs.frame_doubts import target_doubt

        bench, self._target_unseen = self._bench, False
        self._target_doubt = target_doubt(
            bench.description,
            bench.targets.current_target,
            bench.slm.displayed_pattern,
            bench.filter.wavelength,
            frame.exposure,
            frame.image,
        )

    @property
    def target_doubt(self) -> str:
        """Return how the first frame of a confirmed target doesn't fit it; "" if it does.

        Only targets that a person places are judged.
        """
        return self._target_doubt

    def _target_words(self) -> str:
        """Return what a live frame says of its target: whatever nobody can read back, it says so.

        A target that a person places is only what the person has confirmed.
        """
        target = self._bench.targets.current_target
        if not self._bench.targets.by_hand:
            return target
        confirmed = f"{target} (confirmed)" if target else "target not confirmed"
        return f"{confirmed}, asked: {self._asked_target}" if self._asked_target else confirmed

    def _apply_exposure(self, exposure: float) -> None:
        self.devices.require_alive("camera")
        setting = self._bench.camera.set_exposure(exposure)
        self._exposure = setting.actual
        self._note_settling("camera", setting)

    def _note_settling(self, role: str, setting: Setting[Any]) -> None:
        """Note that a device works, and when its setting will have settled for the next frame."""
        self._ready = max(self._ready, setting.ready_at)
        self.devices.mark_working(role)


def _describe_capabilities(bench: Bench) -> BenchOpened:
    """Ask the devices what the bench can do; the list of devices is added later."""
    return BenchOpened(
        name=bench.file.name,
        devices=(),
        targets=bench.targets.names,
        wavelength_range=bench.filter.wavelength_range,
        exposure_range=bench.camera.exposure_range,
        camera_shape=bench.camera.shape,
        full_scale=bench.description.sensor.full_scale,
        virtual=not bench.file.is_real,
        scene_tolerance=None if bench.camera_world is None else bench.camera_world.imaging.tol,
        targets_by_hand=bench.targets.by_hand,
    )
