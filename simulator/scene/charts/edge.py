"""A test chart with a slanted edge, from which ISO 12233 measures the MTF."""

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
    """Draw a slanted edge: a square, dark on the left and bright on the right.

    Parameters
    ----------
    size : float
        Side of the sheet in metres, positive.
    angle : float, default math.radians(5)
        Angle between the edge and the vertical in radians, between ±π/4. If it is positive, the
        upper end leans to the right.
    dark, bright : float
        Reflectances of the two halves, 0 to 1, by default those of ink and paper.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the sheet's middle relative to the axis, metres on the object.
    horizontal : bool, default False
        Whether y and x are exchanged, so that the edge is nearly level and dark above.

    Returns
    -------
    Polygons
        The chart, whose first polygon is the sheet.

    Raises
    ------
    ValueError
        If the angle is outside its range, `size` isn't positive, or the reflectances aren't from
        0 to 1 with `dark` below `bright`.
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
