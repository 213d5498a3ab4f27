"""Describe how a hand-held frame moved: a turn about the picture's centre, and a shift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        """Return the rigid motion's turn as a matrix, (2, 2), of (row, column)."""
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        return np.array([[cos, -sin], [sin, cos]])

    @property
    def shift(self) -> Array:
        """Return the rigid motion's shift, (row, column), pixels."""
        return np.array([self.down, self.right])

    def places(self, at: Array) -> Array:
        """Return where the moved frame sees places of the reference, (2, places), pixels."""
        return np.asarray(self.matrix @ at + self.shift[:, None])

    def after(self, first: RigidMotion) -> RigidMotion:
        """Return the rigid motion that does another one first, and then this one."""
        shift = self.matrix @ first.shift + self.shift
        return RigidMotion(self.turn + first.turn, float(shift[0]), float(shift[1]))

    def inverse(self) -> RigidMotion:
        """Return the rigid motion that undoes this one."""
        shift = -self.matrix.T @ self.shift
        return RigidMotion(-self.turn, float(shift[0]), float(shift[1]))

    def corner_distance(self, other: RigidMotion, shape: tuple[int, ...]) -> float:
        """Return by how many pixels two rigid motions differ at the corners of a picture, at most.

        shape: rows and columns of the picture.
        """
        rows, columns = ((n - 1) / 2 for n in shape)
        corners = np.array([[-rows, -rows, rows, rows], [-columns, columns, -columns, columns]])
        away = self.places(corners) - other.places(corners)
        return float(np.hypot(*away).max())
