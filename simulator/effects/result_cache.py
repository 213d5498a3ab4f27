"""What is found once: for a situation, or for all exposures of what stands before a camera."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

from simulator.situation import Situation

T = TypeVar("T")
P = ParamSpec("P")


def cached_per_situation(
    find: Callable[Concatenate[Situation, P], T],
) -> Callable[Concatenate[Situation, P], T]:
    """Let a function's answers be kept with the situation that they are of, and go with it: a
    cache of its own would hold situations, and all that they know, that nobody has any more."""

    @functools.wraps(find)
    def wrapper(s: Situation, /, *args: P.args, **options: P.kwargs) -> T:
        known = s.cache.results
        causes = (find, args, tuple(sorted(options.items())))
        if causes not in known:
            known[causes] = find(s, *args, **options)
        found: T = known[causes]
        return found

    return wrapper


def cached_across_exposures(s: Situation, what: str, find: Callable[[], T]) -> T:
    """What was found of a situation that differs in nothing but exposure and moment, or is now.

    what: names it, and everything else that it follows from. Where anything moves, an exposure
    has its own.
    """
    moving = s.exposure if s.target.is_moving else None
    causes = (what, s.picture_probe, s.band, s.camera, s.mount, moving)
    if causes not in s.pattern_probe.results:
        s.pattern_probe.results[causes] = find()
    found: T = s.pattern_probe.results[causes]
    return found
