"""What each effect tells about itself: whether it is there, its error bound, and its work."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from simulator.recipe import Recipe
from simulator.situation import Situation
from simulator.speckle import speckle_variance


@dataclass(frozen=True)
class Bound:
    """The largest change of a picture if an effect is below its finest level.

    It holds for any levels of the other effects.

    Parameters
    ----------
    mean, variance, sigma : float
        L2 norms over the sensor's pixels of the changes of the mean picture in electrons, of the
        variance map in electrons², and of the map of standard deviations in electrons.
    shape : float
        Largest Kolmogorov distance between the cumulative distributions of a pixel, 0 to 1, for an
        effect that changes neither mean nor variance.
    how : str
        How the bound was found: "proved: …" or "audited ×2: …".

    Raises
    ------
    ValueError
        If a number is negative or NaN.

    Examples
    --------
    >>> total = Bound(mean=2.0).plus(Bound(mean=1.0, variance=4.0))
    >>> total.mean, total.variance
    (3.0, 4.0)
    """

    mean: float = 0.0
    variance: float = 0.0
    sigma: float = 0.0
    shape: float = 0.0
    how: str = "proved: nothing changes"

    def __post_init__(self) -> None:
        for name in ("mean", "variance", "sigma", "shape"):
            value = getattr(self, name)
            if not value >= 0:
                raise ValueError(f"{name} is {value}; a bound is 0 or more")

    def plus(self, other: Bound) -> Bound:
        """Add two bounds; the sum bounds both changes together."""
        return Bound(
            self.mean + other.mean,
            self.variance + other.variance,
            self.sigma + other.sigma,
            self.shape + other.shape,
            self.how,
        )

    def minus(self, other: Bound) -> Bound:
        """Return by how much the bound exceeds another, 0 at least."""
        return Bound(
            max(self.mean - other.mean, 0.0),
            max(self.variance - other.variance, 0.0),
            max(self.sigma - other.sigma, 0.0),
            max(self.shape - other.shape, 0.0),
            self.how,
        )


@dataclass(frozen=True)
class MinimumNorms:
    """Lower bounds of the norms of a picture with every effect; errors are relative to them.

    Parameters
    ----------
    mean, variance, sigma : float
        L2 norms over the sensor's pixels of the mean picture in electrons, of the variance map in
        electrons², and of the map of standard deviations in electrons; 0 if nothing is known.

    Examples
    --------
    >>> MinimumNorms(mean=100.0, variance=50.0, sigma=10.0).relative_error(Bound(mean=2.0))
    0.02
    """

    mean: float
    variance: float
    sigma: float

    def relative_error(self, bound: Bound) -> float:
        """Return the largest relative error of a bound's measures, infinite over a norm of 0."""
        return max(
            ratio(bound.mean, self.mean),
            ratio(bound.variance, self.variance),
            ratio(bound.sigma, self.sigma),
            bound.shape,
        )


def ratio(change: float, whole: float) -> float:
    """Return a change over a whole; infinite for a whole of 0, unless nothing changes."""
    if change == 0:
        return 0.0
    return change / whole if whole > 0 else math.inf


DecidedBy = Literal["bound", "estimate"]
"""What decides in a plan: bounds, which prove its error, or audited estimates, which save more."""


class Effect(ABC):
    """One effect of optics or electronics on a picture, at levels from off to finest.

    An effect computes its numbers from the situation alone. It never renders anything.

    Attributes
    ----------
    name, physics, source : str
        Name in words, as in files; physics in one sentence; equation, paper or textbook.
    kind : {"axis", "stage"}
        An axis of the image-formation integral, which is sampled, or a stage of it.
    levels : tuple of str
        Names of the levels, the coarsest first. The first is "off", or "1" for an axis.
    requires : tuple of str
        Names of effects that must not be off if this one isn't.
    refines : tuple of str
        Names of effects that may be at their finest wherever this one isn't off: to put this one
        back changes the picture by their errors, too.
    recipe_field, recipe_values : str, tuple
        Field of the Recipe that the effect sets, and its value at each level.
    assumed_by_other_bounds : bool
        Whether the bounds of other effects assume that this one is on. Changes add up in any order,
        and the change by this effect is taken to be the last.
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
        """Return whether the effect occurs in a situation."""

    def finest_level(self, s: Situation) -> int:
        """Return the finest level that is useful; beyond it, the picture doesn't change."""
        return len(self.levels) - 1

    @abstractmethod
    def estimated_error(self, s: Situation, level: int) -> float:
        """Estimate the picture's relative change between a level and the finest."""

    def error_bound(self, s: Situation, level: int) -> Bound:
        """Bound the error at a level; it decreases to 0 at the finest."""
        return Bound() if level >= self.finest_level(s) else self.error_bound_below_finest(s, level)

    @abstractmethod
    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        """Bound the error at a level below the finest."""

    def likely_error(self, s: Situation, level: int) -> Bound:
        """Estimate the largest error at a level, but for few, from audits on random scenes.

        Without an estimate, the bound takes its place.
        """
        return self.error_bound(s, level)

    def error(self, s: Situation, level: int, decided_by: DecidedBy) -> Bound:
        """Return the error at a level, as bounds or estimates tell it."""
        found = (self.error_bound if decided_by == "bound" else self.likely_error)(s, level)
        varied = speckle_variance(s) if found.mean and s.target.speckle else 0.0
        if not varied:
            return found
        # Speckle's variance v m² changes with the mean m: its root by √v times m's change. A lamp's
        # ripple, or the panel, may make the brightest pixel twice as bright (chosen).
        brightest = float(s.picture_probe.brightest) * s.exposure
        return replace(
            found,
            variance=found.variance + 2.0 * 2 * varied * brightest * found.mean,
            sigma=found.sigma + math.sqrt(varied) * found.mean,
        )

    @abstractmethod
    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that the effect adds to rendering, at levels of all effects."""

    @abstractmethod
    def explain(self, s: Situation) -> str:
        """Describe in words how strong the effect is in a situation."""

    def add_to_recipe(self, recipe: Recipe, s: Situation, level: int) -> Recipe:
        """Return the recipe with the effect added at a level above off."""
        return recipe.with_changes(**{self.recipe_field: self.recipe_values[level]})


class OnOffEffect(Effect):
    """An effect that is either off or on; on is its finest level."""

    kind: ClassVar[Literal["axis", "stage"]] = "stage"

    @abstractmethod
    def estimated_error_if_omitted(self, s: Situation) -> float:
        """Estimate the picture's relative change if the effect is left out."""

    @abstractmethod
    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the picture's change if the effect is left out."""

    def estimated_error(self, s: Situation, level: int) -> float:
        return 0.0 if level else self.estimated_error_if_omitted(s)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        return self.error_bound_if_omitted(s)


def forced_level(effects: Sequence[Effect], s: Situation, name: str, request: str | bool) -> int:
    """Return the level of a forced effect: finest for True, off for False, or as named.

    Raises ValueError for an effect or a level that doesn't exist.
    """
    named = {one.name: one for one in effects}
    if name not in named:
        raise ValueError(f"effect {name!r} is unknown; choose among {', '.join(named)}")
    one = named[name]
    if isinstance(request, bool):
        finest = one.finest_level(s) if one.is_present(s) else len(one.levels) - 1
        return finest if request else 0
    if request not in one.levels:
        raise ValueError(
            f"effect {name!r} has no level {request!r}; choose among {', '.join(one.levels)}"
        )
    return one.levels.index(request)


def resolve_forced_levels(
    effects: Sequence[Effect], forced_levels: Mapping[str, int]
) -> dict[str, int]:
    """Return the levels of forced effects and of effects that these switch off.

    Effects that don't occur are left out. An effect that requires one that is forced off is off as
    well. Raises ValueError if such an effect is forced on.
    """
    there = {one.name for one in effects}
    found = {name: level for name, level in forced_levels.items() if name in there}
    more = True
    while more:
        more = False
        for one in effects:
            off = next((name for name in one.requires if found.get(name) == 0), None)
            if off is None or found.get(one.name) == 0:
                continue
            if one.name in found:
                raise ValueError(
                    f"effect {one.name!r} is forced on, and requires {off!r}, which is forced "
                    "off; change one of the two"
                )
            found[one.name], more = 0, True
    return found
