"""Effects whose bounds, work and demands are simply given, for tests of planning."""

from dataclasses import dataclass, field
from types import SimpleNamespace

from optics.camera import Panel
from simulator.planning import Bound, Effect

SITUATION = SimpleNamespace(
    ideal_panel=Panel(), coarsest_sampling=1, target=SimpleNamespace(speckle=None)
)


@dataclass
class Toy(Effect):
    """bounds, works: by level, from off to the finest. coupled: effects by whose level its work
    is multiplied. sets: what its level does to a recipe."""

    name: str = "toy"
    bounds: tuple[Bound, ...] = (Bound(1.0), Bound())
    works: tuple[float, ...] = (0.0, 1.0)
    coupled: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    refines: tuple[str, ...] = ()
    sets: dict[str, tuple[object, ...]] = field(default_factory=dict)
    there: bool = True
    kind = "stage"
    physics = "a toy"
    source = "none"

    @property
    def levels(self) -> tuple[str, ...]:
        return ("off", *(f"level {n}" for n in range(1, len(self.bounds))))

    def is_present(self, s):
        return self.there

    def estimated_error(self, s, level):
        return self.bounds[level].mean / 2

    def error_bound_below_finest(self, s, level):
        return self.bounds[level]

    def added_operations(self, s, levels):
        work = self.works[levels[self.name]]
        for other in self.coupled:
            work *= 1 + levels[other]
        return work

    def explain(self, s):
        return "it was made so"

    def add_to_recipe(self, recipe, s, level):
        assert level > 0
        return recipe.with_changes(**{key: values[level] for key, values in self.sets.items()})
