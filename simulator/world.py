"""The virtual bench's physical state, which the simulated devices share, and its pictures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from drivers.interfaces import Clock
from optics.camera import Camera
from optics.light.bands import Band
from optics.polarisation import PathEffect
from optics.sensor import sensor_as_read
from optics.validation import require_positive
from simulator.clock import VirtualClock
from simulator.faults import Fault, FaultScript
from simulator.imaging import Imaging, default_memory
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.planning import EffectPlan
from simulator.planning.effect import DecidedBy
from simulator.planning.effect_plan import EFFECTS_SHARE
from simulator.scene import Scene
from simulator.situation import Situation
from simulator.streaming import FrameSimulator

TYPICAL_EXPOSURE = 0.01
"""Exposure time in seconds that an effect plan assumes unless another one is given."""


def countable_exposure(exposure: float) -> float:
    """Return the exposure time in seconds that a camera takes for the given one.

    Cameras count whole microseconds. An exposure that is too short for any stays as it is.
    """
    return round(exposure * 1e6) / 1e6 or exposure


class World:
    """The state of a virtual bench: what the panel shows, the filter passes and the target sends.

    camera: the real one, which may differ from its description. tol: relative error of mean picture
    and noise up to which effects may be left out. forced: effects to be on, off or at a level,
    whatever error that makes. path: what polariser, panel and splitter do to the light, where
    known. memory: bytes kept for later pictures; default_memory() if None. decide_by: bounds or
    estimates decide which effects are left out. effective_index: of the filter's thin films, where
    it isn't what the filter is described with. The devices set the panel's content, `band`,
    `target` and `gain_db`. Pictures are computed from these, and only when something has changed.
    """

    def __init__(
        self,
        camera: Camera,
        scene: Scene,
        *,
        tol: float = 1e-2,
        forced: Mapping[str, str | bool] | None = None,
        mount: Mount | None = None,
        path: PathEffect | None = None,
        clock: Clock | None = None,
        faults: Iterable[Fault] = (),
        memory: int | None = None,
        decide_by: DecidedBy = "bound",
        effective_index: float | None = None,
    ) -> None:
        self.camera, self.scene = camera, scene
        self.mount, self.path = mount or Mount(), path
        self._effective_index = effective_index
        memory = default_memory(camera) if memory is None else memory
        self.imaging = Imaging(tol, memory=memory, decide_by=decide_by)
        self.clock: Clock = clock or VirtualClock()
        self.faults = FaultScript(faults)
        self.is_picture_unwanted: Callable[[], bool] = lambda: False
        """Function that is called between the steps of a picture, which ends if it returns true."""
        self.band = Band(550e-9, 7e-9)
        self.gain_db = 0.0
        """Amplification of the camera's signal, beyond what its description has, in decibels."""
        self.target = next(iter(scene.targets))
        self.begin_frame(0, 0, 0)
        self.grey = np.zeros(camera.panel.shape, dtype=np.uint8)
        self.force(forced or {})

    def force(self, forced: Mapping[str, str | bool]) -> None:
        """Force effects on (True), off (False) or to a named level, whatever error that causes.

        Raises ValueError at once for an effect or level that doesn't exist, or for an effect that
        is on and requires one that is off.
        """
        self.imaging.force(forced, self.situation())

    def forget(self) -> None:
        """Remove computed pictures and intermediate results from the caches."""
        self.imaging.forget()

    @property
    def wavelength(self) -> float:
        """Return the centre of the filter's band, in metres."""
        return self.band.centre

    @wavelength.setter
    def wavelength(self, wavelength: float) -> None:
        self.band = replace(self.band, centre=wavelength)

    @property
    def bandwidth(self) -> float:
        """Return the full width at half maximum of the filter's band in metres."""
        return self.band.fwhm

    @bandwidth.setter
    def bandwidth(self, bandwidth: float) -> None:
        self.band = replace(self.band, fwhm=bandwidth)

    def begin_frame(
        self, run: int, step: int, frame: int, *, index: int = 0, start_time: float = 0
    ) -> None:
        """Begin a frame of a run; these numbers alone set its noise and its time.

        index: of the planned frame. start_time: seconds of the plan at which its exposure begins.
        """
        self._seed, self._draws = [run, step, frame], 0
        self.faults.frame, self._exposure_start = index, start_time

    def random_generator(self) -> torch.Generator:
        """Return the random generator for one picture, a new one at each call."""
        state = np.random.SeedSequence([*self._seed, self._draws]).generate_state(2)
        self._draws += 1
        return torch.Generator().manual_seed(int(state[0]) << 31 ^ int(state[1]))

    @property
    def grey(self) -> NDArray[np.uint8]:
        """Return the panel's grey levels (rows, columns); for a video, those of its first frame."""
        return self._panel_content.first

    @grey.setter
    def grey(self, grey: NDArray[np.uint8]) -> None:
        self.play(grey[None], math.inf)

    def play(self, video: NDArray[np.uint8], frame_time: float) -> None:
        """Show a video's frames in turn on the panel, each for `frame_time` seconds.

        video: (n, rows, columns).
        """
        self._panel_content = PanelContent.of(video, frame_time)

    def situation(self, exposure: float = TYPICAL_EXPOSURE) -> Situation:
        """Return the situation of a picture that is taken now.

        Raises ValueError for an exposure in seconds that isn't positive and finite.
        """
        require_positive("exposure", exposure, "s")
        numerics = max((1 - EFFECTS_SHARE) * self.imaging.tol, 1e-5)
        return Situation(
            self._amplified_camera(self.gain_db), self.mount, self.scene.targets[self.target],
            self._true_band(self.band), self._panel_content, self._exposure_start, exposure,
            self.path, numerics,
        )  # fmt: skip

    def effect_plan(
        self,
        pattern: NDArray[np.uint8],
        wavelength: float,
        exposure: float = TYPICAL_EXPOSURE,
        target: str | None = None,
        bandwidth: float | None = None,
        gain_db: float | None = None,
    ) -> EffectPlan:
        """Return the effect plan for a pattern or video on the panel; nothing is rendered.

        A video is (n, rows, columns) and is shown at the panel's frame rate. exposure: as a camera
        is asked for it. target, bandwidth, gain_db: the present ones if None.
        """
        frames = pattern if pattern.ndim == 3 else pattern[None]
        band = replace(self.band, centre=wavelength, fwhm=bandwidth or self.bandwidth)
        asked = replace(
            self.situation(countable_exposure(exposure)),
            camera=self._amplified_camera(self.gain_db if gain_db is None else gain_db),
            panel_content=PanelContent.of(frames, 1 / self.camera.panel.frame_rate),
            band=self._true_band(band),
            target=self.scene.targets[target or self.target],
        )
        return self.imaging.plan(asked)

    def _true_band(self, band: Band) -> Band:
        """Return a filter's band with the effective index that it really has."""
        if self._effective_index is None:
            return band
        return replace(band, effective_index=self._effective_index)

    def _amplified_camera(self, gain_db: float) -> Camera:
        """Return the camera with a gain in decibels beyond its description's."""
        if not gain_db:
            return self.camera
        sensor = sensor_as_read(self.camera.sensor, amplification_db=gain_db)
        return replace(self.camera, sensor=sensor)

    def radiance(self, wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the radiance of the target's white parts through the filter, W/(sr m² m).

        wavelengths: metres, (n,). The filter's transmission is 1 at its peak.
        """
        lit = self.scene.targets[self.target].reflected_radiance()
        light: NDArray[np.float64] = lit.at(wavelengths) * self.band.total_transmission(wavelengths)
        return light

    def electron_rates(
        self, exposure: float = TYPICAL_EXPOSURE, check: Callable[[], None] = lambda: None
    ) -> tuple[torch.Tensor, EffectPlan]:
        """Return the photo-electrons per second on each pixel, and the effect plan.

        The rates are (rows, columns) float32, means over an exposure in seconds. check: is called
        between the steps of a long computation, and may raise.
        """
        # The situation is a snapshot: devices may change the state during the computation.
        s, plan = self._situation_and_plan(exposure, check)
        return self.imaging.electrons(s, plan.recipe, check) / exposure, plan

    def stream(
        self, exposure: float, check: Callable[[], None] = lambda: None
    ) -> tuple[FrameSimulator, EffectPlan]:
        """Return a frame simulator for the present situation, and the effect plan."""
        s, plan = self._situation_and_plan(exposure, check)
        return self.imaging.stream(s, plan, check), plan

    def _situation_and_plan(
        self, exposure: float, check: Callable[[], None]
    ) -> tuple[Situation, EffectPlan]:
        s = self.situation(exposure)
        check()
        plan = self.imaging.plan(s)
        check()
        return s, plan
