"""Draw strokes: curves (thesis Fig. 3.3), text, and both as they change with time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree

from optics.plane import Plane
from optics.targets.target import Drawing, Drawings, Target, format_micrometres
from optics.validation import require_positive

Points = NDArray[np.float64]
"""(n, 2): y and x of points along a curve, metres. One point is a dot. A curve is closed if its
last point is its first."""

_FAR = 6.0  # widths from a stroke beyond which nothing is drawn; 2e-8 of the peak is left there


def draw_strokes(strokes: Sequence[Points], width: float, sizes: str, remedy: str) -> Drawing:
    """Make the drawing of strokes; sizes and remedy are those of Drawing."""
    require_positive("width", width, "m")
    points = np.concatenate(strokes)
    (low_y, low_x), (high_y, high_x) = points.min(0), points.max(0)
    return Drawing(
        (float(low_y), float(high_y), float(low_x), float(high_x)),
        width,
        lambda plane: stroke_brightness(strokes, width, plane),
        sizes,
        remedy,
    )


def stroke_brightness(strokes: Sequence[Points], width: float, plane: Plane) -> torch.Tensor:
    """Compute exp(-d² / 2 width²), with d to the nearest stroke, on a plane, (rows, columns)."""
    # With points a quarter of a width apart, the error where strokes cross is below a hundredth.
    points, before, after = _join_strokes(strokes, 0.25 * width)
    y, x = (plane.coordinates(axis).numpy() for axis in (0, 1))
    low, high = points.min(0) - _FAR * width, points.max(0) + _FAR * width
    rows, columns = (
        slice(*np.searchsorted(axis, (low[i], high[i])).tolist()) for i, axis in enumerate((y, x))
    )
    places = np.stack(np.meshgrid(y[rows], x[columns], indexing="ij"), axis=-1).reshape(-1, 2)
    # Samples far from all strokes stay dark, and aren't searched.
    far, nearest = KDTree(points).query(places, distance_upper_bound=_FAR * width)
    seen = np.isfinite(far)
    places, nearest = places[seen], np.asarray(nearest)[seen]
    squared = np.minimum(
        _squared_distances(places, points[nearest], points[before[nearest]]),
        _squared_distances(places, points[nearest], points[after[nearest]]),
    )
    light = np.zeros(seen.size)
    light[seen] = np.exp(-squared / (2 * width**2))
    picture = np.zeros(plane.shape)
    picture[rows, columns] = light.reshape(rows.stop - rows.start, columns.stop - columns.start)
    return torch.from_numpy(picture)


def _join_strokes(
    strokes: Sequence[Points], spacing: float
) -> tuple[Points, NDArray[np.intp], NDArray[np.intp]]:
    """Join the points of all strokes, at most `spacing` apart.

    Returns the points and, for each, the indices of its neighbours before and after it along its
    stroke.
    """
    parts = list[Points]()
    before, after, count = list[NDArray[np.intp]](), list[NDArray[np.intp]](), 0
    for stroke in strokes:
        points = _densify_points(stroke, spacing)
        closed = len(points) > 1 and bool((points[0] == points[-1]).all())
        points = points[:-1] if closed else points
        n = len(points)
        index = np.arange(n)
        before.append(count + ((index - 1) % n if closed else np.maximum(index - 1, 0)))
        after.append(count + ((index + 1) % n if closed else np.minimum(index + 1, n - 1)))
        parts.append(points)
        count += n
    return np.concatenate(parts), np.concatenate(before), np.concatenate(after)


def _densify_points(points: Points, spacing: float) -> Points:
    """Add points to a curve so that they are at most `spacing` apart; keep its corners."""
    if len(points) == 1:
        return points
    steps = np.diff(points, axis=0)
    pieces = np.maximum(1, np.ceil(np.hypot(*steps.T) / spacing)).astype(int)
    share = np.concatenate([np.arange(n) / n for n in pieces])[:, None]
    between = np.repeat(points[:-1], pieces, 0) + share * np.repeat(steps, pieces, 0)
    return np.vstack([between, points[-1:]])


def _squared_distances(places: Points, start: Points, end: Points) -> Points:
    """Compute squared distances of points to segments, which may have zero length."""
    along = end - start
    length = (along**2).sum(1)
    share = ((places - start) * along).sum(1) / np.where(length > 0, length, 1.0)
    foot = start + np.clip(share, 0, 1)[:, None] * along
    return ((places - foot) ** 2).sum(1)


_POINTS = 720  # number of points along a closed curve, or per turn of an open one; chosen


@Target
def spiral(radius: float, width: float, turns: float = 3.0, hole: float = 0.36) -> Drawing:
    """Draw a spiral whose distance from the axis grows with the angle squared.

    The defaults are the spiral of the thesis' code: three turns, without the inner 18 of 50 pixels
    (cgtuebingen/computational_camera_phase_retrieval, target 0).

    Parameters
    ----------
    radius, width : float
        Largest distance from the axis, and standard deviation of the Gaussian across a
        stroke, metres.
    turns : float, default 3.0
        Number of turns, from the axis outwards.
    hole : float, default 0.36
        Share of the radius around the axis that is left out, 0 to less than 1.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If a size isn't positive, or `hole` is outside its range.
    """
    require_positive("turns", turns, "")
    if not 0 <= hole < 1:
        raise ValueError(f"hole is {hole:g}; it is a share of the radius, from 0 to below 1")
    end = 2 * math.pi * turns
    angle = np.linspace(math.sqrt(hole) * end, end, 2 + math.ceil(_POINTS * turns))
    return _draw_within_radius([_polar((angle / end) ** 2, angle)], radius, width)


@Target
def heart(radius: float, width: float) -> Drawing:
    """Draw an upright heart, whose farthest point is a radius from the axis.

    Parameters
    ----------
    radius, width : float
        Largest distance from the axis, and standard deviation of the Gaussian across a
        stroke, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.
    """
    t = np.linspace(0, 2 * math.pi, _POINTS)
    x = 16 * np.sin(t) ** 3
    y = -(13 * np.cos(t) - 5 * np.cos(2 * t) - 2 * np.cos(3 * t) - np.cos(4 * t))
    points = _close_curve(np.stack([y, x], 1))
    points = points - (points.min(0) + points.max(0)) / 2
    return _draw_within_radius([points / np.hypot(*points.T).max()], radius, width)


@Target
def infinity(radius: float, width: float) -> Drawing:
    """Draw an infinity sign: a horizontal lemniscate of Bernoulli, two radii long.

    Parameters
    ----------
    radius, width : float
        Half its length, and standard deviation of the Gaussian across a stroke, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.
    """
    t = np.linspace(0, 2 * math.pi, _POINTS)
    scale = 1 / (1 + np.sin(t) ** 2)
    points = np.stack([np.sin(t) * np.cos(t) * scale, np.cos(t) * scale], 1)
    return _draw_within_radius([_close_curve(points)], radius, width)


@Target
def eye(radius: float, width: float) -> Drawing:
    """Draw an eye: two lids with corners a radius from the axis, iris and pupil.

    Parameters
    ----------
    radius, width : float
        Distance of the lids' corners from the axis, and standard deviation of the Gaussian across a
        stroke, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.
    """
    height, iris, pupil = 0.5, 0.38, 0.1
    # Each lid is an arc of a circle through both corners and the lid's height.
    curvature = (1 + height**2) / (2 * height)
    half = math.asin(1 / curvature)
    angle = np.linspace(-half, half, _POINTS)
    lid = np.stack([curvature * np.cos(angle) - (curvature - height), curvature * np.sin(angle)], 1)
    around = np.linspace(0, 2 * math.pi, _POINTS)
    circles = [_close_curve(_polar(np.full(_POINTS, size), around)) for size in (iris, pupil)]
    return _draw_within_radius([lid, lid * [-1, 1], *circles], radius, width)


def _draw_within_radius(strokes: Sequence[Points], radius: float, width: float) -> Drawing:
    """Draw strokes, scaled from a circle of radius 1 to `radius` metres."""
    require_positive("radius", radius, "m")
    return draw_strokes(
        [radius * stroke for stroke in strokes],
        width,
        f"radius {format_micrometres(radius)} with width {format_micrometres(width)}",
        "choose a smaller radius",
    )


def _polar(distance: Points, angle: Points) -> Points:
    return np.stack([distance * np.sin(angle), distance * np.cos(angle)], 1)


def _close_curve(points: Points) -> Points:
    """Make the last point of a curve exactly the first."""
    return np.vstack([points[:-1], points[:1]])


# A point (x, y), or an arc (x, y, half width, half height, from, to).
#
# The arc's angles are in degrees, from x towards y.
_Pen = tuple[float, ...]

_O: list[_Pen] = [(2.1, 3, 2.1, 3, 0, 360)]
_P: list[_Pen] = [(0, 6), (0, 0), (2.4, 0), (2.4, 1.6, 1.5, 1.6, -90, 90), (0, 3.2)]
_SIX: list[_Pen] = [(3.3, 4.2, 3.3, 4.2, -90, -180), (2, 4.2, 2, 1.8, 180, 540)]

_LETTERS: dict[str, list[list[_Pen]]] = {
    "A": [[(0, 6), (2.2, 0), (4.4, 6)], [(0.75, 4), (3.65, 4)]],
    "B": [
        [(0, 3), (0, 0), (2.3, 0), (2.3, 1.5, 1.5, 1.5, -90, 90), (0, 3)],
        [(0, 3), (0, 6), (2.5, 6), (2.5, 4.5, 1.5, 1.5, 90, -90), (2.3, 3)],
    ],
    "C": [[(2.2, 3, 2.2, 3, -48, -312)]],
    "D": [[(0, 0), (1.5, 0), (1.5, 3, 2.6, 3, -90, 90), (0, 6), (0, 0)]],
    "E": [[(3.6, 0), (0, 0), (0, 6), (3.6, 6)], [(0, 3), (3, 3)]],
    "F": [[(3.6, 0), (0, 0), (0, 6)], [(0, 3), (3, 3)]],
    "G": [[(2.2, 3, 2.2, 3, -48, -360), (2.5, 3)]],
    "H": [[(0, 0), (0, 6)], [(4.2, 0), (4.2, 6)], [(0, 3), (4.2, 3)]],
    "I": [[(0, 0), (0, 6)]],
    "J": [[(2.8, 0), (2.8, 4.4), (1.4, 4.4, 1.4, 1.6, 0, 165)]],
    "K": [[(0, 0), (0, 6)], [(3.8, 0), (0, 3.9)], [(1.4, 2.46), (4, 6)]],
    "L": [[(0, 0), (0, 6), (3.4, 6)]],
    "M": [[(0, 6), (0, 0), (2.5, 4), (5, 0), (5, 6)]],
    "N": [[(0, 6), (0, 0), (4.2, 6), (4.2, 0)]],
    "O": [_O],
    "P": [_P],
    "Q": [_O, [(2.5, 4.2), (4.4, 6.3)]],
    "R": [_P, [(2, 3.2), (4, 6)]],
    "S": [[(2, 1.55, 1.8, 1.55, -25, -270), (2, 4.55, 2, 1.45, -90, 155)]],
    "T": [[(0, 0), (4.2, 0)], [(2.1, 0), (2.1, 6)]],
    "U": [[(0, 0), (0, 3.9), (2.1, 3.9, 2.1, 2.1, 180, 0), (4.2, 0)]],
    "V": [[(0, 0), (2.1, 6), (4.2, 0)]],
    "W": [[(0, 0), (1.5, 6), (3, 1), (4.5, 6), (6, 0)]],
    "X": [[(0, 0), (4, 6)], [(4, 0), (0, 6)]],
    "Y": [[(0, 0), (2.1, 3.1), (4.2, 0)], [(2.1, 3.1), (2.1, 6)]],
    "Z": [[(0, 0), (4, 0), (0, 6), (4, 6)]],
    "0": [[(1.8, 3, 1.8, 3, 0, 360)]],
    "1": [[(0, 1.4), (1.5, 0), (1.5, 6)]],
    "2": [[(1.9, 1.8, 1.8, 1.8, -165, 38), (0, 6), (3.9, 6)]],
    "3": [[(1.8, 1.55, 1.7, 1.55, -155, 90), (1.8, 4.55, 1.9, 1.45, -90, 155)]],
    "4": [[(3, 6), (3, 0), (0, 4.2), (4.1, 4.2)]],
    "5": [[(3.5, 0), (0.5, 0), (0.24, 2.78), (1.8, 4.1, 2, 1.9, -140, 155)]],
    "6": [_SIX],
    "7": [[(0, 0), (3.9, 0), (1.4, 6)]],
    "8": [[(2, 1.5, 1.6, 1.5, 0, 360)], [(2, 4.5, 2, 1.5, 0, 360)]],
    "+": [[(0, 3), (3, 3)], [(1.5, 1.5), (1.5, 4.5)]],
    "-": [[(0, 3), (2.6, 3)]],
    ".": [[(0, 6)]],
    "!": [[(0, 0), (0, 4.2)], [(0, 6)]],
    "?": [[(1.7, 1.7, 1.7, 1.7, -170, 60), (1.7, 4.3)], [(1.7, 6)]],
    "/": [[(0, 6), (2.8, 0)]],
}

HEIGHT = 6.0
"""Height of a capital letter in the font's units."""

AVAILABLE_SIGNS = "".join([*_LETTERS, "9"])
"""The signs of the font, without the blank."""


def strokes_of(text: str) -> list[Points]:
    """Return the strokes of a line of text, in the font's units.

    The origin is the upper left corner of the line. Small letters become capitals. Raises
    ValueError for text without a letter, digit or other sign, or with one that isn't in the font.
    """
    strokes, left = list[Points](), 0.0
    for sign in text.upper():
        if sign == " ":
            left += 2.4  # A blank is 2.4 units wide.
            continue
        made = _sign(sign)
        strokes += [stroke + np.array([0.0, left]) for stroke in made]
        # The gap between letters is 1.6 units wide.
        left += max(float(stroke[:, 1].max()) for stroke in made) + 1.6
    if not strokes:
        raise ValueError(f"text is {text!r}; give one sign at least")
    return strokes


def _sign(sign: str) -> list[Points]:
    """Return the strokes of one letter or other sign."""
    if sign == "9":
        return [[HEIGHT, 4.0] - stroke for stroke in _sign("6")]
    if sign not in _LETTERS:
        raise ValueError(f"text has {sign!r}; there are {AVAILABLE_SIGNS} and blanks")
    strokes = []
    for pens in _LETTERS[sign]:
        parts = [_arc(*pen) if len(pen) == 6 else np.array([[pen[1], pen[0]]]) for pen in pens]
        path = np.concatenate(parts)
        if np.allclose(path[0], path[-1]):
            path[-1] = path[0]
        strokes.append(path)
    return strokes


def _arc(x: float, y: float, width: float, height: float, first: float, last: float) -> Points:
    step = 6.0  # The points are 6 degrees apart.
    angle = np.deg2rad(np.linspace(first, last, 2 + round(abs(last - first) / step)))
    return np.stack([y + height * np.sin(angle), x + width * np.cos(angle)], 1)


@Target
def letters(text: str, height: float, width: float) -> Drawing:
    """Draw a line of text, centred on the axis: letters, digits and blanks.

    Parameters
    ----------
    text : str
        Signs of the font; small letters become capitals.
    height, width : float
        Height of a capital, and standard deviation of the Gaussian across a stroke, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If the text has no sign, or one that isn't in the font.
    """
    require_positive("height", height, "m")
    strokes = [stroke * (height / HEIGHT) for stroke in strokes_of(text)]
    points = np.concatenate(strokes)
    middle = (points.min(0) + points.max(0)) / 2
    long = float(np.ptp(points[:, 1]))
    return draw_strokes(
        [stroke - middle for stroke in strokes],
        width,
        f"text of {format_micrometres(long)} with height {format_micrometres(height)} and width "
        f"{format_micrometres(width)}",
        "choose a smaller height",
    )


@Target
def shrinking_spiral(
    radius: float,
    width: float,
    moments: int,
    smallest: float = 0.4,
    turns: float = 3.0,
    hole: float = 0.36,
) -> Drawings:
    """Draw a spiral that shrinks linearly with time, (moments, rows, columns) (thesis Fig. 3.4).

    Parameters
    ----------
    radius, width : float
        Radius at the first moment, and standard deviation of the Gaussian across a stroke, metres.
    moments : int
        Number of pictures, 2 or more.
    smallest : float, default 0.4
        Share of the radius that is left at the last moment, above 0 and up to 1.
    turns, hole : float, default 3.0 and 0.36
        As for `spiral`, at every moment.

    Returns
    -------
    Drawings
        One picture per moment, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If there are fewer than 2 moments, or a size is outside its range.
    """
    if moments < 2:
        raise ValueError(f"moments is {moments}; what changes with time has two at least")
    if not 0 < smallest <= 1:
        raise ValueError(f"smallest is {smallest:g}; it is a share of the radius, above 0")

    def at(moment: int) -> Drawing:
        share = 1 - (1 - smallest) * moment / (moments - 1)
        return spiral.draw(share * radius, width, turns, hole)

    return Drawings([at(moment) for moment in range(moments)])
