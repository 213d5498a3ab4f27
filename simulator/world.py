"""The physical state that the simulated devices share, and the light that follows from it."""

from __future__ import annotations

import hashlib
import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from drivers.interfaces import Clock
from optics.camera import Camera, Sensor
from optics.formation import form_image
from optics.light import electron_rate
from optics.plane import Plane
from optics.psf import PSFOperator, nyquist_samples
from optics.pupil import blur_radius
from optics.slm import grey_to_phase
from simulator.clock import VirtualClock
from simulator.effects import EffectPlan, Situation, decide, phase_spread
from simulator.faults import Fault, FaultScript
from simulator.scene import Scene

T = TypeVar("T")

_FINER = 2
"""Samples per sensor pixel of the rendered light, at least."""

_TO_SPARE = 1.05
"""Over the samples that resolve the PSF's finest fringe: the filter's band reaches below
its centre."""

_SMALLEST_WINDOW, _LARGEST_WINDOW = 256, 1024
"""Sensor pixels across the rendered PSF; what falls beyond is lost to the picture."""

_WINDOW_STEP = 64

_WINDOW_MARGIN = 128
"""Sensor pixels around the light that geometric optics predicts, for its diffraction."""

_EVEN = 1e-4
"""Share of an exposure by which it may miss whole periods of a video and show its frames
evenly: cameras count whole microseconds."""


class _Cache:
    """The last few results, by what they follow from."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._kept: OrderedDict[Hashable, object] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, causes: Hashable, compute: Callable[[], T]) -> T:
        with self._lock:
            if causes in self._kept:
                self._kept.move_to_end(causes)
                return self._kept[causes]  # type: ignore[return-value]
        # A camera that was given up may still compute when the next one does.
        result = compute()
        with self._lock:
            self._kept[causes] = result
            while len(self._kept) > self._size:
                self._kept.popitem(last=False)
        return result


def _name(grey: NDArray[np.uint8]) -> str:
    """Patterns with the same grey levels have the same name."""
    return hashlib.sha256(grey.tobytes()).hexdigest()


@dataclass(frozen=True, eq=False)
class _Shown:
    """What the panel shows: names of frames in their order, and seconds that each stands.

    pictures: the different frames by name.
    """

    names: tuple[str, ...]
    pictures: Mapping[str, NDArray[np.uint8]]
    frame_time: float

    @staticmethod
    def of(video: NDArray[np.uint8], frame_time: float) -> _Shown:
        # Named once, when it is shown, and not for every picture that is taken of it.
        names = tuple(_name(grey) for grey in video)
        pictures: dict[str, NDArray[np.uint8]] = {}
        for name, grey in zip(names, video, strict=True):
            if name not in pictures:
                pictures[name] = grey.copy()
                pictures[name].flags.writeable = False
        return _Shown(names, pictures, frame_time)

    @property
    def first(self) -> NDArray[np.uint8]:
        return self.pictures[self.names[0]]

    def during(self, start: float, seconds: float) -> tuple[tuple[str, float], ...]:
        """The share of a time that each picture has, by name; of no time, that it has of all."""
        n = len(self.names)
        periods = seconds / (n * self.frame_time)
        if n == 1 or seconds == 0 or abs(periods - round(periods)) <= _EVEN * round(periods):
            shares: tuple[float, ...] = (1.0,) * n
        else:
            shares = shares_of_time(n, start / self.frame_time, periods * n)
        # In whichever order the pictures come.
        mixed = dict.fromkeys(sorted(self.pictures), 0.0)
        for name, share in zip(self.names, shares, strict=True):
            mixed[name] += share
        total = sum(mixed.values())
        return tuple((name, share / total) for name, share in mixed.items())


@dataclass(frozen=True)
class _State:
    """All that a picture's light follows from, as it was when the picture was begun.

    seen: names of what was on the panel, and the share of the exposure that each has.
    """

    seen: tuple[tuple[str, float], ...]
    wavelength: float
    bandwidth: float
    target: str


def shares_of_time(n: int, start: float, length: float) -> tuple[float, ...]:
    """What each of `n` frames, shown in turn for a unit of time each, has of an interval."""

    def shown_until(time: float) -> NDArray[np.float64]:
        """Time for which each frame was shown since 0."""
        rounds, rest = divmod(time, n)
        return rounds + np.clip(rest - np.arange(n), 0, 1)

    seen = shown_until(start % n + length) - shown_until(start % n)
    return tuple((seen / seen.sum()).tolist())


@dataclass(frozen=True)
class _Grid:
    """Where light is rendered: a PSF `window` sensor pixels wide, `finer` samples a pixel."""

    window: int
    finer: int

    @property
    def samples(self) -> int:
        return self.window * self.finer

    def plane(self, sensor: Sensor) -> Plane:
        """The sensor with a margin of half a PSF around it."""
        rows, columns = (n + self.window for n in sensor.shape)
        return sensor.window((rows, columns)).finer(self.finer)

    def psf_plane(self, sensor: Sensor) -> Plane:
        """Of a point's light, around its geometric image."""
        return sensor.window((self.window, self.window)).finer(self.finer)


class World:
    """What the panel shows, the filter passes and the target sends, and what follows.

    camera: the description of the camera. scene: its targets. tol: relative L2 error of
    the mean picture that effects may be left out for. forced: effects that are on or off
    whatever their size. clock: of the bench. faults: what will go wrong with its devices.
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
        self._operators = _Cache(8)
        self._psfs = _Cache(8)
        self._spectra = _Cache(4)
        self._lights = _Cache(8)
        self._spreads = _Cache(16)
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
        self._shown = _Shown.of(video, frame_time)

    def effect_plan(self, shown: NDArray[np.uint8], wavelength: float) -> EffectPlan:
        """What a pattern, or a video (n, rows, columns), at a wavelength calls for."""
        frames = shown if shown.ndim == 3 else shown[None]
        spread = max(self._spread(_name(grey), grey, wavelength) for grey in frames)
        return self._effect_plan(spread, wavelength, self.bandwidth)

    def _effect_plan(self, spread: float, wavelength: float, bandwidth: float) -> EffectPlan:
        situation = Situation(self.camera, wavelength, bandwidth, spread)
        return decide(situation, self.tol, self.forced)

    def _spread(self, name: str, grey: NDArray[np.uint8], wavelength: float) -> float:
        """Radius in metres to which a pattern sends light."""

        def compute() -> float:
            phase = torch.from_numpy(grey_to_phase(self.camera.panel, grey, wavelength))
            return phase_spread(self.camera, phase, wavelength)

        return self._spreads.get((name, wavelength), compute)

    def light(
        self, exposure: float = 0.0, check: Callable[[], None] = lambda: None
    ) -> tuple[torch.Tensor, EffectPlan]:
        """Photo-electrons per second on each pixel, (rows, columns) float32, and the plan.

        It is the mean over an exposure in seconds, which matters when a video is shown.
        check: is called between the steps of a long computation, and may raise.
        """
        shown = self._shown
        seen = shown.during(self._moment, exposure)
        # The devices may be set anew while the light of this state is still computed.
        state = _State(seen, self.wavelength, self.bandwidth, self.target)
        return self._lights.get(state, lambda: self._form(state, shown.pictures, check))

    def _form(
        self, state: _State, pictures: Mapping[str, NDArray[np.uint8]], check: Callable[[], None]
    ) -> tuple[torch.Tensor, EffectPlan]:
        wavelength, bandwidth = state.wavelength, state.bandwidth
        spread = max(self._spread(name, grey, wavelength) for name, grey in pictures.items())
        plan = self._effect_plan(spread, wavelength, bandwidth)
        target = self.scene.targets[state.target]
        rate = electron_rate(self.camera, target.radiance, bandwidth, wavelength)
        if rate == 0:
            return torch.zeros(self.camera.sensor.shape), plan
        grid = self._grid(target.distance, spread, wavelength)
        plane = grid.plane(self.camera.sensor)
        psf = self._psfs.get(
            (state.seen, wavelength, bandwidth, target.distance),
            lambda: self._psf(state, pictures, target.distance, grid, plan, check),
        )
        check()
        spectrum = self._spectra.get(
            (state.target, wavelength, grid),
            lambda: target.spectrum(plane, self.camera, wavelength),
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
        return (shares * per_sample).clamp(min=0).to(torch.float32), plan

    def _grid(self, distance: float, spread: float, wavelength: float) -> _Grid:
        """Fine enough for the finest fringe, and wide enough for the light of a point.

        Light that a wild pattern scatters beyond the largest window is lost. Raises
        ValueError if defocus alone goes beyond it.
        """
        camera = self.camera
        finer = max(_FINER, math.ceil(_TO_SPARE * nyquist_samples(camera, wavelength)))
        pitch = camera.sensor.pitch
        blurred = 2 * blur_radius(camera, distance) / pitch + _WINDOW_MARGIN
        if blurred > _LARGEST_WINDOW:
            raise ValueError(
                f"a point at {distance:g} m is blurred over {blurred:.0f} pixels and "
                f"{_LARGEST_WINDOW} can be rendered; bring it closer to the plane in focus, "
                f"{camera.lens.focus_distance:g} m"
            )
        window = min(max(blurred + 2 * spread / pitch, _SMALLEST_WINDOW), _LARGEST_WINDOW)
        return _Grid(_WINDOW_STEP * math.ceil(window / _WINDOW_STEP), finer)

    def _psf(
        self,
        state: _State,
        pictures: Mapping[str, NDArray[np.uint8]],
        distance: float,
        grid: _Grid,
        plan: EffectPlan,
        check: Callable[[], None],
    ) -> torch.Tensor:
        """Of a point: the mean over what is seen, and over the filter's band."""
        psf = torch.zeros(grid.samples, grid.samples)
        for wavelength, weight in self._band(state, plan["filter bandwidth"].nodes):
            operator = self._operator(distance, wavelength, grid, plan)
            for name, share in state.seen:
                if share == 0:
                    continue
                check()
                grey = torch.from_numpy(pictures[name].copy())
                phase = grey_to_phase(self.camera.panel, grey, wavelength)
                psf += weight * share * operator(phase).to(psf)
        return psf

    def _band(self, state: _State, nodes: int) -> list[tuple[float, float]]:
        """Gauss-Hermite wavelengths and weights of the filter's Gaussian band."""
        x, weights = np.polynomial.hermite.hermgauss(nodes)
        sigma = state.bandwidth / (2 * math.sqrt(2 * math.log(2)))
        wavelengths = state.wavelength + math.sqrt(2) * sigma * x
        return list(zip(wavelengths.tolist(), (weights / weights.sum()).tolist(), strict=True))

    def _operator(
        self, distance: float, wavelength: float, grid: _Grid, plan: EffectPlan
    ) -> PSFOperator:
        share = self.camera.panel.unmodulated if plan.is_on("unmodulated light") else 0.0
        return self._operators.get(
            (distance, wavelength, share, grid),
            lambda: PSFOperator(
                self.camera,
                distance,
                wavelength,
                grid.psf_plane(self.camera.sensor),
                integrate=False,
                unmodulated=share,
                tol=max(self.tol, 1e-5),
            ),
        )
