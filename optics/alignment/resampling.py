"""Resample a picture that moved at the places of a reference picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from optics.alignment.rigid_motion import RigidMotion

_ROWS = 256
"""Rows that are resampled together, which saves memory. Chosen."""

_REACH = np.ones((3, 3), dtype=bool)
"""Pixels around a place whose clipping reaches it: a cubic spline's weights of others are below 5 %
of the nearest one's."""


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
    rests, outside = (np.zeros(picture.shape, dtype=bool) for _ in range(2))
    for start in range(0, picture.shape[0], _ROWS):
        part = values[start : start + _ROWS]
        at = np.indices(part.shape, dtype=np.float64).reshape(2, -1)
        at[0] += start
        at = motion.places(at - middle) + middle
        part[:] = ndimage.map_coordinates(
            spline, at, np.float32, order=3, mode="mirror", prefilter=False
        ).reshape(part.shape)
        beyond = ((at < 0) | (at > shape[:, None] - 1)).any(axis=0)
        row, column = np.clip(np.rint(at).astype(np.intp), 0, shape[:, None] - 1)
        rests[start : start + _ROWS] = (near[row, column] & ~beyond).reshape(part.shape)
        outside[start : start + _ROWS] = beyond.reshape(part.shape)
    return values, rests, outside
