"""The USAF resolution test chart of 1951."""

from __future__ import annotations

from simulator.scene.charts.tones import INK, PAPER, require_tones
from simulator.scene.polygons import Corners, Polygons, rectangle

_ELEMENTS = 6
"""Number of elements in a group."""


def line_pairs(group: int, element: int) -> float:
    """Return the line pairs per metre of an element of the USAF chart.

    An element has 2^(group + (element - 1) / 6) line pairs per millimetre.

    Parameters
    ----------
    group : int
        Number of the group.
    element : int
        Number of the element in its group, 1 to 6.

    Returns
    -------
    float
        Line pairs per metre.

    Raises
    ------
    ValueError
        If the element isn't 1 to 6.

    References
    ----------
    MIL-STD-150A, 1959.

    Examples
    --------
    >>> line_pairs(1, 1)
    2000.0
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
    """Draw the USAF resolution chart of 1951: groups of three-bar elements.

    An element has three level bars on the left and three upright bars on the right. Bars are as
    wide as the gaps between them and five times as long. Each group is a column of elements.

    Parameters
    ----------
    groups : tuple of int, default (-2, 1)
        The first and the last group, from -4 to 9, ascending.
    dark, bright : float
        Reflectances of bars and sheet, 0 to 1, by default those of ink and paper.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the chart's middle relative to the axis, metres on the object.

    Returns
    -------
    Polygons
        The chart, whose first polygon is the sheet. The sheet's margin is two widths of the widest
        bar.

    Raises
    ------
    ValueError
        If the groups are outside their range or descend, or the reflectances aren't from 0 to 1
        with `dark` below `bright`.
    """
    require_tones(dark, bright)
    first, last = groups
    if not -4 <= first <= last <= 9:
        raise ValueError(f"groups are {first} to {last}; give -4 to 9, the coarser first")
    placed, (height, width) = _element_layout(first, last)
    margin = 2.0 * _bar(first, 1)
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
    """Return the width of an element's bar in metres: half of a line pair."""
    return 0.5 / line_pairs(group, element)


def _element_layout(
    first: int, last: int
) -> tuple[list[tuple[tuple[float, float], float]], tuple[float, float]]:
    """Place the elements: return their upper left corners with bar widths, and the total size.

    The size is (height, width). All lengths are in metres.
    """
    placed, x, height = [], 0.0, 0.0
    for group in range(first, last + 1):
        y = 0.0
        for element in range(1, _ELEMENTS + 1):
            bar = _bar(group, element)
            placed.append(((y, x), bar))
            # An element is five bar widths high; two more separate it from the next element.
            y += 7 * bar
        height = max(height, y - 2 * bar)
        x += (5 + 2 + 5 + 3) * _bar(group, 1)
    return placed, (height, x - 3 * _bar(last, 1))


def _bars(
    corner: tuple[float, float], bar: float
) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return centre and size of an element's six bars, the three level ones first."""
    y, x = corner
    steps = [(2 * k + 0.5) * bar for k in range(3)]
    level = [((y + s, x + 2.5 * bar), (bar, 5 * bar)) for s in steps]
    upright = [((y + 2.5 * bar, x + 7 * bar + s), (5 * bar, bar)) for s in steps]
    return level + upright
