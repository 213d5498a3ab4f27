"""Draw target shapes of curved strokes: spiral, heart, infinity, eye (thesis Fig. 3.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optics.targets.stroke import Points, draw_strokes
from optics.targets.target import Drawing, Target, format_micrometres
from optics.validation import require_positive

_POINTS = 720
"""Number of points along a closed curve, or per turn of an open one; chosen."""


@Target
def spiral(radius: float, width: float, turns: float = 3.0, hole: float = 0.36) -> Drawing:
    """Draw a spiral target whose distance from the axis grows with the angle squared.

    The defaults are the spiral of the thesis' code: three turns, without the inner 18 of 50 pixels
    (cgtuebingen/computational_camera_phase_retrieval, target 0).

    Parameters
    ----------
    radius : float
        Largest distance from the axis, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.
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
    """Draw an upright heart target, whose farthest point is a radius from the axis.

    Parameters
    ----------
    radius : float
        Largest distance from the axis, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.

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
    """Draw an infinity sign as a target: a horizontal lemniscate of Bernoulli, two radii long.

    Parameters
    ----------
    radius : float
        Half its length, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.

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
    """Draw an eye as a target: two lids with corners a radius from the axis, iris and pupil.

    Parameters
    ----------
    radius : float
        Distance of the lids' corners from the axis, metres.
    width : float
        Standard deviation of the Gaussian across a stroke, metres.

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
    """Draw strokes, scaled from a circle of radius 1 to `radius` metres, as a target."""
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
    """Close the curve of a target: make its last point exactly the first."""
    return np.vstack([points[:-1], points[:1]])
