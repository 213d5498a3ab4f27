"""Compares pictures that an effect plan simplifies with those with all effects on."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import torch

from simulator.effects.electron_bounds import without_clipping
from simulator.effects.registry import EFFECTS
from simulator.imaging import Imaging, PictureMoments
from simulator.planning import EffectPlan
from simulator.planning.effect_plan import EFFECTS_SHARE, build_recipe
from simulator.situation import Situation

REFERENCE_TOL = 1e-5
"""Relative error of arithmetic and sampling in the reference picture with all effects."""


@dataclass(frozen=True)
class Deviation:
    """Relative L2 errors of a picture: of its mean, variance and standard deviation."""

    mean: float
    variance: float
    sigma: float

    @staticmethod
    def of(picture: PictureMoments, reference: PictureMoments) -> Deviation:
        return Deviation(
            _relative_error(picture.mean, reference.mean),
            _relative_error(picture.variance, reference.variance),
            _relative_error(picture.variance.sqrt(), reference.variance.sqrt()),
        )

    @property
    def worst(self) -> float:
        return max(self.mean, self.variance, self.sigma)


@dataclass(frozen=True)
class RenderedPicture:
    """A picture and its cost: counted operations and seconds of processor time.

    planning_cpu: the part of cpu that was spent on the effect plan.
    """

    picture: PictureMoments
    operations: float
    cpu: float
    planning_cpu: float
    plan: EffectPlan | None = None


def render_by_plan(
    s: Situation, tol: float, check: Callable[[], None] = lambda: None
) -> RenderedPicture:
    """Form a picture by the effect plan of a tolerance, without clipping of full wells.

    Nothing is cached beforehand, so that the cost includes the planning.
    """
    imaging = Imaging(tol)
    own = replace(s, numerics=max((1 - EFFECTS_SHARE) * tol, REFERENCE_TOL))
    began = time.process_time()
    plan = imaging.plan(own)
    decided = time.process_time()
    picture = imaging.picture_moments(own, without_clipping(own, plan.recipe), check)
    ended = time.process_time()
    operations = imaging.ledger.operations
    return RenderedPicture(picture, operations, ended - began, decided - began, plan)


def render_all_effects(
    s: Situation, check: Callable[[], None] = lambda: None,
    finer: Mapping[str, int] | None = None,
) -> RenderedPicture:  # fmt: skip
    """Form a picture with every effect at its finest level, without clipping of full wells.

    finer: levels that are finer than this situation needs, by effect.
    """
    imaging, own = Imaging(0.0), replace(s, numerics=REFERENCE_TOL)
    recipe = without_clipping(own, build_recipe(EFFECTS, own, finest_levels(own, finer)))
    began = time.process_time()
    picture = imaging.picture_moments(own, recipe, check)
    return RenderedPicture(picture, imaging.ledger.operations, time.process_time() - began, 0.0)


def deviation_in_the_middle(
    s: Situation, plan: EffectPlan, side: int = 96, check: Callable[[], None] = lambda: None
) -> Deviation:
    """Compare a picture's middle with the same with all effects on, for part of the whole's work.

    side: of the middle in sensor pixels.
    """
    sensor = s.camera.sensor
    rows, columns = (min(n, side) for n in sensor.shape)
    middle = replace(sensor, shape=(rows, columns))
    part = replace(s, camera=replace(s.camera, sensor=middle))
    recipe = without_clipping(part, plan.recipe)
    picture = Imaging(plan.tol).picture_moments(part, recipe, check)
    return Deviation.of(picture, render_all_effects(part, check).picture)


def finest_levels(s: Situation, finer: Mapping[str, int] | None = None) -> dict[str, int]:
    """Return the finest level of each effect that is present.

    finer: effects to add, and levels that replace coarser ones.
    """
    levels = {one.name: one.finest_level(s) for one in EFFECTS if one.is_present(s)}
    return levels | {name: max(level, levels.get(name, 0)) for name, level in (finer or {}).items()}


def _relative_error(value: torch.Tensor, truth: torch.Tensor) -> float:
    change, whole = (float(torch.linalg.vector_norm(one)) for one in (value - truth, truth))
    return change / whole if whole else float(change > 0)
