"""From a situation to its plan, and by the plan to its picture, with what is kept in between."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass

import torch

from optics.sensor import moments
from simulator.caching import ByteCache, Cache
from simulator.effects.registry import EFFECTS
from simulator.formation import expected
from simulator.ledger import Ledger
from simulator.planning import EffectPlan
from simulator.planning.plan import planned
from simulator.probing.floor import floor
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.streaming import Stream

MEMORY = 2 << 30
"""Bytes of light, spectra and kernels that are kept because they may be asked for again."""


@dataclass(frozen=True)
class Picture:
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
        if not 0 <= tol < math.inf:
            raise ValueError(f"tol is {tol:g}; it must be finite and not negative")
        self.tol, self.forced = tol, dict(forced or {})
        self.ledger = Ledger()
        self._cache, self._plans, self._streams = ByteCache(memory), Cache(256), Cache(2)

    def plan(self, s: Situation) -> EffectPlan:
        """What a picture calls for."""
        return self._plans.get(
            causes(s), lambda: planned(EFFECTS, s, floor(s), self.tol, self.forced)
        )

    def electrons(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> torch.Tensor:
        """That light frees on each pixel over the exposure, in the mean, (rows, columns)."""
        return expected(s, recipe, self._cache, self.ledger, check)

    def picture(
        self, s: Situation, recipe: Recipe, check: Callable[[], None] = lambda: None
    ) -> Picture:
        """Mean and variance of every pixel."""
        electrons = self.electrons(s, recipe, check)
        mean, variance = moments(electrons, s.exposure, s.camera.sensor, **asdict(recipe.stages))
        return Picture(electrons, mean, variance)

    def stream(
        self, s: Situation, plan: EffectPlan, check: Callable[[], None] = lambda: None
    ) -> Stream:
        """Frames of a picture; what they share is kept while nothing changes."""

        def compute() -> Stream:
            recipe = plan.recipe
            electrons = self.electrons(s, recipe, check)
            return Stream(electrons, s.exposure, s.camera.sensor, recipe)

        return self._streams.get((causes(s), tuple(plan.levels.items())), compute)


def causes(s: Situation) -> Hashable:
    """All that a picture follows from; the time only where something changes with it."""
    changes = s.shown.moves or s.target.moves or s.target.lamp is not None
    beats = complex(s.path.interference) if s.path else 0j
    return (
        s.camera,
        s.mount,
        s.target,
        s.band,
        (s.shown.names, s.shown.frame_time),
        s.moment if changes else 0.0,
        s.exposure,
        beats,
        s.numerics,
    )
