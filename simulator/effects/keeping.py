"""What follows from target, camera, pattern and band is found once for all exposures of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from simulator.situation import Situation

T = TypeVar("T")


def kept(s: Situation, what: str, find: Callable[[], T]) -> T:
    """What was found of a situation that differs in nothing but exposure and moment, or is now.

    what: names it, and everything else that it follows from. Where anything moves, an exposure
    has its own.
    """
    moving = s.exposure if s.target.moves else None
    causes = (what, s.picture, s.band, s.camera, s.mount, moving)
    if causes not in s.pattern.kept:
        s.pattern.kept[causes] = find()
    found: T = s.pattern.kept[causes]
    return found
