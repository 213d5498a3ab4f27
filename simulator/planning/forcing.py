"""Resolve the levels of effects that a user forces in a plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from simulator.planning.effect import Effect
from simulator.situation import Situation


def forced_level(effects: Sequence[Effect], s: Situation, name: str, request: str | bool) -> int:
    """Return the level to plan for a forced effect: finest for True, off for False, or as named.

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
    """Return the planned levels of forced effects and of effects that these switch off.

    Effects that don't occur are left out. An effect that requires one that is forced off is off as
    well. Raises ValueError if such an effect is forced on.
    """
    there = {one.name for one in effects}
    found = {name: level for name, level in forced_levels.items() if name in there}
    while falling := [one for one in effects if _lacks_requirement(one, found)]:
        for one in falling:
            if found.get(one.name, 0):
                off = next(name for name in one.requires if found.get(name) == 0)
                raise ValueError(
                    f"effect {one.name!r} is forced on, and requires {off!r}, which is forced "
                    "off; change one of the two"
                )
            found[one.name] = 0
    return found


def _lacks_requirement(one: Effect, found: Mapping[str, int]) -> bool:
    """Whether a planned effect may be on although an effect that it requires is forced off."""
    return found.get(one.name) != 0 and any(found.get(name) == 0 for name in one.requires)
