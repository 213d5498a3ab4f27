"""One frame after the other: set what changes, wait until all of it stands, expose."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.interfaces import Frame, Seeded, Setting
from labapp.acquisition.steps import Shot
from labapp.bench import Bench
from optics.progress import Progress

log = logging.getLogger(__name__)


class Taker:
    """Takes the frames of one run. It trusts no setting that it didn't make itself.

    patterns: grey levels by name. seed: of the run, for simulated devices.
    """

    def __init__(self, bench: Bench, patterns: Mapping[str, NDArray[np.uint8]], seed: int) -> None:
        self._bench, self._patterns, self._seed = bench, patterns, seed
        self._set: dict[str, object] = {}

    def take(self, shot: Shot, progress: Progress) -> Frame:
        """A frame of exactly this shot; DeviceError if a device fails or gives another.

        Raises Cancelled rather than start or give back a frame that nobody wants any more.
        """
        bench = self._bench
        for device in bench.devices.values():
            if isinstance(device, Seeded):
                device.reseed(self._seed, shot.step, shot.repeat)
        grey = self._patterns[shot.pattern]
        ready = [
            bench.clock.now(),
            self._change("target", shot.target, lambda: bench.targets.place(shot.target)),
            self._change("pattern", shot.pattern, lambda: bench.slm.show(shot.pattern, grey)),
            self._change(
                "wavelength", shot.wavelength, lambda: bench.filter.set_wavelength(shot.wavelength)
            ),
        ]
        setting = bench.camera.set_exposure(shot.exposure)
        bench.clock.wait_until(max(*ready, setting.ready_at), lambda: progress.cancelled)
        progress.check()
        frame = bench.camera.capture(lambda: progress.cancelled)
        progress.check()
        if frame.exposure != setting.actual:
            raise DeviceError(
                bench.camera.identity.model,
                f"capture at {setting.actual * 1e3:g} ms",
                f"the frame was exposed for {frame.exposure * 1e3:g} ms",
                "Run the plan again; if it happens again, restart the camera",
            )
        return frame

    def _change(self, what: str, value: object, make: Callable[[], Setting[Any]]) -> float:
        """Make a setting if it isn't the one this run made last; when it stands."""
        if self._set.get(what) == value:
            return 0.0
        self._set.pop(what, None)
        setting = make()
        self._set[what] = value
        shown = f"{setting.actual * 1e9:g} nm" if what == "wavelength" else setting.actual
        log.info("%s: %s", what, shown)
        return setting.ready_at
