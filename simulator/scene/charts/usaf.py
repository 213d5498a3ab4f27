"""The resolution chart of the USAF, 1951."""

from __future__ import annotations

from simulator.scene.charts.tones import INK, PAPER, require_tones
from simulator.scene.polygons import Corners, Polygons, rectangle

_ELEMENTS = 6
_MARGIN = 2.0
"""Of the sheet around the bars, in widths of the widest bar."""


def line_pairs(group: int, element: int) -> float:
    """Line pairs a metre of an element: 2^(group + (element - 1) / 6) a millimetre.

    (MIL-STD-150A, 1959.) Raises ValueError for an element that isn't 1 to 6.
    """
    if not 1 <= element <= _ELEMENTS:
        raise ValueError(f"element is {element}; a group has elements 1 to {_ELEMENTS}")
    return 1e3 * 2 ** (group + (element - 1) / _ELEMENTS)


def usaf_1951(
    groups: tuple[int, int] = (-2, 1),
    *,
    dark: float = INK,
    bright: float = PAPER,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Polygons:
    """Three bars as wide as the gaps between them and five times as long, upright and level.

    groups: the first and the last; dark bars on a bright sheet. Each group is a column, its
    elements one below the other; level bars stand on the left. Raises ValueError for groups
    that aren't between -4 and 9, or run backwards.
    """
    require_tones(dark, bright)
    first, last = groups
    if not -4 <= first <= last <= 9:
        raise ValueError(f"groups are {first} to {last}; give -4 to 9, the coarser first")
    placed, (height, width) = _element_layout(first, last)
    margin = _MARGIN * _bar(first, 1)
    sheet = rectangle(offset, (height + 2 * margin, width + 2 * margin))
    start = (offset[0] - height / 2, offset[1] - width / 2)
    bars = [
        rectangle((start[0] + y, start[1] + x), size)
        for (corner, bar) in placed
        for (y, x), size in _bars(corner, bar)
    ]
    corners: tuple[Corners, ...] = (sheet, *bars)
    return Polygons(corners, (bright, *[dark - bright] * len(bars)))


def _bar(group: int, element: int) -> float:
    """Metres: half of a line pair."""
    return 0.5 / line_pairs(group, element)


def _element_layout(
    first: int, last: int
) -> tuple[list[tuple[tuple[float, float], float]], tuple[float, float]]:
    """Upper left corners of all elements with their bars' widths, and (height, width) of all."""
    placed, x, height = [], 0.0, 0.0
    for group in range(first, last + 1):
        y = 0.0
        for element in range(1, _ELEMENTS + 1):
            bar = _bar(group, element)
            placed.append(((y, x), bar))
            # Five bars high, and two between elements.
            y += 7 * bar
        height = max(height, y - 2 * bar)
        x += (5 + 2 + 5 + 3) * _bar(group, 1)
    return placed, (height, x - 3 * _bar(last, 1))


def _bars(
    corner: tuple[float, float], bar: float
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Centres and (height, width) of an element's three level and three upright bars."""
    y, x = corner
    steps = [(2 * k + 0.5) * bar for k in range(3)]
    level = [((y + s, x + 2.5 * bar), (bar, 5 * bar)) for s in steps]
    upright = [((y + 2.5 * bar, x + 7 * bar + s), (5 * bar, bar)) for s in steps]
    return level + upright
