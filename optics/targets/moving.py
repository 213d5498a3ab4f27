"""Draw targets that change with time, one picture per moment."""

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
    """Draw a spiral target that shrinks linearly with time, (moments, rows, columns).

    Each picture has a sum of 1.

    Parameters
    ----------
    radius : float
        Radius at the first moment, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.
    moments : int
        Number of pictures, 2 or more.
    smallest : float, default 0.4
        Share of the radius that is left at the last moment, above 0 and up to 1.
    turns : float, default 3.0
        Number of turns of every spiral.
    hole : float, default 0.36
        Share of each spiral's radius around the axis that is left out.

    Returns
    -------
    Drawings
        One picture per moment, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If there are fewer than 2 moments, or a size is outside its range.

    References
    ----------
    Thesis Fig. 3.4.
    """
    if moments < 2:
        raise ValueError(f"moments is {moments}; what changes with time has two at least")
    if not 0 < smallest <= 1:
        raise ValueError(f"smallest is {smallest:g}; it is a share of the radius, above 0")

    def at(moment: int) -> Drawing:
        share = 1 - (1 - smallest) * moment / (moments - 1)
        return spiral.draw(share * radius, width, turns, hole)

    return Drawings([at(moment) for moment in range(moments)])
