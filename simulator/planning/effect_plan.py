"""Choose the levels of all effects for a picture, with the reasons, for people and renderers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, get_args

from simulator.planning.effect import Bound, DecidedBy, Effect, MinimumNorms, forced_level
from simulator.planning.ladder import Ladder
from simulator.recipe import Recipe
from simulator.situation import Situation

EFFECTS_SHARE = 0.9
"""Share of a tolerance that omitted effects may use; the rest is for sampling and arithmetic."""


@dataclass(frozen=True)
class Decision:
    """What was decided about one effect: its level, its error bound, and the physics.

    Parameters
    ----------
    effect, kind, level : str
        Names of the effect, of its kind ("axis" or "stage"), and of the chosen level.
    levels : tuple of str
        Names of all levels up to the finest, the coarsest first.
    error : Bound
        Change of the picture because of the chosen level: the largest, or the likely one, as the
        plan decides by bounds or estimates.
    relative, estimate : float
        The error over the picture's norms, as the largest of all measures; typical relative change.
    work, finest_work : float
        Operations that the effect adds, at the chosen level and at its finest.
    why, physics, source : str
        How strong the effect is in this situation; its physics in one sentence; equation, paper or
        textbook.
    forced : bool
        Whether a user forced the level.
    """

    effect: str
    kind: str
    level: str
    levels: tuple[str, ...]
    error: Bound
    relative: float
    estimate: float
    work: float
    finest_work: float
    why: str
    physics: str
    source: str
    forced: bool = False

    @property
    def on(self) -> bool:
        return self.level != self.levels[0]


class EffectPlan:
    """The levels of all effects that occur in a situation, for a tolerance.

    Parameters
    ----------
    ladder : Ladder
        The steps from all effects at their finest to all effects off.
    situation : Situation
        Scene, camera, pattern, filter and exposure; the plan has no reference to it.
    tol : float
        Largest relative error of the picture.
    levels, forced : dict of str to int
        Level of each effect, and of those that a user forced.
    decided_by : {"bound", "estimate"}
        What decided, and what the errors are.

    Attributes
    ----------
    recipe : Recipe
        What is to be rendered.
    is_finest : bool
        Whether all effects are at their finest level.
    error, relative_error : Bound, float
        Change by all effects below their finest level, at most or likely, and relative to the
        picture's norms. The latter exceeds `tol` only where a user forced an effect.
    planning_cpu : float
        Seconds of processor time that planning took.
    work, most_work : float
        Operations of a picture with the plan, and with all effects at their finest level.
    decisions : tuple of Decision
        The decision about each effect, in the order of the physics.
    """

    def __init__(
        self,
        ladder: Ladder,
        situation: Situation,
        tol: float,
        levels: dict[str, int],
        forced: Mapping[str, int],
        decided_by: DecidedBy = "bound",
    ) -> None:
        self.tol, self._levels, self.decided_by = tol, levels, decided_by
        self.planning_cpu = 0.0
        self.recipe = build_recipe(ladder.effects, situation, levels)
        self.is_finest = all(
            levels[one.name] == one.finest_level(situation) for one in ladder.effects
        )
        self.error = ladder.error(levels)
        self.relative_error = ladder.relative_error(self.error)
        self.work, self.most_work = ladder.work(levels), ladder.work(ladder.finest_levels)
        self.decisions = tuple(
            _decision(one, situation, ladder, levels, forced) for one in ladder.effects
        )

    def __getitem__(self, effect: str) -> Decision:
        return {one.effect: one for one in self.decisions}[effect]

    def level(self, effect: str) -> int:
        """Return the level of an effect; 0 if it is off or doesn't occur."""
        return self._levels.get(effect, 0)

    @property
    def levels(self) -> dict[str, int]:
        return dict(self._levels)

    def as_data(self) -> dict[str, Any]:
        """Return plain data, with None for errors that aren't finite."""
        return {
            "tol": self.tol,
            "decided_by": self.decided_by,
            "error": _finite(self.relative_error),
            "work": self.work,
            "most_work": self.most_work,
            "decisions": [
                {
                    **asdict(one),
                    "error": {
                        name: _finite(value) if isinstance(value, float) else value
                        for name, value in asdict(one.error).items()
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
    """Build the recipe that renders a situation with given levels of its effects.

    Parameters
    ----------
    effects : sequence of Effect
        In the order in which they are added.
    situation : Situation
        Scene, camera, pattern, filter and exposure.
    levels : mapping of str to int
        Level of each effect by its name; effects that aren't named are off.

    Returns
    -------
    Recipe
        What is to be rendered.
    """
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
    decided_by: DecidedBy = "bound",
) -> EffectPlan:
    """Choose the levels of all effects so that the picture's error stays within a tolerance.

    Parameters
    ----------
    effects : sequence of Effect
        All effects that the simulator knows, in the order of the physics.
    situation : Situation
        Scene, camera, pattern, filter and exposure.
    norms : MinimumNorms
        Norms of the picture, which errors are relative to: lower bounds, or estimates.
    tol : float
        Largest relative error of the picture, 0 or more.
    forced : mapping of str to (str or bool), optional
        Levels that a user forces whatever the error, by the effect's name: True for the finest
        level, False for off, or a level's name.
    decided_by : {"bound", "estimate"}
        Whether bounds decide, which prove the plan's error, or estimates from audits.

    Returns
    -------
    EffectPlan
        The level of each effect, with bounds and reasons.

    Raises
    ------
    ValueError
        If `tol` is negative or not finite, a forced effect or level doesn't exist, or an effect is
        forced on that requires one that is forced off.
    """
    require_tolerance(tol)
    fixed = {
        name: forced_level(effects, situation, name, wanted)
        for name, wanted in (forced or {}).items()
    }
    ladder = Ladder(effects, situation, norms, fixed, decided_by)
    levels = ladder.levels(EFFECTS_SHARE * tol)
    return EffectPlan(ladder, situation, tol, levels, ladder.forced_levels, decided_by)


def require_tolerance(tol: float) -> None:
    """Raise ValueError for a tolerance that is negative or not finite."""
    if not 0 <= tol < math.inf:
        raise ValueError(f"tol is {tol:g}; it must be finite and not negative")


def require_decided_by(decided_by: str) -> None:
    """Raise ValueError for anything else than 'bound' and 'estimate'."""
    if decided_by not in get_args(DecidedBy):
        words = " or ".join(repr(one) for one in get_args(DecidedBy))
        raise ValueError(f"decide_by is {decided_by!r}; give {words}")


def _decision(
    one: Effect, s: Situation, ladder: Ladder, levels: dict[str, int], forced: Mapping[str, int]
) -> Decision:
    """Return the decision about one effect, with its error, work and reasons."""
    level = levels[one.name]
    error = ladder.effect_error(one.name, level)
    off, finest = {**levels, one.name: 0}, {**levels, one.name: one.finest_level(s)}
    return Decision(
        one.name,
        one.kind,
        one.levels[level],
        one.levels[: one.finest_level(s) + 1],
        error,
        ladder.relative_error(error),
        one.estimated_error(s, level),
        max(ladder.work(levels) - ladder.work(off), 0.0),
        max(ladder.work(finest) - ladder.work(off), 0.0),
        one.explain(s),
        one.physics,
        one.source,
        one.name in forced,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
