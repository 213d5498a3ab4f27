"""Test charts as polygons, which are drawn without sampling error.

The first polygon of each chart is the sheet that it is printed on; see outline().
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from optics.light.spectrum import Spectrum
from optics.validation import require_positive
from simulator.scene.colours import extend_to_silicon_range
from simulator.scene.cube import factorise_spectra
from simulator.scene.polygons import Polygons, rectangle
from simulator.scene.sheets import PaintedPicture

__all__ = ["checker", "line_pairs", "outline", "siemens_star", "slanted_edge", "usaf_1951"]

_PAPER, _INK = 0.9, 0.05  # approximate reflectances of white paper and of black ink


def _require_tones(dark: float, bright: float) -> None:
    """Raise ValueError unless `dark` and `bright` are reflectances, the darker first."""
    if not 0 <= dark < bright <= 1:
        raise ValueError(
            f"dark is {dark:g} and bright is {bright:g}; give reflectances from 0 to 1, the "
            "darker first"
        )


def outline(chart: Polygons) -> Polygons:
    """Return the sheet that a chart is printed on, as the cover of a `Sheet`.

    Parameters
    ----------
    chart : Polygons
        A chart of this module, whose first polygon is its sheet.

    Returns
    -------
    Polygons
        The sheet with the value 1: it hides everything behind it.
    """
    return Polygons(chart.corners[:1], (1.0,))


def slanted_edge(
    size: float,
    angle: float = math.radians(5),
    *,
    dark: float = _INK,
    bright: float = _PAPER,
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
        For a number outside its range, or `dark` not below `bright`.
    """
    require_positive("size", size, "m")
    _require_tones(dark, bright)
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


def siemens_star(
    diameter: float,
    spokes: int = 36,
    *,
    dark: float = _INK,
    bright: float = _PAPER,
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
    dark, bright, offset : optional
        Of spokes, sheet and star; see `slanted_edge`.

    Returns
    -------
    Polygons
        The chart, whose first polygon is the sheet.

    Raises
    ------
    ValueError
        For a number outside its range, or `dark` not below `bright`.
    """
    require_positive("diameter", diameter, "m")
    _require_tones(dark, bright)
    if spokes < 2:
        raise ValueError(f"spokes is {spokes}; a star has 2 or more")
    # A polygon of n edges replaces a spoke's arc. Its corners lie a little outside of the radius,
    # so that its area is that of the sector.
    width, n = math.pi / spokes, 16
    outer = diameter / 2 * math.sqrt(width / (n * math.sin(width / n)))
    wedges = []
    for index in range(spokes):
        arc = [2 * index * width + width * k / n for k in range(n + 1)]
        rim = ((offset[0] + outer * math.sin(a), offset[1] + outer * math.cos(a)) for a in arc)
        wedges.append((offset, *rim))
    side = 1.1 * diameter
    sheet = rectangle(offset, (side, side))
    return Polygons((sheet, *wedges), (bright, *[dark - bright] * spokes))


_ELEMENTS = 6  # number of elements in a group


def line_pairs(group: int, element: int) -> float:
    """Return the line pairs per metre of an element of the USAF chart.

    An element has 2^(group + (element - 1) / 6) line pairs per millimetre.

    Parameters
    ----------
    group, element : int
        Numbers of the group, and of the element in it, 1 to 6.

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
    dark: float = _INK,
    bright: float = _PAPER,
    offset: tuple[float, float] = (0.0, 0.0),
) -> Polygons:
    """Draw the USAF resolution chart of 1951: groups of three-bar elements.

    An element has three level bars on the left and three upright bars on the right. Bars are as
    wide as the gaps between them and five times as long. Each group is a column of elements.

    Parameters
    ----------
    groups : tuple of int, default (-2, 1)
        The first and the last group, from -4 to 9, ascending.
    dark, bright, offset : optional
        Of bars, sheet and chart; see `slanted_edge`.

    Returns
    -------
    Polygons
        The chart, whose first polygon is the sheet, with a margin of two widest bars.

    Raises
    ------
    ValueError
        For groups outside their range or descending, or `dark` not below `bright`.
    """
    _require_tones(dark, bright)
    first, last = groups
    if not -4 <= first <= last <= 9:
        raise ValueError(f"groups are {first} to {last}; give -4 to 9, the coarser first")
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
    width = x - 3 * _bar(last, 1)
    margin = 2.0 * _bar(first, 1)
    sheet = rectangle(offset, (height + 2 * margin, width + 2 * margin))
    start = (offset[0] - height / 2, offset[1] - width / 2)
    bars = [
        rectangle((start[0] + y, start[1] + x), size)
        for corner, bar in placed
        for (y, x), size in _bars(corner, bar)
    ]
    return Polygons((sheet, *bars), (bright, *[dark - bright] * len(bars)))


def _bar(group: int, element: int) -> float:
    """Return the width of an element's bar in metres: half of a line pair."""
    return 0.5 / line_pairs(group, element)


def _bars(
    corner: tuple[float, float], bar: float
) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Yield centre and size of an element's six bars, the three level ones first."""
    y, x = corner
    steps = [(2 * k + 0.5) * bar for k in range(3)]
    yield from (((y + s, x + 2.5 * bar), (bar, 5 * bar)) for s in steps)
    yield from (((y + 2.5 * bar, x + 7 * bar + s), (5 * bar, bar)) for s in steps)


def checker(
    reflectances: Sequence[Spectrum], width: float, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[PaintedPicture, ...]:
    """Draw a chart of 24 coloured patches in four rows of six, framed in black.

    Parameters
    ----------
    reflectances : sequence of Spectrum
        Reflectances of the 24 patches, row by row from the upper left, all at the same
        wavelengths.
    width : float
        Width of the chart in metres, positive.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the chart's middle relative to the axis, metres on the object.

    Returns
    -------
    tuple of tuple
        Pairs of a reflectance and a picture, which add up; see `Sheet`.

    Raises
    ------
    ValueError
        For other reflectances, or a width that isn't positive.
    """
    require_positive("width", width, "m")
    rows, columns = 4, 6
    if len(reflectances) != rows * columns:
        raise ValueError(
            f"{len(reflectances)} reflectances are given; the chart has {rows * columns} patches"
        )
    wavelengths = reflectances[0].wavelengths
    if any(one.wavelengths != wavelengths for one in reflectances):
        raise ValueError("the patches' wavelengths differ; give all at the same ones")
    frame_reflectance = 0.03
    samples = [(frame_reflectance,) * len(wavelengths), *(one.values for one in reflectances)]
    # Tables of reflectances have three decimals, so a smaller error than 3e-3 isn't needed.
    weights, basis = factorise_spectra(np.array(samples), 3e-3)
    (y, x), step = offset, width / columns
    side = 0.85 * step
    sheet = rectangle(offset, (rows * step, width))
    patches = [
        rectangle((y + j * step, x + i * step), (side, side))
        for j in (np.arange(rows) - (rows - 1) / 2).tolist()
        for i in (np.arange(columns) - (columns - 1) / 2).tolist()
    ]
    # A patch's value is its difference from the frame's, because overlapping polygons add up.
    return tuple(
        (
            extend_to_silicon_range(Spectrum(wavelengths, tuple(one))),
            Polygons((sheet, *patches), (w[0], *(w[1:] - w[0]))),
        )
        for one, w in zip(basis, weights.T, strict=True)
    )
