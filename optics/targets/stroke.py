"""Draw targets as strokes with a Gaussian profile, equally bright along curves and at crossings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree

from optics.plane import Plane
from optics.targets.target import Drawing
from optics.validation import require_positive

Points = NDArray[np.float64]
"""(n, 2): y and x of points along a curve, metres. One point is a dot. A curve is closed if its
last point is its first."""

_FAR = 6.0
"""Widths from a stroke beyond which nothing is drawn; 2e-8 of the peak is left there."""


def draw_strokes(strokes: Sequence[Points], width: float, sizes: str, remedy: str) -> Drawing:
    """Make a target's drawing of strokes; sizes and remedy are those of Drawing."""
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
    """Compute the brightness exp(-d² / 2 width²) of a target drawn by strokes.

    d is the distance to the nearest stroke. The result is (rows, columns).
    """
    # With points a quarter of a width apart, the error where strokes cross is below a hundredth.
    points, before, after = _join_strokes(strokes, 0.25 * width)
    y, x = (plane.coordinates(axis).numpy() for axis in (0, 1))
    rows, columns = (
        _samples_near(axis, points[:, i], _FAR * width) for i, axis in enumerate((y, x))
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


def _samples_near(axis: Points, points: Points, far: float) -> slice:
    """Return the range of an axis' samples that are near any stroke of a target."""
    low, high = points.min() - far, points.max() + far
    return slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high)))


def _join_strokes(
    strokes: Sequence[Points], spacing: float
) -> tuple[Points, NDArray[np.intp], NDArray[np.intp]]:
    """Join the points of all strokes of a target, at most `spacing` apart.

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
    """Add points to a target's curve so that they are at most `spacing` apart; keep its corners."""
    if len(points) == 1:
        return points
    steps = np.diff(points, axis=0)
    pieces = np.maximum(1, np.ceil(np.hypot(*steps.T) / spacing)).astype(int)
    share = np.concatenate([np.arange(n) / n for n in pieces])[:, None]
    between = np.repeat(points[:-1], pieces, 0) + share * np.repeat(steps, pieces, 0)
    return np.vstack([between, points[-1:]])


def _squared_distances(places: Points, start: Points, end: Points) -> Points:
    """Compute squared distances of points to segments of a target's stroke.

    A segment may have zero length.
    """
    along = end - start
    length = (along**2).sum(1)
    share = ((places - start) * along).sum(1) / np.where(length > 0, length, 1.0)
    foot = start + np.clip(share, 0, 1)[:, None] * along
    return ((places - foot) ** 2).sum(1)
