"""Define the interface of all effects of the simulator."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar, Literal

from simulator.planning.bound import Bound
from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.speckle import speckle_variance

_BRIGHTER = 2.0
"""Factor by which a lamp's ripple or the panel may make the brightest pixel brighter. Chosen."""

DecidedBy = Literal["bound", "estimate"]
"""What decides in a plan: bounds, which prove its error, or audited estimates, which save more."""


class Effect(ABC):
    """One effect of optics or electronics on a picture, at levels from off to finest.

    An effect computes its numbers from the situation alone. It never renders anything.

    Attributes
    ----------
    name : str
        Name of the effect, in words, as in files.
    kind : {"axis", "stage"}
        An axis of the image-formation integral, which is sampled, or a stage of it.
    physics : str
        The physics in one sentence.
    source : str
        Equation, paper or textbook.
    levels : tuple of str
        Names of the levels, the coarsest first. The first is "off", or "1" for an axis.
    requires : tuple of str
        Names of effects that must not be off if this one isn't.
    refines : tuple of str
        Names of effects that may be rendered at their finest wherever this one isn't off. To put
        this one back changes the picture by their errors, too.
    recipe_field : str
        Name of the field of the Recipe that the effect sets.
    recipe_values : tuple
        Value of that field at each level.
    assumed_by_other_bounds : bool
        Whether the bounds of the other effects assume that this one is on. Changes add up in any
        order, and the change by this effect is taken to be the last.
    is_per_frame : bool
        Whether the effect is computed again for each frame of a static picture.
    """

    name: ClassVar[str]
    kind: ClassVar[Literal["axis", "stage"]]
    physics: ClassVar[str]
    source: ClassVar[str]
    levels: ClassVar[tuple[str, ...]] = ("off", "on")
    requires: ClassVar[tuple[str, ...]] = ()
    refines: ClassVar[tuple[str, ...]] = ()
    recipe_field: ClassVar[str]
    recipe_values: ClassVar[tuple[object, ...]] = (False, True)
    assumed_by_other_bounds: ClassVar[bool] = False
    is_per_frame: ClassVar[bool] = False

    @abstractmethod
    def is_present(self, s: Situation) -> bool:
        """Return whether the effect occurs in a situation, so that it has to be planned."""

    def finest_level(self, s: Situation) -> int:
        """Return the effect's finest level to plan; beyond it, the picture doesn't change."""
        return len(self.levels) - 1

    @abstractmethod
    def estimated_error(self, s: Situation, level: int) -> float:
        """Estimate the picture's relative change between the effect's planned and finest level."""

    def error_bound(self, s: Situation, level: int) -> Bound:
        """Bound the error of the effect at a planned level; it decreases to 0 at the finest."""
        return Bound() if level >= self.finest_level(s) else self.error_bound_below_finest(s, level)

    @abstractmethod
    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        """Bound the error of the effect at a planned level below the finest."""

    def likely_error(self, s: Situation, level: int) -> Bound:
        """Estimate how large the error of the effect at a planned level is, at most, but for few.

        The estimate comes from audits on random scenes; it isn't proved. Without one, the bound
        takes its place.
        """
        return self.error_bound(s, level)

    def error(self, s: Situation, level: int, decided_by: DecidedBy) -> Bound:
        """Return the error of the effect at a planned level, as bounds or estimates tell it."""
        told = self.error_bound if decided_by == "bound" else self.likely_error
        found = told(s, level)
        varied = speckle_variance(s) if found.mean and s.target.speckle else 0.0
        if not varied:
            return found
        # Speckle's variance v m² changes with the mean m: its root by √v times m's change.
        brightest = float(s.picture_probe.brightest) * s.exposure
        return replace(
            found,
            variance=found.variance + _BRIGHTER * 2 * varied * brightest * found.mean,
            sigma=found.sigma + math.sqrt(varied) * found.mean,
        )

    @abstractmethod
    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that the effect adds to a plan.

        levels: those of all effects that occur.
        """

    @abstractmethod
    def explain(self, s: Situation) -> str:
        """Describe in words for the plan how strong the effect is in a situation."""

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        """Return the recipe with this effect added at its planned level, above off."""
        return recipe.with_changes(**{self.recipe_field: self.recipe_values[level]})


class OnOffEffect(Effect):
    """An effect that is either off or on; on is its finest level."""

    kind: ClassVar[Literal["axis", "stage"]] = "stage"

    @abstractmethod
    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the picture's relative change if the plan omits the effect."""

    @abstractmethod
    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the picture's change if the plan omits the effect."""

    def estimated_error(self, s: Situation, level: int) -> float:
        return 0.0 if level else self.estimated_error_if_omitted(s)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        return self.error_bound_if_omitted(s)
