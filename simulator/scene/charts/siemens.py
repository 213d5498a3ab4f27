"""Siemens star: a round test chart of spokes."""

from __future__ import annotations

import math

from optics.validation import require_positive
from simulator.scene.charts.tones import INK, PAPER, require_tones
from simulator.scene.polygons import Corners, Polygons, rectangle


def siemens_star(
    diameter: float,
    spokes: int = 36,
    *,
    dark: float = INK,
    bright: float = PAPER,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Polygons:
    """Draw a Siemens star: dark spokes as wide as the gaps between them.

    At a radius r the star has spokes / (2πr) line pairs per metre.

    Parameters
    ----------
    diameter : float
        Diameter of the star in metres, positive. The sheet's side is 1.1 diameters.
    spokes : int, default 36
        Number of dark spokes, 2 or more.
    dark, bright : float
        Reflectances of spokes and sheet, 0 to 1, by default those of ink and paper.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the star's middle relative to the axis, metres on the object.

    Returns
    -------
    Polygons
        The chart, whose first polygon is the sheet.

    Raises
    ------
    ValueError
        If there are fewer than 2 spokes, the diameter isn't positive, or the reflectances aren't
        from 0 to 1 with `dark` below `bright`.
    """
    require_positive("diameter", diameter, "m")
    require_tones(dark, bright)
    if spokes < 2:
        raise ValueError(f"spokes is {spokes}; a star has 2 or more")
    side = 1.1 * diameter
    wedges = tuple(_spoke(diameter / 2, k, spokes, offset) for k in range(spokes))
    sheet = rectangle(offset, (side, side))
    return Polygons((sheet, *wedges), (bright, *[dark - bright] * spokes))


def _spoke(radius: float, index: int, spokes: int, offset: tuple[float, float]) -> Corners:
    width = math.pi / spokes
    # A polygon of n edges replaces the arc. Its corners lie a little outside of the radius, so
    # that its area is that of the sector.
    n = 16
    arc = [2 * index * width + width * k / n for k in range(n + 1)]
    outer = radius * math.sqrt(width / (n * math.sin(width / n)))
    rim = ((offset[0] + outer * math.sin(a), offset[1] + outer * math.cos(a)) for a in arc)
    return (offset, *rim)
