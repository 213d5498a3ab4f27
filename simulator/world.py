"""The physical state that the simulated devices share, and the light that follows from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from drivers.interfaces import Clock
from optics.camera import Camera
from optics.formation import form_image
from optics.light import electron_rate
from simulator.caching import Cache
from simulator.clock import VirtualClock
from simulator.deciding import Decided, Decider
from simulator.effects import EffectPlan
from simulator.effects.video import CRYSTAL
from simulator.faults import Fault, FaultScript
from simulator.grid import grid_for
from simulator.motion import Pictures
from simulator.mount import Mount
from simulator.rendering import Renderer
from simulator.scene import Scene, Target
from simulator.shown import Mixture, Procession, Shown


@dataclass(frozen=True)
class _State:
    """All that a picture's light follows from, as it was when the picture was begun.

    seen: what was on the panel during the exposure.
    """

    seen: Mixture | Procession
    wavelength: float
    bandwidth: float
    target: str


class World:
    """What the panel shows, the filter passes and the target sends, and what follows.

    camera: what it really is, whatever its users think. scene: its targets. tol: relative L2
    error of the mean picture that effects may be left out for. forced: effects that are on or
    off whatever their size. mount: how the panel sits before the sensor. clock: of the bench.
    faults: what will go wrong with its devices.
    The devices write what is shown, `wavelength`, `bandwidth` and `target`; `light()` is
    computed from them, and only when they have changed.
    """

    def __init__(
        self,
        camera: Camera,
        scene: Scene,
        *,
        tol: float = 1e-2,
        forced: Mapping[str, bool] | None = None,
        mount: Mount | None = None,
        clock: Clock | None = None,
        faults: Iterable[Fault] = (),
    ) -> None:
        self.camera, self.scene, self.tol = camera, scene, tol
        self.forced = dict(forced or {})
        self.clock: Clock = clock or VirtualClock()
        self.faults = FaultScript(faults)
        self.wavelength = 550e-9
        self.bandwidth = 7e-9
        self.target = next(iter(scene.targets))
        for target in scene.targets.values():
            _spectrum(target)
        self._decide = Decider(camera, tol, self.forced)
        self._renderer = Renderer(camera, mount or Mount(), tol)
        self._psfs = Cache(8)
        self._spectra = Cache(4)
        self._lights = Cache(8)
        self.begin(0, 0, 0)
        self.grey = np.zeros(camera.panel.shape, dtype=np.uint8)
        # Wrong settings shall be heard of now, not at the first picture.
        self.effect_plan(self.grey, self.wavelength)

    def begin(self, run: int, step: int, frame: int, *, index: int = 0, moment: float = 0) -> None:
        """A frame of a run is about to be taken: its chance and its time follow from this alone.

        index: of the planned frame. moment: seconds of the plan at which its exposure begins.
        """
        self._seed, self._draws = [run, step, frame], 0
        self.faults.frame, self._moment = index, moment

    def chance(self) -> torch.Generator:
        """Chance for one picture; each that is asked for is another one."""
        state = np.random.SeedSequence([*self._seed, self._draws]).generate_state(2)
        self._draws += 1
        return torch.Generator().manual_seed(int(state[0]) << 31 ^ int(state[1]))

    @property
    def grey(self) -> NDArray[np.uint8]:
        """What the panel shows, (rows, columns); of a video, its first frame."""
        return self._shown.first

    @grey.setter
    def grey(self, grey: NDArray[np.uint8]) -> None:
        self.play(grey[None], math.inf)

    def play(self, video: NDArray[np.uint8], frame_time: float) -> None:
        """Show frames (n, rows, columns) in turn for `frame_time` seconds each."""
        self._shown = Shown.of(video, frame_time)

    def effect_plan(self, shown: NDArray[np.uint8], wavelength: float) -> EffectPlan:
        """What a pattern, or a video (n, rows, columns) at the panel's rate, calls for."""
        frames = shown if shown.ndim == 3 else shown[None]
        video = Shown.of(frames, 1 / self.camera.panel.frame_rate)
        return self._decide(video, wavelength, self.bandwidth).plan

    def light(
        self, exposure: float = 0.0, check: Callable[[], None] = lambda: None
    ) -> tuple[torch.Tensor, EffectPlan]:
        """Photo-electrons per second on each pixel, (rows, columns) float32, and the plan.

        It is the mean over an exposure in seconds, which matters when a video is shown.
        check: is called between the steps of a long computation, and may raise.
        """
        shown = self._shown
        # The devices may be set anew while the light of this state is still computed.
        wavelength, bandwidth, target = self.wavelength, self.bandwidth, self.target
        moment = self._moment
        decided = self._decide(shown, wavelength, bandwidth)
        moves = shown.moves and decided.plan.is_on(CRYSTAL)
        seen = (shown.procession if moves else shown.mixture)(moment, exposure)
        state = _State(seen, wavelength, bandwidth, target)
        light = self._lights.get(state, lambda: self._form(state, decided, shown.pictures, check))
        return light, decided.plan

    def _form(
        self, state: _State, decided: Decided, pictures: Pictures, check: Callable[[], None]
    ) -> torch.Tensor:
        wavelength, bandwidth, plan = state.wavelength, state.bandwidth, decided.plan
        target = self.scene.targets[state.target]
        rate = electron_rate(
            self._renderer.camera, target.radiance, bandwidth, wavelength, target.distance
        )
        if rate == 0:
            return torch.zeros(self.camera.sensor.shape)
        grid = grid_for(self.camera, target.distance, decided.spread, wavelength)
        plane = grid.plane(self.camera.sensor)
        psf = self._psfs.get(
            (state.seen, wavelength, bandwidth, target.distance),
            lambda: self._renderer.psf(
                state.seen,
                pictures,
                _band(wavelength, bandwidth, plan["filter bandwidth"].nodes),
                plan.panel(self.camera.panel),
                target.distance,
                grid,
                check,
            ),
        )
        check()
        spectrum = self._spectra.get(
            (state.target, wavelength, grid),
            lambda: _spectrum(target)(plane, self.camera, wavelength),
        )
        check()
        shares = form_image(
            spectrum,
            psf,
            plane,
            grid.finer,
            self.camera.sensor.shape,
            pixel_aperture=plan.is_on("pixel aperture"),
        )
        per_sample = rate * plane.pitch[0] * plane.pitch[1]
        return (shares * per_sample).clamp(min=0).to(torch.float32)


def _band(centre: float, bandwidth: float, nodes: int) -> list[tuple[float, float]]:
    """Gauss-Hermite wavelengths and weights of the filter's Gaussian band."""
    x, weights = np.polynomial.hermite.hermgauss(nodes)
    sigma = bandwidth / (2 * math.sqrt(2 * math.log(2)))
    wavelengths = centre + math.sqrt(2) * sigma * x
    return list(zip(wavelengths.tolist(), (weights / weights.sum()).tolist(), strict=True))


def _spectrum(target: Target) -> Callable[..., torch.Tensor]:
    """What gives a target's light at one wavelength; ValueError for one of layers or parts."""
    found: Callable[..., torch.Tensor] | None = getattr(target, "spectrum", None)
    if found is None:
        raise ValueError(
            f"a target of the kind {type(target).__name__.lower()} can't be rendered by a run yet; "
            "take a star, a flat field or a photograph"
        )
    return found
