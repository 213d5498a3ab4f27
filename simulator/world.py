"""The physical state that the simulated devices share, and the light that follows from it."""

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
from optics.validation import require_positive
from simulator.clock import VirtualClock
from simulator.faults import Fault, FaultScript
from simulator.imaging import MEMORY, Imaging
from simulator.mount import Mount
from simulator.panel_content import PanelContent
from simulator.planning import EffectPlan
from simulator.planning.effect_plan import EFFECTS_SHARE
from simulator.scene import Scene
from simulator.situation import Situation
from simulator.streaming import FrameSimulator

TYPICAL_EXPOSURE = 0.01
"""Seconds for which a plan is made where nobody says another exposure."""


class World:
    """What the panel shows, the filter passes and the target sends, and what follows.

    camera: what it really is, whatever its users think. scene: its targets. tol: relative error
    of mean picture and noise that effects may be left out for. forced: effects that are on or
    off, or at a level, whatever they change. mount: how the panel sits before the sensor. path:
    what polariser, panel and splitter do to the light, where that is known. clock: of the bench.
    faults: what will go wrong with its devices. memory: bytes that are kept for later pictures.
    The devices write what is shown, `band` and `target`; pictures are computed from them, and
    only when they have changed.
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
        memory: int = MEMORY,
    ) -> None:
        self.camera, self.scene = camera, scene
        self.mount, self.path = mount or Mount(), path
        self.imaging = Imaging(tol, memory=memory)
        self.clock: Clock = clock or VirtualClock()
        self.faults = FaultScript(faults)
        self.band = Band(550e-9, 7e-9)
        self.target = next(iter(scene.targets))
        self.begin_frame(0, 0, 0)
        self.grey = np.zeros(camera.panel.shape, dtype=np.uint8)
        self.force(forced or {})

    def force(self, forced: Mapping[str, str | bool]) -> None:
        """Have effects on (True), off (False) or at a level by its name, whatever they change.

        Raises ValueError, now and not at the first picture, for an effect that doesn't exist, a
        level that it hasn't, or one that is on and requires one that is off.
        """
        self.imaging.force(forced, self.situation())

    def forget(self) -> None:
        """Give up the pictures that were computed, and what was found out on the way."""
        self.imaging.forget()

    @property
    def wavelength(self) -> float:
        """Metres, of the filter's centre."""
        return self.band.centre

    @wavelength.setter
    def wavelength(self, wavelength: float) -> None:
        self.band = replace(self.band, centre=wavelength)

    @property
    def bandwidth(self) -> float:
        """Metres, of the filter at half maximum."""
        return self.band.fwhm

    @bandwidth.setter
    def bandwidth(self, bandwidth: float) -> None:
        self.band = replace(self.band, fwhm=bandwidth)

    def begin_frame(
        self, run: int, step: int, frame: int, *, index: int = 0, start_time: float = 0
    ) -> None:
        """A frame of a run is about to be taken: its chance and its time follow from this alone.

        index: of the planned frame. start_time: seconds of the plan at which its exposure begins.
        """
        self._seed, self._draws = [run, step, frame], 0
        self.faults.frame, self._exposure_start = index, start_time

    def random_generator(self) -> torch.Generator:
        """Chance for one picture; each that is asked for is another one."""
        state = np.random.SeedSequence([*self._seed, self._draws]).generate_state(2)
        self._draws += 1
        return torch.Generator().manual_seed(int(state[0]) << 31 ^ int(state[1]))

    @property
    def grey(self) -> NDArray[np.uint8]:
        """What the panel shows, (rows, columns); of a video, its first frame."""
        return self._panel_content.first

    @grey.setter
    def grey(self, grey: NDArray[np.uint8]) -> None:
        self.play(grey[None], math.inf)

    def play(self, video: NDArray[np.uint8], frame_time: float) -> None:
        """Show frames (n, rows, columns) in turn for `frame_time` seconds each."""
        self._panel_content = PanelContent.of(video, frame_time)

    def situation(self, exposure: float = TYPICAL_EXPOSURE) -> Situation:
        """All that a picture of an exposure in seconds follows from, as things stand.

        Raises ValueError for an exposure that isn't positive and finite.
        """
        require_positive("exposure", exposure, "s")
        return Situation(
            self.camera,
            self.mount,
            self.scene.targets[self.target],
            self.band,
            self._panel_content,
            self._exposure_start,
            exposure,
            self.path,
            numerics=max((1 - EFFECTS_SHARE) * self.imaging.tol, 1e-5),
        )

    def effect_plan(
        self,
        pattern: NDArray[np.uint8],
        wavelength: float,
        exposure: float = TYPICAL_EXPOSURE,
        target: str | None = None,
        bandwidth: float | None = None,
    ) -> EffectPlan:
        """What a pattern, or a video (n, rows, columns) at the panel's rate, calls for.

        target, bandwidth: those that are there now if None. Nothing is rendered.
        """
        frames = pattern if pattern.ndim == 3 else pattern[None]
        video = PanelContent.of(
            frames, 1 / self.camera.panel.frame_rate if len(frames) > 1 else math.inf
        )
        asked = replace(
            self.situation(exposure),
            panel_content=video,
            band=replace(self.band, centre=wavelength, fwhm=bandwidth or self.bandwidth),
            target=self.scene.targets[target or self.target],
        )
        return self.imaging.plan(asked)

    def radiance(self, wavelengths: NDArray[np.float64]) -> NDArray[np.float64]:
        """W/(sr m² m) of what is white in the target, at wavelengths in metres (n,).

        Seen through the filter where it passes best, as by an instrument behind it.
        """
        lit = self.scene.targets[self.target].reflected_radiance()
        light: NDArray[np.float64] = lit.at(wavelengths) * self.band.total_transmission(wavelengths)
        return light

    def electron_rates(
        self, exposure: float = TYPICAL_EXPOSURE, check: Callable[[], None] = lambda: None
    ) -> tuple[torch.Tensor, EffectPlan]:
        """Photo-electrons per second on each pixel, (rows, columns) float32, and the plan.

        It is the mean over an exposure in seconds, which matters when anything moves.
        check: is called between the steps of a long computation, and may raise.
        """
        # The devices may be set anew while the light of this state is still computed.
        s, plan = self._situation_and_plan(exposure, check)
        return self.imaging.electrons(s, plan.recipe, check) / exposure, plan

    def stream(
        self, exposure: float, check: Callable[[], None] = lambda: None
    ) -> tuple[FrameSimulator, EffectPlan]:
        """What draws frames of an exposure, as things stand, and the plan."""
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
