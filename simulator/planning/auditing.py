"""Audit the error bounds of a plan by rendering with what it leaves out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import torch

from optics.caching import ByteCache
from simulator.planning.effect import Bound, Effect, ratio
from simulator.planning.effect_plan import EffectPlan, build_recipe
from simulator.recipe import Recipe
from simulator.situation import Situation

Rendered = tuple[torch.Tensor, torch.Tensor]
Levels = Mapping[str, int]
Others = Literal["as planned", "finest"]


@dataclass(frozen=True)
class AuditResult:
    """The measured change of a picture between an effect's planned and finest level.

    Parameters
    ----------
    effects : tuple of str
        Names of the one or two effects that were set to their finest level.
    others : {"as planned", "finest"}
        Levels of all other effects.
    bound : Bound
        Largest change that the plan states: the effects' bounds, or their estimates.
    mean, variance, sigma : float
        L2 norms of the changes of the mean picture in electrons, of the variance map in electrons²,
        and of the map of standard deviations in electrons.
    slack : Bound
        Largest difference of two renderings by rounding alone; it is added to `bound`.
    """

    effects: tuple[str, ...]
    others: Others
    bound: Bound
    mean: float
    variance: float
    sigma: float
    slack: Bound

    @property
    def measured_over_bound(self) -> float:
        """Return the largest measured change over the stated one, which fails above 1."""
        allowed = self.bound.plus(self.slack)
        measured = (self.mean, allowed.mean), (self.variance, allowed.variance)
        return max(ratio(*one) for one in (*measured, (self.sigma, allowed.sigma)))

    @property
    def is_broken(self) -> bool:
        return self.measured_over_bound > 1


def audit(
    effects: Sequence[Effect],
    situation: Situation,
    plan: EffectPlan,
    render: Callable[[Recipe], Rendered],
    *,
    pairs: Iterable[tuple[str, str]] | None = None,
) -> tuple[AuditResult, ...]:
    """Compare the errors that a plan states with the measured changes of pictures.

    Each effect that the plan has below its finest level is set to its finest level, once with the
    other effects as planned, and once with the others at their finest. Pairs of such effects are
    tried with the others as planned, and compared with the sum of their errors. Effects that they
    require are switched on with them.

    Parameters
    ----------
    effects : sequence of Effect
        All effects that the simulator knows.
    situation : Situation
        Scene, camera, pattern, filter and exposure.
    plan : EffectPlan
        The plan to be audited.
    render : callable
        Renders a Recipe, and returns its mean and variance maps, (rows, columns) in electrons and
        electrons².
    pairs : iterable of tuple of str, optional
        Pairs of effect names to be tried; all pairs by default.

    Returns
    -------
    tuple of AuditResult
        One result for each comparison.

    Raises
    ------
    ValueError
        If a pair contains an effect that the plan has at its finest level, or not at all.
    """
    auditor = _Auditor(effects, situation, plan, render)
    singles = [
        auditor.audit((name,), others)
        for name in auditor.coarse_effects
        for others in get_args(Others)
    ]
    wanted = itertools.combinations(auditor.coarse_effects, 2) if pairs is None else pairs
    return (*singles, *(auditor.audit(pair, "as planned") for pair in wanted))


class _Auditor:
    """Compare pictures, and cache those with which many others are compared."""

    def __init__(
        self,
        effects: Sequence[Effect],
        situation: Situation,
        plan: EffectPlan,
        render: Callable[[Recipe], Rendered],
    ) -> None:
        self._effects = {one.name: one for one in effects if one.is_present(situation)}
        self._s, self._render, self._plan = situation, render, plan
        self._finest = {name: one.finest_level(situation) for name, one in self._effects.items()}
        self._kept = ByteCache(2**30)
        self.coarse_effects = [
            name for name in self._finest if plan.level(name) < self._finest[name]
        ]

    def audit(self, names: tuple[str, ...], others: Others) -> AuditResult:
        for name in names:
            if name not in self.coarse_effects:
                raise ValueError(
                    f"the plan has {name!r} at its finest, or not at all; audit one of "
                    f"{', '.join(self.coarse_effects) or 'none'}"
                )
        planned = self._plan.levels
        around = dict(planned if others == "as planned" else self._finest)
        # Effects that the bounds of others assume are on, unless they are audited themselves.
        around |= {
            name: self._finest[name]
            for name, one in self._effects.items()
            if one.assumed_by_other_bounds
        }
        low = {name: planned[name] for name in names}
        high = {name: self._finest[name] for name in names}
        coarse, fine = self._with_requirements({**around, **low}, {**around, **high}, names)
        mean, variance = self._picture(coarse)
        best_mean, best_variance = self._picture(fine)
        return AuditResult(
            names,
            others,
            self._stated_error(names, coarse),
            _norm(best_mean - mean),
            _norm(best_variance - variance),
            _norm(best_variance.sqrt() - variance.sqrt()),
            _rounding_bound(mean, variance),
        )

    def _stated_error(self, names: tuple[str, ...], coarse: Levels) -> Bound:
        """Sum the stated errors of the named effects, and of those that they refine."""
        levels = {
            refined: coarse[refined]
            for name in names
            for refined in self._effects[name].refines
            if refined in self._effects
        } | {name: self._plan.level(name) for name in names}
        total = Bound()
        for name, level in levels.items():
            total = total.plus(self._effects[name].error(self._s, level, self._plan.decided_by))
        return total

    def _with_requirements(
        self, coarse: dict[str, int], fine: dict[str, int], names: tuple[str, ...]
    ) -> tuple[dict[str, int], dict[str, int]]:
        """Complete two sets of levels, so that all effects' requirements are met.

        Effects that an effect above off requires are set to their finest level. Effects that
        require one that is off are switched off. Effects that aren't audited get the same level in
        both sets.
        """
        for levels in (fine, coarse):
            for name in self._all_required(levels):
                if name not in names:
                    coarse[name] = fine[name] = self._finest[name]
        for one in self._effects.values():
            if one.name not in names and any(not coarse.get(need, 1) for need in one.requires):
                coarse[one.name] = fine[one.name] = 0
        return coarse, fine

    def _all_required(self, levels: Levels) -> list[str]:
        """Return the effects that are off although others that are on require them."""
        missing: list[str] = []
        queue = [one for name, one in self._effects.items() if levels[name]]
        while queue:
            for need in queue.pop().requires:
                if need in self._effects and not levels[need] and need not in missing:
                    missing.append(need)
                    queue.append(self._effects[need])
        return missing

    def _picture(self, levels: Levels) -> Rendered:
        """Render mean and variance maps at given levels, as float64."""
        recipe = build_recipe(tuple(self._effects.values()), self._s, levels)
        mean, variance = self._kept.get(recipe, lambda: self._render(recipe))
        return mean.to(torch.float64), variance.to(torch.float64)


def _rounding_bound(mean: torch.Tensor, variance: torch.Tensor) -> Bound:
    """Bound the rounding errors of two pictures, a millionth of their own norms.

    The rounding of Fourier transforms is as large in dark pixels as in bright ones, and changes the
    standard deviation most in dark pixels.
    """
    rounding = Bound(1e-6 * _norm(mean), 1e-6 * _norm(variance))
    most, least = rounding.mean + rounding.variance, math.sqrt(float(variance.min()))
    dark = most / (2 * least) if least else math.sqrt(most * math.sqrt(mean.numel()))
    return replace(rounding, sigma=dark)


def _norm(change: torch.Tensor) -> float:
    return float(torch.linalg.vector_norm(change))
