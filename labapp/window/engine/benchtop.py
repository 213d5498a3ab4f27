"""The bench as the window sets it: what is wanted, what stands, and the next honest frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Setting
from labapp.bench.opening import Bench
from labapp.window.engine.devices import Devices
from labapp.window.messages import BenchOpened, BenchState, LiveFrame


@dataclass(frozen=True)
class Wanted:
    """What the person set last. None: the bench is left as it is."""

    target: str | None = None
    wavelength: float | None = None
    exposure: float | None = None
    pattern: str = "neutral"
    grey: NDArray[np.uint8] | None = None


class Benchtop:
    """Sets devices, remembers when each setting stands, and takes frames after that.

    A run leaves the bench safe; `restore()` brings back what the person had set. DeviceError
    if a device is dead or fails; what the person wants is kept all the same.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.devices = Devices(bench)
        self._opened = _opened(bench)
        self._wanted = Wanted()
        self._ready = bench.clock.now()
        self._exposure = self._opened.exposure_range[0]
        try:
            self._set_exposure(self._exposure)
        except DeviceError as error:
            self.devices.blame(error)

    def place(self, target: str) -> None:
        self._wanted = replace(self._wanted, target=target)
        self.devices.require_alive("targets")
        self._stands("targets", self._bench.targets.place(target))

    def tune(self, wavelength: float) -> None:
        self._wanted = replace(self._wanted, wavelength=wavelength)
        self.devices.require_alive("filter")
        self._stands("filter", self._bench.filter.set_wavelength(wavelength))

    def expose(self, exposure: float) -> None:
        self._wanted = replace(self._wanted, exposure=exposure)
        self._set_exposure(exposure)

    def show(self, name: str, grey: NDArray[np.uint8]) -> None:
        self._wanted = replace(self._wanted, pattern=name, grey=grey)
        self.devices.require_alive("slm")
        self._stands("slm", self._bench.slm.show(name, grey))

    def restore(self) -> None:
        """Set everything as it was wanted last."""
        wanted = self._wanted
        if wanted.target is not None:
            self.place(wanted.target)
        if wanted.wavelength is not None:
            self.tune(wanted.wavelength)
        if wanted.exposure is not None:
            self.expose(wanted.exposure)
        if wanted.grey is not None:
            self.show(wanted.pattern, wanted.grey)

    def frame(self, cancelled: Callable[[], bool]) -> LiveFrame:
        """One picture, begun after every setting stands, with the settings it was taken with."""
        bench = self._bench
        self.devices.require_alive()
        bench.clock.wait_until(self._ready, cancelled)
        frame = bench.camera.capture(cancelled)
        self.devices.absolve("camera")
        return LiveFrame(
            image=frame.image,
            target=bench.targets.placed,
            pattern=bench.slm.shown,
            wavelength=bench.filter.wavelength,
            exposure=frame.exposure,
            number=frame.number,
        )

    def saw(self, frame: Frame) -> None:
        """A run took a frame, for which every device worked, and with it set the camera."""
        self._exposure = frame.exposure
        self.devices.absolve()

    def reconnect(self, role: str) -> None:
        """Open a device that failed again. DeviceError if that fails, too."""
        self.devices.reopen(role)
        if role == "camera":
            self._set_exposure(self._exposure)

    def state(self, live: bool, running: bool, *, anew: bool = True) -> BenchState:
        """anew: whether the devices are asked; what they said last if not."""
        infos = self.devices.infos(self._exposure, live=live, running=running, anew=anew)
        said = self.devices.last
        return BenchState(
            devices=infos,
            target=said["targets"],
            pattern=said["slm"],
            wavelength=said["filter"],
            exposure=self._exposure,
            live=live,
        )

    def opened(self) -> BenchOpened:
        infos = self.devices.infos(self._exposure, live=False, running=False)
        return replace(self._opened, devices=infos)

    def _set_exposure(self, exposure: float) -> None:
        self.devices.require_alive("camera")
        setting = self._bench.camera.set_exposure(exposure)
        self._exposure = setting.actual
        self._stands("camera", setting)

    def _stands(self, role: str, setting: Setting[Any]) -> None:
        """A device did as it was told; no picture is begun before its setting stands."""
        self._ready = max(self._ready, setting.ready_at)
        self.devices.absolve(role)


def _opened(bench: Bench) -> BenchOpened:
    """What the bench can do, asked while every device is there; the list of them follows."""
    return BenchOpened(
        name=bench.file.name,
        devices=(),
        targets=bench.targets.names,
        wavelength_range=bench.filter.wavelength_range,
        exposure_range=bench.camera.exposure_range,
        camera_shape=bench.camera.shape,
        full_scale=bench.camera.full_scale,
        virtual=not bench.file.is_real,
    )
