"""What is done for a picture and why: the plan that a person reads, and that is rendered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from simulator.planning.bound import Bound, MinimumNorms
from simulator.planning.effect import Effect
from simulator.planning.forcing import forced_level
from simulator.planning.ladder import Ladder
from simulator.recipe import Recipe
from simulator.situation import Situation

EFFECTS_SHARE = 0.9
"""Of a tolerance, what effects may be left out for; the rest is for sampling and arithmetic."""


@dataclass(frozen=True)
class Decision:
    """One effect's line: its level, the bound of what that may change, and the physics.

    level: in words. levels: all there are. relative: bound over the picture's own norms, in
    the worst of the measures. estimate: about what it is. work: operations that it takes.
    """

    effect: str
    kind: str
    level: str
    levels: tuple[str, ...]
    bound: Bound
    relative: float
    estimate: float
    work: float
    why: str
    physics: str
    source: str
    forced: bool = False

    @property
    def on(self) -> bool:
        return self.level != self.levels[0]


class EffectPlan:
    """The levels of all effects that a situation causes, for a tolerance.

    recipe: what is to be rendered, the barest and what every effect that is on adds to it.
    relative_error_bound: of what leaving out what is left out makes (0 to infinity; above tol only
    where somebody forced an effect). is_finest: whether each is at its finest.
    """

    def __init__(
        self,
        ladder: Ladder,
        situation: Situation,
        tol: float,
        levels: dict[str, int],
        forced: Mapping[str, int],
    ) -> None:
        # A plan is kept for long: it doesn't hold the situation, and what that knows of pictures.
        self.tol, self._levels = tol, levels
        self.recipe = build_recipe(ladder.effects, situation, levels)
        self.is_finest = all(
            levels[one.name] == one.finest_level(situation) for one in ladder.effects
        )
        self.error_bound = ladder.error_bound(levels)
        self.relative_error_bound = ladder.relative_error(self.error_bound)
        self.work, self.most_work = ladder.work(levels), ladder.work(ladder.finest_levels)
        self.decisions = tuple(
            _decision(one, situation, ladder, levels, forced) for one in ladder.effects
        )

    def __getitem__(self, effect: str) -> Decision:
        return {one.effect: one for one in self.decisions}[effect]

    def level(self, effect: str) -> int:
        """0 for one that is off, or that nothing causes."""
        return self._levels.get(effect, 0)

    @property
    def levels(self) -> dict[str, int]:
        return dict(self._levels)

    def as_data(self) -> dict[str, Any]:
        """As plain data; bounds that aren't finite are None."""
        return {
            "tol": self.tol,
            "error": _finite(self.relative_error_bound),
            "work": self.work,
            "most_work": self.most_work,
            "decisions": [
                {
                    **asdict(one),
                    "bound": {
                        name: _finite(value) if isinstance(value, float) else value
                        for name, value in asdict(one.bound).items()
                    },
                    "relative": _finite(one.relative),
                    "on": one.on,
                }
                for one in self.decisions
            ],
        }


def build_recipe(
    effects: Sequence[Effect], situation: Situation, levels: Mapping[str, int]
) -> Recipe:
    """What is to be rendered for the effects' levels; those that aren't named are off."""
    recipe = Recipe.minimal(situation)
    for one in effects:
        if level := levels.get(one.name, 0):
            recipe = one.add_to_recipe(recipe, situation, level)
    return recipe


def plan_effects(
    effects: Sequence[Effect],
    situation: Situation,
    norms: MinimumNorms,
    tol: float,
    forced: Mapping[str, str | bool] | None = None,
) -> EffectPlan:
    """The plan for a tolerance; forced effects win: True for the finest, False for off, or a
    level by its name.

    Raises ValueError for a tol that is negative or not finite, a forced effect that doesn't
    exist, a level that it hasn't, or one that is on and requires one that is off.
    """
    require_tolerance(tol)
    fixed = {
        name: forced_level(effects, situation, name, wanted)
        for name, wanted in (forced or {}).items()
    }
    ladder = Ladder(effects, situation, norms, fixed)
    return EffectPlan(
        ladder, situation, tol, ladder.levels(EFFECTS_SHARE * tol), ladder.forced_levels
    )


def require_tolerance(tol: float) -> None:
    """Raise ValueError for one that is negative or not finite."""
    if not 0 <= tol < math.inf:
        raise ValueError(f"tol is {tol:g}; it must be finite and not negative")


def _decision(
    one: Effect, s: Situation, ladder: Ladder, levels: dict[str, int], forced: Mapping[str, int]
) -> Decision:
    level = levels[one.name]
    bound = ladder.effect_error_bound(one.name, level)
    off = {**levels, one.name: 0}
    return Decision(
        one.name,
        one.kind,
        one.levels[level],
        one.levels[: one.finest_level(s) + 1],
        bound,
        ladder.relative_error(bound),
        one.estimated_error(s, level),
        max(ladder.work(levels) - ladder.work(off), 0.0),
        one.explain(s),
        one.physics,
        one.source,
        one.name in forced,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
