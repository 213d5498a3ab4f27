"""A Siemens star."""

from __future__ import annotations

import math

from optics.validation import require_positive
from simulator.scene.charts.tones import INK, PAPER, require_tones
from simulator.scene.polygons import Corners, Polygons, rectangle

_ARC = 16
"""Corners along the outer end of a spoke."""

_SHEET = 1.1
"""Side of the sheet over the star's diameter."""


def siemens_star(
    diameter: float,
    spokes: int = 36,
    *,
    dark: float = INK,
    bright: float = PAPER,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Polygons:
    """Dark spokes as wide as the gaps between them: at a radius r, spokes / 2πr line pairs a
    metre.

    diameter: metres. Raises ValueError for fewer than 2 spokes.
    """
    require_positive("diameter", diameter, "m")
    require_tones(dark, bright)
    if spokes < 2:
        raise ValueError(f"spokes is {spokes}; a star has 2 or more")
    side = _SHEET * diameter
    wedges = tuple(_spoke(diameter / 2, k, spokes, offset) for k in range(spokes))
    sheet = rectangle(offset, (side, side))
    return Polygons((sheet, *wedges), (bright, *[dark - bright] * spokes))


def _spoke(radius: float, index: int, spokes: int, offset: tuple[float, float]) -> Corners:
    width = math.pi / spokes
    arc = [2 * index * width + width * k / _ARC for k in range(_ARC + 1)]
    # As large as a sector of the radius.
    outer = radius * math.sqrt(width / (_ARC * math.sin(width / _ARC)))
    rim = ((offset[0] + outer * math.sin(a), offset[1] + outer * math.cos(a)) for a in arc)
    return (offset, *rim)
