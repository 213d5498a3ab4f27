"""Targets that change with time: one picture a moment."""

from __future__ import annotations

from optics.targets.curves import spiral
from optics.targets.target import Drawing, Drawings, Target


@Target
def shrinking_spiral(
    radius: float,
    width: float,
    moments: int,
    smallest: float = 0.4,
    turns: float = 3.0,
    hole: float = 0.36,
) -> Drawings:
    """A spiral that shrinks evenly, (moments, rows, columns), each with sum one (Fig. 3.4).

    radius: metres, at the first moment. smallest: share of it that is left at the last, above 0
    and up to 1. width, turns, hole: of every spiral.
    """
    if moments < 2:
        raise ValueError(f"moments is {moments}; what changes with time has two at least")
    if not 0 < smallest <= 1:
        raise ValueError(f"smallest is {smallest:g}; it is a share of the radius, above 0")

    def at(moment: int) -> Drawing:
        share = 1 - (1 - smallest) * moment / (moments - 1)
        return spiral.draw(share * radius, width, turns, hole)

    return Drawings([at(moment) for moment in range(moments)])
