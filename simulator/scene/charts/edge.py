"""A slanted edge, for the modulation transfer as ISO 12233 measures it."""

from __future__ import annotations

import math

from optics.validation import require_positive
from simulator.scene.charts.tones import INK, PAPER, require_tones
from simulator.scene.polygons import Polygons, rectangle


def slanted_edge(
    size: float,
    angle: float = math.radians(5),
    *,
    dark: float = INK,
    bright: float = PAPER,
    offset: tuple[float, float] = (0.0, 0.0),
    horizontal: bool = False,
) -> Polygons:
    """A square sheet, dark on the left and bright on the right of a straight edge.

    size: of the sheet, metres. angle: radians by which the edge leans away from the vertical;
    its upper end to the right where it is positive. horizontal: the same chart turned by a
    quarter, dark above. Raises ValueError for an angle that isn't between ±45°.
    """
    require_positive("size", size, "m")
    require_tones(dark, bright)
    if not abs(angle) <= math.pi / 4:
        raise ValueError(f"angle is {math.degrees(angle):g}°; give -45° to 45°")
    half, lean = size / 2, math.tan(angle) * size / 2
    sheet = rectangle(offset, (size, size))
    half_plane = ((-half, lean), (-half, half), (half, half), (half, -lean))
    placed = tuple(
        (offset[0] + (x if horizontal else y), offset[1] + (y if horizontal else x))
        for y, x in half_plane
    )
    return Polygons((sheet, placed), (dark, bright - dark))
