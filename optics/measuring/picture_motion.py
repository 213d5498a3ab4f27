"""How a hand-held picture moved, a shift and a turn, and what it shows at a reference's places."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotion:
    """Where a frame sees what a reference frame sees at a place.

    Places are in pixels from the picture's centre, (row, column). A place x of the reference is
    seen at R x + (down, right), where R turns rows to columns by the angle `turn`.

    Parameters
    ----------
    turn : float, default 0
        Radians.
    down, right : float, default 0
        Pixels.
    """

    turn: float = 0.0
    down: float = 0.0
    right: float = 0.0

    @property
    def matrix(self) -> Array:
        """The turn as a matrix, (2, 2), of (row, column)."""
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return np.array([[cos, -sin], [sin, cos]])

    @property
    def shift(self) -> Array:
        """The shift, (row, column), pixels."""
        return np.array([self.down, self.right])

    def places(self, at: Array) -> Array:
        """Return where the moved frame sees places of the reference, (2, places), pixels."""
        return np.asarray(self.matrix @ at + self.shift[:, None])

    def after(self, first: RigidMotion) -> RigidMotion:
        """Return the motion that does another one first, and then this one."""
        shift = self.matrix @ first.shift + self.shift
        return RigidMotion(self.turn + first.turn, float(shift[0]), float(shift[1]))

    def inverse(self) -> RigidMotion:
        """Return the motion that undoes this one."""
        shift = -self.matrix.T @ self.shift
        return RigidMotion(-self.turn, float(shift[0]), float(shift[1]))

    def corner_distance(self, other: RigidMotion, shape: tuple[int, ...]) -> float:
        """Return by how many pixels two motions differ at the corners of a picture, at most.

        shape: rows and columns of the picture.
        """
        rows, columns = ((n - 1) / 2 for n in shape)
        corners = np.array([[-rows, -rows, rows, rows], [-columns, columns, -columns, columns]])
        away = self.places(corners) - other.places(corners)
        return float(np.hypot(*away).max())


_ROWS = 256  # resampled together, which saves memory; chosen
# A cubic spline's weights of pixels farther away are below 5 % of the nearest one's
_REACH = np.ones((3, 3), dtype=bool)


def resample_moved(
    picture: NDArray[np.generic], motion: RigidMotion, clipped: NDArray[np.bool_]
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return what a moved picture shows at the places of the reference.

    Values are interpolated by cubic splines, which lets details as fine as pixels can show pass.
    The noise of a value is less than a pixel's, and shared by neighbours.

    Parameters
    ----------
    picture : NDArray
        (rows, columns).
    motion : RigidMotion
        From the reference to the picture.
    clipped : NDArray of bool
        Pixels of the picture whose value isn't known.

    Returns
    -------
    values : NDArray
        (rows, columns) of the reference, float32.
    clipped : NDArray of bool
        Where a value rests on a clipped pixel.
    outside : NDArray of bool
        Where the picture shows nothing.
    """
    shape = np.array(picture.shape)
    middle = (shape[:, None] - 1) / 2
    spline = ndimage.spline_filter(picture.astype(np.float32), 3, np.float32, mode="mirror")
    near = ndimage.binary_dilation(clipped, _REACH)
    values = np.empty(picture.shape, np.float32)
    rests, outside = np.zeros((2, *picture.shape), dtype=bool)
    for start in range(0, picture.shape[0], _ROWS):
        here = slice(start, start + _ROWS)
        part = values[here]
        at = np.indices(part.shape, dtype=np.float64).reshape(2, -1)
        at[0] += start
        at = motion.places(at - middle) + middle
        seen = ndimage.map_coordinates(spline, at, np.float32, 3, mode="mirror", prefilter=False)
        part[:] = seen.reshape(part.shape)
        beyond = ((at < 0) | (at > shape[:, None] - 1)).any(axis=0)
        row, column = np.clip(np.rint(at).astype(np.intp), 0, shape[:, None] - 1)
        rests[here] = (near[row, column] & ~beyond).reshape(part.shape)
        outside[here] = beyond.reshape(part.shape)
    return values, rests, outside


Mask = NDArray[np.bool_]
Picture = NDArray[np.float32]

# Pixels, standard deviation before slopes are taken: it lessens noise and blocks' edges; chosen
_BLUR = 0.7
_COARSEST = 40  # least side of the coarsest picture: a tenth of it is a few of its pixels; chosen
# Steepest pixels that are compared at each level; more change corners by < .01 pixel
_POINTS = 150_000
_REGIONS = 8  # along each side, each with its steepest pixels: all of them tell the turn
# Most Gauss-Newton steps of a level, and pixels at the corners at which they end
_STEPS, _STILL = 12, 2e-3
_STRAY = 2.0  # robust deviations at which a pixel's weight is a fourth
# Variance of slopes that white noise makes after the blur: squares of both kernels' product
_NOISE = 0.32
# Of one picture's numbers that the other may have: a light that but rises tells no shift; chosen
_POWERS = 4
_LEAST_POINTS = 200  # pixels that two pictures share from which on their motion is told; chosen
# Deviation over that of independent pixels: blur and compression; chosen on photographs
_CORRELATED = 3.0


@dataclass(frozen=True)
class Registration:
    """How a picture moved against another, and how well that is known.

    Parameters
    ----------
    motion : RigidMotion
        From the fixed picture to the moving one.
    deviation : float
        Standard deviation at the corners, pixels; infinite if the pictures share too little detail.
    """

    motion: RigidMotion
    deviation: float


def register_pictures(
    fixed: Sequence[Picture],
    moving: Sequence[Picture],
    fixed_valid: Sequence[Mask],
    moving_valid: Sequence[Mask],
    start: RigidMotion | None = None,
) -> Registration:
    """Find the shift and turn between two pictures of one scene.

    Parameters
    ----------
    fixed, moving : sequence of NDArray
        Bands, each (rows, columns), of one size. Each band shows the scene in numbers that differ
        by a smooth curve only, near a straight line.
    fixed_valid, moving_valid : sequence of NDArray of bool
        Where they do: clipped pixels aren't.
    start : RigidMotion, optional
        To begin with; none moved by default.

    Returns
    -------
    Registration
        With the motion that it began with, if nothing better is known.

    Raises
    ------
    ValueError
        For pictures of different sizes.
    """
    shapes = {np.shape(one) for one in (*fixed, *moving, *fixed_valid, *moving_valid)}
    if len(shapes) != 1 or len(fixed) != len(moving):
        raise ValueError(f"pictures are {sorted(shapes)} pixels; give bands of one size")
    (shape,) = shapes
    pictures = [np.stack([np.asarray(band, np.float32) for band in one]) for one in (fixed, moving)]
    masks = [np.stack(list(one)) for one in (fixed_valid, moving_valid)]
    levels = [(*pictures, *masks)]
    while min(pictures[0].shape[1:]) >= 2 * _COARSEST:
        pictures, masks = [_halved(one) for one in pictures], [_halved(one) == 1 for one in masks]
        levels.append((*pictures, *masks))
    found = Registration(start or RigidMotion(), math.inf)
    for number in reversed(range(len(levels))):
        parts = [_BandPoints(one, number, shape) for one in zip(*levels[number], strict=True)]
        found = _register_level(parts, number, shape, found.motion)
    return found


def _halved(bands: NDArray[np.generic]) -> Picture:
    """Return the means of 2 x 2 pixels of each band."""
    count, rows, columns = (n // side for n, side in zip(bands.shape, (1, 2, 2), strict=True))
    even = bands[:, : 2 * rows, : 2 * columns].reshape(count, rows, 2, columns, 2)
    return np.asarray(even.mean(axis=(2, 4), dtype=np.float32))


def _register_level(
    parts: list[_BandPoints], number: int, shape: tuple[int, ...], start: RigidMotion
) -> Registration:
    """Find the motion at a level of the pyramid of pictures, halved `number` times."""
    motion, deviation = start, math.inf
    for _ in range(_STEPS):
        matrices, vectors, counts, noises = zip(*(one.system(motion) for one in parts), strict=True)
        matrix = np.sum(matrices, axis=0)
        if sum(counts) < _LEAST_POINTS or np.linalg.cond(matrix) > 1e12:
            return Registration(start, math.inf)
        turn, down, right = np.linalg.solve(matrix, np.sum(vectors, axis=0)).tolist()
        before = motion
        motion = RigidMotion(
            motion.turn + turn / _radius(shape), motion.down + down, motion.right + right
        )
        information, deviation = matrix - np.sum(noises, axis=0), math.inf
        if np.linalg.eigvalsh(information)[0] > 0:
            deviation = _CORRELATED * math.sqrt(np.trace(np.linalg.inv(information)))
        if motion.corner_distance(before, shape) < _STILL * 2**number:
            break
    return Registration(motion if math.isfinite(deviation) else start, deviation)


def _radius(shape: tuple[int, ...]) -> float:
    """Return the distance of a picture's corners from its centre, pixels."""
    return math.hypot(*((n - 1) / 2 for n in shape))


class _BandPoints:
    """The pixels of one band that are compared, with slopes of the fixed picture."""

    def __init__(
        self, pictures: tuple[NDArray[Any], ...], number: int, shape: tuple[int, ...]
    ) -> None:
        fixed, moving, fixed_valid, moving_valid = pictures
        self._scale, self._radius = 2.0**number, _radius(shape)
        # Place of a halved picture's first pixel in the finest one, from its centre.
        self._first = np.array([(self._scale - 1) / 2 - (n - 1) / 2 for n in shape])[:, None]
        smooth = ndimage.gaussian_filter(fixed, _BLUR, mode="nearest")
        reach = np.ones((5, 5) if number == 0 else (3, 3), dtype=bool)
        valid = ndimage.binary_erosion(fixed_valid, reach)
        slopes = np.array([_slope(smooth, axis) for axis in (0, 1)])
        at = _steepest(np.hypot(*slopes), valid)
        self._at = np.array(at, dtype=np.float64)
        self._fixed, self._slopes = smooth[at], np.array([one[at] for one in slopes]) / self._scale
        blurred = ndimage.gaussian_filter(moving, _BLUR, mode="nearest")
        self._moving = ndimage.spline_filter(blurred, 3, np.float32, mode="mirror")
        self._valid = ndimage.binary_erosion(moving_valid, reach)

    def system(self, motion: RigidMotion) -> tuple[Array, Array, int, Array]:
        """Return normal equations of the motion's change, over the variance, and their pixels.

        Unknowns are turn times the picture's radius, down and right, all in pixels. The last value
        is what the slopes of mere noise would add to the matrix.
        """
        place = self._at * self._scale + self._first
        seen = (motion.places(place) - self._first) / self._scale
        nearest = np.rint(seen).astype(np.intp)
        shape = np.array(self._valid.shape)[:, None]
        inside = ((nearest >= 1) & (nearest < shape - 1)).all(axis=0)
        inside[inside] = self._valid[tuple(nearest[:, inside])]
        count = int(inside.sum())
        if count < _LEAST_POINTS:
            return np.zeros((3, 3)), np.zeros(3), 0, np.zeros((3, 3))
        values = ndimage.map_coordinates(
            self._moving, seen[:, inside], np.float32, order=3, mode="mirror", prefilter=False
        )
        place, slopes = place[:, inside], motion.matrix @ self._slopes[:, inside]
        turned = np.stack([-place[1], place[0]])
        turning = np.einsum("ij,ij->j", slopes, motion.matrix @ turned) / self._radius
        share = (values - values.mean()) / max(float(values.std()), 1e-6)
        design = np.stack([turning, *slopes, *(share**power for power in range(_POWERS))])
        wanted = self._fixed[inside].astype(np.float64)
        weight = np.ones(count)
        for _ in range(2):
            # The moving picture's gain, level and curve are found with the motion.
            matrix = (design * weight) @ design.T
            unknown = np.linalg.lstsq(matrix, (design * weight) @ wanted, rcond=None)[0]
            left = wanted - unknown[3:] @ design[3:]
            spread = max(1.4826 * float(np.median(np.abs(left))), 1e-6)
            weight = 1 / (1 + (left / (_STRAY * spread)) ** 2) ** 2
        matrix = (design * weight) @ design.T
        right = (design * weight) @ wanted
        # The curve is eliminated.
        other = matrix[:3, 3:] @ np.linalg.pinv(matrix[3:, 3:], hermitian=True)
        variance = float(weight @ left**2 / weight.sum()) + 1e-9
        noise = [weight @ (turned**2).sum(axis=0) / self._radius**2, *[weight.sum()] * 2]
        information = (matrix[:3, :3] - other @ matrix[3:, :3]) / variance
        vector = (right[:3] - other @ right[3:]) / variance
        return information, vector, count, np.diag(noise) * _NOISE


def _slope(picture: Picture, axis: int) -> Picture:
    """Return the slope along an axis: central, smoothed across (Scharr's)."""
    along = ndimage.correlate1d(picture, [-0.5, 0, 0.5], axis, mode="nearest")
    return np.asarray(ndimage.correlate1d(along, [3 / 16, 10 / 16, 3 / 16], 1 - axis))


def _steepest(slope: Picture, valid: Mask) -> tuple[NDArray[np.intp], ...]:
    """Return rows and columns of the steepest valid pixels of each region."""
    if valid.sum() <= _POINTS:
        return tuple(np.nonzero(valid))
    chosen = np.zeros_like(valid)
    edges = [np.linspace(0, n, _REGIONS + 1).astype(int) for n in valid.shape]
    rows, columns = ([slice(*pair) for pair in itertools.pairwise(one)] for one in edges)
    for part in itertools.product(rows, columns):
        found = np.where(valid[part], slope[part], -1).ravel()
        each = min(_POINTS // _REGIONS**2, found.size)
        few = np.argpartition(found, -each)[-each:]
        flags = np.zeros(found.size, dtype=bool)
        flags[few] = found[few] >= 0
        chosen[part] = flags.reshape(chosen[part].shape)
    return tuple(np.nonzero(chosen))
