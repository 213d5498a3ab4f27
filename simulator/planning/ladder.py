"""Order all choices of levels in a ladder, from all effects at their finest to all off.

The order of the steps doesn't depend on the tolerance. The next step is that of the effect which
saves most work for its error bound, except that a step with a large bound lets steps with smaller
bounds go first. The tolerance only decides how many steps are taken. So a larger tolerance never
adds work, and a smaller tolerance never removes an effect. The error of several steps is at most
the sum of their bounds, because each bound holds for any levels of the other effects.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from simulator.planning.effect import Bound, DecidedBy, Effect, MinimumNorms, resolve_forced_levels
from simulator.situation import Situation


class _RecordingLevels(Mapping[str, int]):
    """Effect levels that record the names of those that are read, in order."""

    def __init__(self, levels: Mapping[str, int]) -> None:
        self._levels = levels
        self.names: dict[str, None] = {}

    def __getitem__(self, name: str) -> int:
        level = self._levels[name]
        self.names[name] = None
        return level

    def __iter__(self) -> Iterator[str]:
        return iter(self._levels)

    def __len__(self) -> int:
        return len(self._levels)


class _CachedWork:
    """The operations of one effect as a cached function of the levels of all effects.

    The operations depend only on the levels that the effect reads, and are cached by these.
    names_read: of all effects whose level was read so far, in order.
    """

    def __init__(self, effect: Effect, situation: Situation) -> None:
        self._effect, self._s = effect, situation
        self._kept: dict[tuple[int, ...], float] = {}
        self.names_read: dict[str, None] = {}

    def __call__(self, levels: Mapping[str, int]) -> float:
        known = self._kept.get(tuple([levels[name] for name in self.names_read]))
        if known is not None:
            return known
        watched = _RecordingLevels(levels)
        work = self._effect.added_operations(self._s, watched)
        if not watched.names.keys() <= self.names_read.keys():
            self.names_read |= watched.names
            self._kept.clear()
        self._kept[tuple([levels[name] for name in self.names_read])] = work
        return work


_FRAMES = 100  # number of frames assumed per picture: work per frame counts this often. Chosen.

# Share of a step's own error for which it lets steps with smaller errors go first. Chosen.
_PATIENCE = 0.5


class LadderStep(NamedTuple):
    """One step down, which sets an effect to a coarser level."""

    effect: str
    to: int  # the new level
    bound: Bound  # largest change beyond that at the level before
    relative_error: float  # the same relative to the picture's norms
    saved_work: float  # operations, which count `repetitions` times for the step's rank
    repetitions: int = 1

    @property
    def key(self) -> tuple[str, int]:
        return self.effect, self.to

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Return the sort key of the step; the best step has the largest.

        Steps without error come first, then those that save most work for their error, then those
        with the least error.
        """
        free, saved = self.relative_error == 0, self.saved_work * self.repetitions
        return free, saved if free else saved / self.relative_error, -self.relative_error


class Ladder:
    """The steps from all effects at their finest to all effects off, for a situation.

    Parameters
    ----------
    effects : sequence of Effect
        All effects that the simulator knows, in the order of the physics.
    situation : Situation
        Scene, camera, pattern, filter and exposure.
    norms : MinimumNorms
        Norms of the picture, which errors are relative to: lower bounds, or estimates.
    forced_levels : mapping of str to int, optional
        Levels of effects that a user forced. They are fixed, and their errors don't count against
        the tolerance. Effects that require one that is forced off are off as well.
    decided_by : {"bound", "estimate"}
        Whether the errors are bounds or estimates.

    Attributes
    ----------
    effects : list of Effect
        The effects that occur in the situation.
    forced_levels, finest_levels : dict of str to int
        The forced levels, and the levels at the top of the ladder.
    steps : tuple of LadderStep
        The steps from the top of the ladder down.

    Raises
    ------
    ValueError
        If an effect is forced on that requires one that is forced off.
    """

    def __init__(
        self,
        effects: Sequence[Effect],
        situation: Situation,
        norms: MinimumNorms,
        forced_levels: Mapping[str, int] | None = None,
        decided_by: DecidedBy = "bound",
    ) -> None:
        self.effects = [one for one in effects if one.is_present(situation)]
        finest = self._finest = {one.name: one.finest_level(situation) for one in self.effects}
        self.forced_levels = {
            name: min(level, finest[name])
            for name, level in resolve_forced_levels(self.effects, forced_levels or {}).items()
        }
        self._named = {one.name: one for one in self.effects}
        self._norms = norms
        self._errors: dict[tuple[str, int], Bound] = {}
        self._situation, self._decided_by = situation, decided_by
        self._works = {one.name: _CachedWork(one, situation) for one in self.effects}
        self.finest_levels = finest | self.forced_levels

    @functools.cached_property
    def steps(self) -> tuple[LadderStep, ...]:
        return tuple(self._walk_down())

    def work(self, levels: Mapping[str, int]) -> float:
        """Return the operations of rendering a picture at given levels."""
        return sum(work(levels) for work in self._works.values())

    def levels(self, tol: float) -> dict[str, int]:
        """Return the coarsest levels on the ladder that keep a tolerance.

        The bounds of all steps down to these levels are summed. Steps farther down aren't found.
        """
        levels, spent = dict(self.finest_levels), Bound()
        for step in self._walk_down():
            spent = spent.plus(step.bound)
            if self._norms.relative_error(spent) > tol:
                break
            levels[step.effect] = step.to
        return levels

    def error(self, levels: Mapping[str, int]) -> Bound:
        """Return the error at given levels, forced effects included."""
        total = Bound()
        for name, level in levels.items():
            total = total.plus(self.effect_error(name, level))
        return total

    def effect_error(self, effect: str, level: int) -> Bound:
        """Return the error of one effect at a level."""
        if level >= self._finest[effect]:
            return Bound()
        if (effect, level) not in self._errors:
            self._errors[effect, level] = self._named[effect].error(
                self._situation, level, self._decided_by
            )
        return self._errors[effect, level]

    def relative_error(self, bound: Bound) -> float:
        return self._norms.relative_error(bound)

    def _walk_down(self) -> Iterator[LadderStep]:
        """Yield the steps to coarser levels, from the top of the ladder down.

        The work is a sum of products, so every step down reduces what other steps save. The savings
        of an effect's steps are therefore upper bounds, and are computed again only when one of the
        steps would be the next.
        """
        levels = dict(self.finest_levels)
        self.work(levels)
        known = {one.name: list(self._steps_of(one, levels)) for one in self.effects}
        fresh, waited = set(known), dict[tuple[str, int], float]()
        while True:
            taken = _next_steps([step for steps in known.values() for step in steps], waited)
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
        """Yield the steps down that one effect may take now, over one or several levels."""
        name, now = one.name, levels[one.name]
        if name in self.forced_levels or not now:
            return
        touched = [work for work in self._works.values() if name in work.names_read]
        before = sum(work(levels) for work in touched)
        # An effect that others require, which are still on, can't be off.
        is_required = any(name in other.requires and levels[other.name] for other in self.effects)
        for to in range(int(is_required), now):
            levels[name] = to
            saved = max(before - sum(work(levels) for work in touched), 0.0)
            levels[name] = now
            more = self.effect_error(name, to).minus(self.effect_error(name, now))
            often = _FRAMES if one.is_per_frame else 1
            yield LadderStep(name, to, more, self._norms.relative_error(more), saved, often)


def _next_steps(
    steps: Sequence[LadderStep], waited: Mapping[tuple[str, int], float]
) -> list[LadderStep]:
    """List the steps that wait now, and last the step to take next; none if there are no steps.

    If the step with the best rank were always next, no tolerance below its error would save any
    work. So steps with smaller errors go first, the best rank first, as long as their errors add up
    to less than the share _PATIENCE of its error. The same rule applies among them.
    waited: for each step, the summed errors of the steps that it has already waited for.
    """
    order: list[LadderStep] = []
    limit = math.inf
    while fitting := [step for step in steps if step.relative_error <= limit and step not in order]:
        best = max(fitting, key=lambda step: step.rank)
        order.append(best)
        limit = _PATIENCE * best.relative_error - waited.get(best.key, 0.0)
    return order
