"""From a situation to its plan, and by the plan to its picture, with what is kept in between."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass, replace

import torch

from optics.caching import ByteCache
from optics.sensor import moments
from optics.slm import max_phase
from simulator.caching import Cache
from simulator.effects.picture_norms import minimum_norms
from simulator.effects.registry import EFFECTS
from simulator.formation import expected_electrons
from simulator.ledger import Ledger
from simulator.planning import EffectPlan
from simulator.planning.effect_plan import plan_effects, require_tolerance
from simulator.planning.forcing import forced_level, resolve_forced_levels
from simulator.probing.pattern_probe import PatternProbe
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.streaming import FrameSimulator

MEMORY = max(1 << 30, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 4)
"""Bytes of light, spectra and kernels that are kept because they may be asked for again: a quarter
of what the machine has. A picture of 5 megapixels with the panel's orders has 2.5 GB of them."""


_PATTERNS = 3
"""Patterns of which is kept what is known."""


@dataclass(frozen=True)
class PictureMoments:
    """What a sensor makes of light, without any chance, (rows, columns).

    electrons: that the light frees on each pixel over the exposure, in the mean. mean, variance:
    of each pixel's number less its black level, in electrons and electrons².
    """

    electrons: torch.Tensor
    mean: torch.Tensor
    variance: torch.Tensor


class Imaging:
    """Plans and pictures of situations.

    tol: relative error of mean picture and noise that effects may be left out for. forced:
    effects that are on or off, or at a level, whatever they change. memory: bytes to keep.
    Raises ValueError for a tol that is negative or not finite.
    """

    def __init__(
        self,
        tol: float = 1e-2,
        forced: Mapping[str, str | bool] | None = None,
        memory: int = MEMORY,
    ) -> None:
        require_tolerance(tol)
        self.tol, self.forced = tol, dict(forced or {})
        self.ledger = Ledger()
        self._cache, self._plans, self._streams = ByteCache(memory), Cache(256), Cache(2)
        self._pictures, self._patterns = Cache(4), Cache(_PATTERNS)

    def with_tolerance(self, tol: float) -> Imaging:
        """The same to another tolerance, with nothing forced; the two share what is kept."""
        require_tolerance(tol)
        other = copy.copy(self)
        other.tol, other.forced = tol, {}
        return other

    def forget(self) -> None:
        """Keep nothing that was computed; it is computed again when it is asked for."""
        for cache in (self._cache, self._plans, self._streams, self._pictures, self._patterns):
            cache.clear()

    def force(self, forced: Mapping[str, str | bool], s: Situation) -> None:
        """Have effects on, off or at a level from now on, whatever they change.

        Raises ValueError for an effect that doesn't exist, a level that it hasn't, or one that
        is on and requires one that is off. Nothing is planned for that.
        """
        levels = {name: forced_level(EFFECTS, s, name, wanted) for name, wanted in forced.items()}
        resolve_forced_levels(EFFECTS, levels)
        self.forced = dict(forced)

    def plan(self, s: Situation) -> EffectPlan:
        """What a picture calls for; ValueError for a filter where the panel isn't known."""
        max_phase(s.camera.panel, s.wavelength)
        # Whoever has changed the two wants another plan.
        tol, forced = self.tol, dict(self.forced)
        return self._plans.get(
            (tol, tuple(sorted(forced.items())), picture_key(s)),
            lambda: self._compute_plan(s, tol, forced),
        )

    def _compute_plan(
        self, s: Situation, tol: float, forced: Mapping[str, str | bool]
    ) -> EffectPlan:
        self._attach_probes(s)
        return plan_effects(EFFECTS, s, minimum_norms(s), tol, forced)

    def _attach_probes(self, s: Situation) -> None:
        """Let a situation know what is known already of its picture and its pattern, which
        don't follow from the exposure."""
        picture = self._pictures.get(
            (s.target, s.camera, s.band, s.picture_probe.shift), lambda: s.picture_probe
        )
        s.cache.picture_probe = picture
        shown = (s.panel_content.names, s.panel_content.frame_time)
        looked_at = (s.camera, shown, s.wavelength, picture.distances)
        s.cache.pattern_probe = self._patterns.get(
            looked_at,
            lambda: PatternProbe(
                s.camera, s.panel_content, s.wavelength, picture.distances, self._cache
            ),
        )

    def electrons(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> torch.Tensor:
        """That light frees on each pixel over the exposure, in the mean, (rows, columns)."""
        return expected_electrons(s, recipe, self._cache, self.ledger, check)

    def picture_moments(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> PictureMoments:
        """Mean and variance of every pixel."""
        electrons = self.electrons(s, recipe, check)
        mean, variance = moments(electrons, s.exposure, s.camera.sensor, **asdict(recipe.stages))
        return PictureMoments(electrons, mean, variance)

    def stream(
        self, s: Situation, plan: EffectPlan, check: Callable[[], None] = lambda: None
    ) -> FrameSimulator:
        """Frames of a picture; what they share is kept while nothing changes."""

        def compute() -> FrameSimulator:
            recipe = plan.recipe
            electrons = self.electrons(s, recipe, check)
            return FrameSimulator(electrons, s.exposure, s.camera.sensor, recipe)

        return self._streams.get((picture_key(s), tuple(plan.levels.items())), compute)


def picture_key(s: Situation) -> Hashable:
    """All that a picture follows from; the time only where something changes with it."""
    changes = s.panel_content.is_changing or s.target.lamp is not None
    beats = complex(s.path.interference) if s.path else 0j
    return (
        s.camera,
        s.mount,
        s.target,
        # Devices count in hundredths of a nanometre; the last digit is nobody's.
        replace(s.band, centre=round(s.band.centre, 14)),
        (s.panel_content.names, s.panel_content.frame_time),
        s.exposure_start if changes else 0.0,
        s.exposure,
        beats,
        s.numerics,
    )
