"""The bench as the window sets it: what is wanted, what stands, and the next honest frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame
from labapp.bench import Bench
from labapp.window.messages import BenchOpened, BenchState, DeviceInfo, LiveFrame


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

    A run leaves the bench safe; `restore()` brings back what the person had set.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._wanted = Wanted()
        self._ready = bench.clock.now()
        self._exposure = bench.camera.set_exposure(bench.camera.exposure_range[0]).actual
        self._failed: dict[str, str] = {}

    def place(self, target: str) -> None:
        self._wanted = replace(self._wanted, target=target)
        self._wait_for(self._bench.targets.place(target).ready_at)

    def tune(self, wavelength: float) -> None:
        self._wanted = replace(self._wanted, wavelength=wavelength)
        self._wait_for(self._bench.filter.set_wavelength(wavelength).ready_at)

    def expose(self, exposure: float) -> None:
        self._wanted = replace(self._wanted, exposure=exposure)
        setting = self._bench.camera.set_exposure(exposure)
        self._exposure = setting.actual
        self._wait_for(setting.ready_at)

    def show(self, name: str, grey: NDArray[np.uint8]) -> None:
        self._wanted = replace(self._wanted, pattern=name, grey=grey)
        self._wait_for(self._bench.slm.show(name, grey).ready_at)

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
        bench.clock.wait_until(self._ready, cancelled)
        frame = bench.camera.capture(cancelled)
        return LiveFrame(
            image=frame.image,
            target=bench.targets.placed,
            pattern=bench.slm.shown,
            wavelength=bench.filter.wavelength,
            exposure=frame.exposure,
            number=frame.number,
        )

    def saw(self, frame: Frame) -> None:
        """A run took a frame, and with it set the camera."""
        self._exposure = frame.exposure

    def blame(self, error: DeviceError) -> str:
        """The bench's name of the device that failed, which is marked until it works again."""
        if error.role:
            self._failed[error.role] = f"{error.command}: {error.reply}"
        return error.role

    def absolve(self) -> None:
        """Forget the failures: the devices did as they were told."""
        self._failed.clear()

    def state(self, live: bool, running: bool) -> BenchState:
        bench = self._bench
        return BenchState(
            devices=self._devices(live, running),
            target=bench.targets.placed,
            pattern=bench.slm.shown,
            wavelength=bench.filter.wavelength,
            exposure=self._exposure,
            live=live,
        )

    def opened(self) -> BenchOpened:
        bench = self._bench
        return BenchOpened(
            name=bench.file.name,
            devices=self._devices(live=False, running=False),
            targets=bench.targets.names,
            wavelength_range=bench.filter.wavelength_range,
            exposure_range=bench.camera.exposure_range,
            camera_shape=bench.camera.shape,
            full_scale=bench.camera.full_scale,
        )

    def _devices(self, live: bool, running: bool) -> tuple[DeviceInfo, ...]:
        bench = self._bench
        values = {
            "slm": bench.slm.shown,
            "filter": f"{bench.filter.wavelength * 1e9:.2f} nm",
            "camera": f"{self._exposure * 1e3:.3f} ms",
            "targets": bench.targets.placed,
        }
        busy = "in a run" if running else "ready"
        states = {"camera": "in a run" if running else "live" if live else "stopped"}
        return tuple(
            DeviceInfo(
                name,
                device.identity.model,
                device.identity.simulated,
                "failed" if name in self._failed else states.get(name, busy),
                self._failed.get(name, values[name]),
            )
            for name, device in bench.devices.items()
        )

    def _wait_for(self, ready_at: float) -> None:
        self._ready = max(self._ready, ready_at)
