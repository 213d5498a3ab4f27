"""Keep results that are computed for a situation, or for all exposures of a scene."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Concatenate, ParamSpec, TypeVar

from simulator.situation import Situation

T = TypeVar("T")
P = ParamSpec("P")


def cached_per_situation(
    find: Callable[Concatenate[Situation, P], T],
) -> Callable[Concatenate[Situation, P], T]:
    """Decorate a function of a situation so that the situation keeps its results.

    The results are deleted with the situation. A cache of the function's own would keep situations
    alive that nothing else uses any more.
    """

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
    """Return a result that is computed once for all exposure times and starts.

    If the target moves, each exposure time has a result of its own.
    what: name of the result, and of everything else that it depends on.
    """
    moving = s.exposure if s.target.is_moving else None
    causes = (what, s.picture_probe, s.band, s.camera, s.mount, moving)
    if causes not in s.pattern_probe.results:
        s.pattern_probe.results[causes] = find()
    found: T = s.pattern_probe.results[causes]
    return found


def cached_across_patterns(s: Situation, causes: Hashable, find: Callable[[], T]) -> T:
    """Return a result that follows from the sharp picture and the named causes alone."""
    known = s.picture_probe.results
    if causes not in known:
        known[causes] = find()
    found: T = known[causes]
    return found
