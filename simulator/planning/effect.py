"""The contract of all effects."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Literal

from simulator.planning.bound import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation


class Effect(ABC):
    """One thing that optics or electronics do to a picture, at levels from off to finest.

    name: in words, as in files. kind: an axis of the image-formation integral, which is sampled,
    or a stage of it. physics: one sentence. source: equation, paper or textbook. levels: names,
    the coarsest first; the first is "off", or "1" of an axis. requires: names of effects that
    must not be off if this one isn't. recipe_field, recipe_values: of the recipe, and what it is
    at each level. assumed_by_other_bounds: whether the others' bounds count on it: changes add up
    in whatever order they are made, and this one is thought to be made last. is_per_frame:
    whether it's done anew for each frame of a picture that stands.

    An effect decides by numbers from the situation alone: it never renders anything.
    """

    name: ClassVar[str]
    kind: ClassVar[Literal["axis", "stage"]]
    physics: ClassVar[str]
    source: ClassVar[str]
    levels: ClassVar[tuple[str, ...]] = ("off", "on")
    requires: ClassVar[tuple[str, ...]] = ()
    recipe_field: ClassVar[str]
    recipe_values: ClassVar[tuple[object, ...]] = (False, True)
    assumed_by_other_bounds: ClassVar[bool] = False
    is_per_frame: ClassVar[bool] = False

    @abstractmethod
    def is_present(self, s: Situation) -> bool:
        """Whether bench and scene have anything of it; without, it isn't in a plan."""

    def finest_level(self, s: Situation) -> int:
        """The level beyond which nothing changes any more."""
        return len(self.levels) - 1

    @abstractmethod
    def estimated_error(self, s: Situation, level: int) -> float:
        """About the relative change of the picture at a level against the finest."""

    def error_bound(self, s: Situation, level: int) -> Bound:
        """The most that it can be; falls with the level, and is 0 at the finest."""
        return Bound() if level >= self.finest_level(s) else self.error_bound_below_finest(s, level)

    @abstractmethod
    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        """The same at a level below the finest."""

    @abstractmethod
    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Operations that its level adds, given the levels of all that are caused."""

    @abstractmethod
    def explain(self, s: Situation) -> str:
        """In words of this situation: what there is of it."""

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        """The recipe with this effect at a level above off; never called for one that is off."""
        return recipe.with_changes(**{self.recipe_field: self.recipe_values[level]})


class OnOffEffect(Effect):
    """An effect that is on or off; on, nothing changes any more."""

    kind: ClassVar[Literal["axis", "stage"]] = "stage"

    @abstractmethod
    def estimated_error_if_omitted(self, s: Situation) -> float:
        """About the relative change of the picture without it."""

    @abstractmethod
    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """The most that the picture changes without it."""

    def estimated_error(self, s: Situation, level: int) -> float:
        return 0.0 if level else self.estimated_error_if_omitted(s)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        return self.error_bound_if_omitted(s)
