"""From what is shown to the effects that it calls for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from optics.camera import Camera
from simulator.caching import Cache
from simulator.effects import EffectPlan, Pattern, Situation, decide
from simulator.effects.panel import sizes_of
from simulator.effects.video import CRYSTAL, crystal_size
from simulator.shown import Shown


@dataclass(frozen=True)
class _Estimates:
    """spread: radius in metres to which light is sent. sizes: of the panel's effects."""

    spread: float
    sizes: Mapping[str, float]


@dataclass(frozen=True)
class Decided:
    """What is done for something that is shown; spread: metres to which it sends light."""

    plan: EffectPlan
    spread: float


class Decider:
    """Looks at patterns once, and decides which effects they call for behind a camera.

    tol: relative L2 error of the mean picture that effects may be left out for. forced:
    effects that are on or off whatever their size.
    """

    def __init__(self, camera: Camera, tol: float, forced: Mapping[str, bool]) -> None:
        self._camera, self._tol, self._forced = camera, tol, dict(forced)
        self._pictures = Cache(256)
        self._videos = Cache(8)

    def __call__(self, shown: Shown, wavelength: float, bandwidth: float) -> Decided:
        """A video calls for what its most demanding frame calls for."""
        known = self._videos.get(
            (shown.names, shown.frame_time, wavelength), lambda: self._estimates(shown, wavelength)
        )
        situation = Situation(self._camera, wavelength, bandwidth, known.spread, known.sizes)
        return Decided(decide(situation, self._tol, self._forced), known.spread)

    def _estimates(self, shown: Shown, wavelength: float) -> _Estimates:
        all_of_them = [self._look(shown, name, wavelength) for name in shown.pictures]
        sizes: dict[str, float] = {}
        for estimates in all_of_them:
            for effect, size in estimates.sizes.items():
                sizes[effect] = max(size, sizes.get(effect, 0.0))
        if shown.moves and self._camera.panel.response_time:
            patterns = (self._pattern(shown, name, wavelength) for name in shown.names)
            sizes[CRYSTAL] = crystal_size(self._camera.panel, patterns, shown.frame_time)
        return _Estimates(max(e.spread for e in all_of_them), sizes)

    def _look(self, shown: Shown, name: str, wavelength: float) -> _Estimates:
        def compute() -> _Estimates:
            pattern = self._pattern(shown, name, wavelength)
            return _Estimates(pattern.spread, sizes_of(pattern, self._tol))

        return self._pictures.get((name, wavelength), compute)

    def _pattern(self, shown: Shown, name: str, wavelength: float) -> Pattern:
        return Pattern(self._camera, torch.from_numpy(shown.pictures[name].copy()), wavelength)
