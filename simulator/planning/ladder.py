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

from simulator.planning.bound import Bound, Floor
from simulator.planning.costing import Work
from simulator.planning.effect import Effect
from simulator.planning.forcing import settled
from simulator.situation import Situation

_FRAMES = 100
"""Of a picture, that are thought to be taken: what each of them takes counts as often."""

_PATIENCE = 0.5
"""Of its own price, for which a step lets cheaper ones go first."""


@dataclass(frozen=True)
class Step:
    """One step down: an effect to a coarser level, what that changes at most beyond what it did
    before, the same relative, and the operations that it saves, of a picture and of each of its
    frames."""

    effect: str
    to: int
    bound: Bound
    price: float
    saved: float
    often: int = 1

    @property
    def key(self) -> tuple[str, int]:
        return self.effect, self.to

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Free steps come first, then those that save most for their price, then the cheapest."""
        free, saved = self.price == 0, self.saved * self.often
        return free, saved if free else saved / self.price, -self.price


class Ladder:
    """The steps from the top, for the effects that a situation causes.

    effects: in the order of the physics. fixed: levels of effects that somebody has forced; they
    stay there, and cost nothing of what a tolerance allows. What requires one that is forced off
    is off with it. Raises ValueError where it is forced to another level.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        situation: Situation,
        floor: Floor,
        fixed: Mapping[str, int] | None = None,
    ) -> None:
        self.effects = [one for one in effects if one.caused(situation)]
        finest = {one.name: one.finest(situation) for one in self.effects}
        self.fixed = {
            name: min(level, finest[name])
            for name, level in settled(self.effects, fixed or {}).items()
        }
        self._named = {one.name: one for one in self.effects}
        self._floor = floor
        self._bounds = {
            one.name: [one.bound(situation, level) for level in range(finest[one.name] + 1)]
            for one in self.effects
        }
        self._works = {one.name: Work(one, situation) for one in self.effects}
        self.top = finest | self.fixed
        self.steps = tuple(self._walked())

    def work(self, levels: Mapping[str, int]) -> float:
        """Operations of a picture."""
        return sum(work(levels) for work in self._works.values())

    def levels(self, tol: float) -> dict[str, int]:
        """As far down as the sum of all bounds keeps within a tolerance."""
        levels, spent = dict(self.top), Bound()
        for step in self.steps:
            spent = spent.plus(step.bound)
            if self._floor.relative(spent) > tol:
                break
            levels[step.effect] = step.to
        return levels

    def bound(self, levels: Mapping[str, int]) -> Bound:
        """What a plan changes at most, forced effects included."""
        total = Bound()
        for name, level in levels.items():
            total = total.plus(self._bounds[name][level])
        return total

    def bound_of(self, effect: str, level: int) -> Bound:
        """What one effect changes at a level, at most."""
        return self._bounds[effect][level]

    def relative(self, bound: Bound) -> float:
        return self._floor.relative(bound)

    def _walked(self) -> Iterator[Step]:
        """What others save shrinks while any goes down, for work is made of products: so what
        was found earlier is only looked at again where it seems to be the next."""
        levels = dict(self.top)
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
                waited[before.key] = waited.get(before.key, 0.0) + step.price
            levels[step.effect] = step.to
            fresh.clear()
            for name in (step.effect, *self._named[step.effect].requires):
                if name in known:
                    known[name] = list(self._steps_of(self._named[name], levels))

    def _steps_of(self, one: Effect, levels: dict[str, int]) -> Iterator[Step]:
        """One effect's steps down, over one level or several."""
        name, now = one.name, levels[one.name]
        if name in self.fixed or not now:
            return
        touched = [work for work in self._works.values() if name in work.looked_at]
        bounds, before = self._bounds[name], sum(work(levels) for work in touched)
        for to in range(now):
            if to == 0 and self._needed(name, levels):
                continue
            levels[name] = to
            saved = max(before - sum(work(levels) for work in touched), 0.0)
            levels[name] = now
            more = bounds[to].minus(bounds[now])
            often = _FRAMES if one.each_frame else 1
            yield Step(name, to, more, self._floor.relative(more), saved, often)

    def _needed(self, name: str, levels: Mapping[str, int]) -> bool:
        """Whether an effect that is still on requires this one."""
        return any(name in one.requires and levels[one.name] for one in self.effects)


def _next(steps: Sequence[Step], waited: Mapping[tuple[str, int], float]) -> list[Step]:
    """The step to be taken, at the end of those that let it go first; empty without any steps.

    The best ranked would keep all tolerances below its price from sparing anything: so cheaper
    ones go before it, the best ranked first, as far as its patience goes, and among them again.
    waited: prices that each step has let go before it.
    """
    order: list[Step] = []
    limit = math.inf
    while fitting := [step for step in steps if step.price <= limit and step not in order]:
        best = max(fitting, key=lambda step: step.rank)
        order.append(best)
        limit = _PATIENCE * best.price - waited.get(best.key, 0.0)
    return order
