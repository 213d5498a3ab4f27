"""All plans for a situation, from everything at its finest to everything off, one inside the next.

Which effect goes down next is decided without knowing any tolerance: the one that saves most work
for what it may change, but that a dear one lets cheaper ones go first. A tolerance says only how
far down to go. So a larger one never adds work, a smaller one never removes an effect, and what
all steps change at most is the sum of their bounds, whichever effects meet (each holds whatever
the others are).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from simulator.planning.bound import Bound, MinimumNorms
from simulator.planning.cached_work import CachedWork
from simulator.planning.effect import Effect
from simulator.planning.forcing import resolve_forced_levels
from simulator.situation import Situation

_FRAMES = 100
"""Of a picture, that are thought to be taken: what each of them takes counts as often."""

_PATIENCE = 0.5
"""Of its own price, for which a step lets cheaper ones go first."""


@dataclass(frozen=True)
class LadderStep:
    """One step down: an effect to a coarser level.

    bound: what that changes at most beyond what it did before. saved_work: operations of a
    picture that it saves, as often as `repetitions` says.
    """

    effect: str
    to: int
    bound: Bound
    relative_error: float
    saved_work: float
    repetitions: int = 1

    @property
    def key(self) -> tuple[str, int]:
        return self.effect, self.to

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Free steps come first, then those that save most for their price, then the cheapest."""
        free, saved = self.relative_error == 0, self.saved_work * self.repetitions
        return free, saved if free else saved / self.relative_error, -self.relative_error


class Ladder:
    """The steps from the top, for the effects that a situation causes.

    effects: in the order of the physics. forced_levels: of effects that somebody has forced; they
    stay there, and cost nothing of what a tolerance allows. What requires one that is forced off
    is off with it. Raises ValueError where it is forced to another level.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        situation: Situation,
        norms: MinimumNorms,
        forced_levels: Mapping[str, int] | None = None,
    ) -> None:
        self.effects = [one for one in effects if one.is_present(situation)]
        finest = {one.name: one.finest_level(situation) for one in self.effects}
        self.forced_levels = {
            name: min(level, finest[name])
            for name, level in resolve_forced_levels(self.effects, forced_levels or {}).items()
        }
        self._named = {one.name: one for one in self.effects}
        self._floor = norms
        self._bounds = {
            one.name: [one.error_bound(situation, level) for level in range(finest[one.name] + 1)]
            for one in self.effects
        }
        self._works = {one.name: CachedWork(one, situation) for one in self.effects}
        self.finest_levels = finest | self.forced_levels
        self.steps = tuple(self._walk_down())

    def work(self, levels: Mapping[str, int]) -> float:
        """Operations of a picture."""
        return sum(work(levels) for work in self._works.values())

    def levels(self, tol: float) -> dict[str, int]:
        """As far down as the sum of all bounds keeps within a tolerance."""
        levels, spent = dict(self.finest_levels), Bound()
        for step in self.steps:
            spent = spent.plus(step.bound)
            if self._floor.relative_error(spent) > tol:
                break
            levels[step.effect] = step.to
        return levels

    def error_bound(self, levels: Mapping[str, int]) -> Bound:
        """What a plan changes at most, forced effects included."""
        total = Bound()
        for name, level in levels.items():
            total = total.plus(self._bounds[name][level])
        return total

    def effect_error_bound(self, effect: str, level: int) -> Bound:
        """What one effect changes at a level, at most."""
        return self._bounds[effect][level]

    def relative_error(self, bound: Bound) -> float:
        return self._floor.relative_error(bound)

    def _walk_down(self) -> Iterator[LadderStep]:
        """What others save shrinks while any goes down, for work is made of products: so what
        was found earlier is only looked at again where it seems to be the next."""
        levels = dict(self.finest_levels)
        self.work(levels)
        known = {one.name: list(self._steps_of(one, levels)) for one in self.effects}
        fresh, waited = set(known), dict[tuple[str, int], float]()
        while True:
            taken = _next([step for steps in known.values() for step in steps], waited)
            if not taken:
                return
            *_, step = taken
            if step.effect not in fresh:
                known[step.effect] = list(self._steps_of(self._named[step.effect], levels))
                fresh.add(step.effect)
                continue
            yield step
            for before in taken[:-1]:
                waited[before.key] = waited.get(before.key, 0.0) + step.relative_error
            levels[step.effect] = step.to
            fresh.clear()
            for name in (step.effect, *self._named[step.effect].requires):
                if name in known:
                    known[name] = list(self._steps_of(self._named[name], levels))

    def _steps_of(self, one: Effect, levels: dict[str, int]) -> Iterator[LadderStep]:
        """One effect's steps down, over one level or several."""
        name, now = one.name, levels[one.name]
        if name in self.forced_levels or not now:
            return
        touched = [work for work in self._works.values() if name in work.levels_read]
        bounds, before = self._bounds[name], sum(work(levels) for work in touched)
        for to in range(now):
            if to == 0 and self._is_required(name, levels):
                continue
            levels[name] = to
            saved = max(before - sum(work(levels) for work in touched), 0.0)
            levels[name] = now
            more = bounds[to].minus(bounds[now])
            often = _FRAMES if one.is_per_frame else 1
            yield LadderStep(name, to, more, self._floor.relative_error(more), saved, often)

    def _is_required(self, name: str, levels: Mapping[str, int]) -> bool:
        """Whether an effect that is still on requires this one."""
        return any(name in one.requires and levels[one.name] for one in self.effects)


def _next(steps: Sequence[LadderStep], waited: Mapping[tuple[str, int], float]) -> list[LadderStep]:
    """The step to be taken, at the end of those that let it go first; empty without any steps.

    The best ranked would keep all tolerances below its price from sparing anything: so cheaper
    ones go before it, the best ranked first, as far as its patience goes, and among them again.
    waited: prices that each step has let go before it.
    """
    order: list[LadderStep] = []
    limit = math.inf
    while fitting := [step for step in steps if step.relative_error <= limit and step not in order]:
        best = max(fitting, key=lambda step: step.rank)
        order.append(best)
        limit = _PATIENCE * best.relative_error - waited.get(best.key, 0.0)
    return order
