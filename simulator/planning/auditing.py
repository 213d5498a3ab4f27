"""Whether bounds hold: what a plan leaves out is switched on, singly and in pairs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import torch

from optics.caching import ByteCache
from simulator.planning.bound import Bound, ratio
from simulator.planning.effect import Effect
from simulator.planning.effect_plan import EffectPlan, build_recipe
from simulator.recipe import Recipe
from simulator.situation import Situation

Rendered = tuple[torch.Tensor, torch.Tensor]
Levels = Mapping[str, int]
Pairs = Iterable[tuple[str, str]]

_CACHE_BYTES = 2**30
"""Bytes of pictures. Those that others are compared with are asked for often, and stay."""

_ARITHMETIC = 1e-6
"""Of a picture's own norms, what two renderings may differ by without a cause."""


@dataclass(frozen=True)
class AuditResult:
    """One or two effects at their finest against what the plan has of them.

    others: whether all others were as the plan has them, or at their finest. bound: the most
    that the change may be. mean, variance, sigma: L2 norms of what it was, in the same units.
    """

    effects: tuple[str, ...]
    others: Literal["as planned", "finest"]
    bound: Bound
    mean: float
    variance: float
    sigma: float
    slack: Bound

    @property
    def measured_over_bound(self) -> float:
        """The largest of what was measured over its bound; above 1 the bound is broken."""
        allowed = self.bound.plus(self.slack)
        return max(
            ratio(getattr(self, name), getattr(allowed, name))
            for name in ("mean", "variance", "sigma")
        )

    @property
    def is_broken(self) -> bool:
        return self.measured_over_bound > 1


def audit(
    effects: Sequence[Effect],
    situation: Situation,
    plan: EffectPlan,
    render: Callable[[Recipe], Rendered],
    *,
    pairs: Pairs | None = None,
) -> tuple[AuditResult, ...]:
    """Every effect that a plan has below its finest, and every pair of them, against its bound.

    render: gives mean and variance maps of a recipe, (rows, columns) in electrons and
    electrons². Effects are switched by themselves with the others as planned, and with the
    others at their finest; pairs with the others as planned, against the sum of their bounds.
    What they require is switched with the rest. pairs: those to be tried; all by default.
    Raises ValueError for a pair of which the plan has one at its finest.
    """
    bench = _AuditRenderer(effects, situation, plan, render)
    singles = [
        bench.audit_effects((name,), others)
        for name in bench.coarse_effects
        for others in ("as planned", "finest")
    ]
    wanted = itertools.combinations(bench.coarse_effects, 2) if pairs is None else pairs
    return (*singles, *(bench.audit_effects(pair, "as planned") for pair in wanted))


class _AuditRenderer:
    """Where plans are rendered; what many are compared with, once."""

    def __init__(
        self,
        effects: Sequence[Effect],
        situation: Situation,
        plan: EffectPlan,
        render: Callable[[Recipe], Rendered],
    ) -> None:
        self._effects = {one.name: one for one in effects if one.is_present(situation)}
        self._s, self._render, self._planned = situation, render, plan.levels
        self._finest = {name: one.finest_level(situation) for name, one in self._effects.items()}
        self._kept = ByteCache(_CACHE_BYTES)
        self.coarse_effects = [
            name for name in self._finest if plan.level(name) < self._finest[name]
        ]

    def audit_effects(
        self, names: tuple[str, ...], others: Literal["as planned", "finest"]
    ) -> AuditResult:
        for name in names:
            if name not in self.coarse_effects:
                raise ValueError(
                    f"the plan has {name!r} at its finest, or not at all; audit one of "
                    f"{', '.join(self.coarse_effects) or 'none'}"
                )
        around = dict(self._planned if others == "as planned" else self._finest)
        # What bounds count on is there, but for its own.
        around |= {
            name: self._finest[name]
            for name, one in self._effects.items()
            if one.assumed_by_other_bounds
        }
        low = {name: self._planned[name] for name in names}
        high = {name: self._finest[name] for name in names}
        coarse, fine = self._with_requirements({**around, **low}, {**around, **high}, names)
        mean, variance = self._picture(coarse)
        best_mean, best_variance = self._picture(fine)
        bound = Bound()
        for name in names:
            bound = bound.plus(self._effects[name].error_bound(self._s, self._planned[name]))
        return AuditResult(
            names,
            others,
            bound,
            _norm(best_mean - mean),
            _norm(best_variance - variance),
            _norm(best_variance.sqrt() - variance.sqrt()),
            _rounding_bound(mean, variance),
        )

    def _with_requirements(
        self, coarse: dict[str, int], fine: dict[str, int], names: tuple[str, ...]
    ) -> tuple[dict[str, int], dict[str, int]]:
        """Both with what is required: what is switched on brings it, what can't be without one
        that is off goes; whatever isn't switched is the same in both."""
        for levels in (fine, coarse):
            for name in self._all_required(levels):
                if name not in names:
                    coarse[name] = fine[name] = self._finest[name]
        for one in self._effects.values():
            if one.name not in names and any(not coarse.get(need, 1) for need in one.requires):
                coarse[one.name] = fine[one.name] = 0
        return coarse, fine

    def _all_required(self, levels: Levels) -> list[str]:
        missing: list[str] = []
        queue = [one for name, one in self._effects.items() if levels[name]]
        while queue:
            for need in queue.pop().requires:
                if need in self._effects and not levels[need] and need not in missing:
                    missing.append(need)
                    queue.append(self._effects[need])
        return missing

    def _picture(self, levels: Levels) -> Rendered:
        recipe = build_recipe(tuple(self._effects.values()), self._s, levels)
        mean, variance = self._kept.get(recipe, lambda: self._render(recipe))
        return mean.to(torch.float64), variance.to(torch.float64)


def _rounding_bound(mean: torch.Tensor, variance: torch.Tensor) -> Bound:
    """What transforms leave of rounding: as much in the dark as in the light, where it counts for
    the most of σ."""
    most = _ARITHMETIC * _norm(mean) + _ARITHMETIC * _norm(variance)
    least = math.sqrt(float(variance.min()))
    dark = most / (2 * least) if least else math.sqrt(most * math.sqrt(mean.numel()))
    return Bound(_ARITHMETIC * _norm(mean), _ARITHMETIC * _norm(variance), dark)


def _norm(change: torch.Tensor) -> float:
    return float(torch.linalg.vector_norm(change))
