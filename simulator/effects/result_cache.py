"""Keep results with what they depend on: a situation, all its exposures, or all its patterns."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Any, Concatenate, ParamSpec, TypeVar

from simulator.situation import Situation

T = TypeVar("T")
P = ParamSpec("P")
Place = tuple[dict[Hashable, Any], Hashable]

_MISSING: Any = object()


def _cached_in(
    place: Callable[[Situation], Place],
) -> Callable[[Callable[Concatenate[Situation, P], T]], Callable[Concatenate[Situation, P], T]]:
    """Return a decorator of functions of a situation, whose results are kept in a place.

    A cache of the function's own would keep situations alive that nothing else uses any more.
    place: returns the results that are kept already, and what they depend on beside the arguments.
    """

    def decorate(
        find: Callable[Concatenate[Situation, P], T],
    ) -> Callable[Concatenate[Situation, P], T]:
        @functools.wraps(find)
        def wrapper(s: Situation, /, *args: P.args, **options: P.kwargs) -> T:
            known, beside = place(s)
            causes = (find, beside, args, *options.items())
            found: T = known.get(causes, _MISSING)  # one look-up: a camera takes long to hash
            if found is _MISSING:
                found = known[causes] = find(s, *args, **options)
            return found

        return wrapper

    return decorate


def _of_pattern(s: Situation) -> Place:
    # If the target moves, each exposure time has a result of its own.
    moving = s.exposure if s.target.is_moving else None
    return s.pattern_probe.results, (s.picture_probe, s.band, s.camera, s.mount, moving)


cached_per_situation = _cached_in(lambda s: (s.cache.results, None))
cached_across_exposures = _cached_in(_of_pattern)
"""For what is the same for all exposure times and starts."""
cached_across_patterns = _cached_in(lambda s: (s.picture_probe.results, s.mount))
"""For what follows from the sharp picture, mount and arguments alone."""
