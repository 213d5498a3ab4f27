"""The picture of a print: pixels of a given size in the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from optics.plane import Plane
from optics.validation import require_finite
from simulator.scene.drawable import STILL, Drawable, Shift
from simulator.scene.resampling import averaging_matrix


@dataclass(frozen=True, eq=False)
class PixelPicture(Drawable):
    """Picture of pixels with values 0 to 1, interpolated linearly, and dark around its edges.

    image: (rows, columns). side: of its pixels, metres on the object; with `on_sensor`, metres on
    the sensor at any distance. offset: (y, x) metres on the object from the axis to the picture's
    middle.
    """

    image: torch.Tensor
    side: float
    offset: tuple[float, float] = (0.0, 0.0)
    on_sensor: bool = False

    def __post_init__(self) -> None:
        if self.image.ndim != 2 or self.image.numel() == 0:
            raise ValueError(f"image is {tuple(self.image.shape)}; it needs rows and columns")
        require_finite("image", self.image)
        if not 0 < self.side < math.inf:
            raise ValueError(f"side is {self.side:g} m; a pixel's must be positive and finite")
        if not all(math.isfinite(part) for part in self.offset):
            raise ValueError(f"offset is {self.offset} m; it must be finite in each axis")

    @property
    def bytes(self) -> int:
        """Return the bytes that a scene picture's pixels take in memory."""
        return self.image.numel() * self.image.element_size()

    def extent(self, magnification: float, shift: Shift = STILL) -> tuple[float, float]:
        y, x = (self._half(axis, magnification, shift) for axis in (0, 1))
        return y, x

    def spectral_decay(self, magnification: float, frequency: float) -> int:
        """Return the power of the frequency with which a scene picture's spectrum falls: 1 or 2.

        Because of the linear interpolation it is 2 at frequencies beyond those that the pixels
        resolve, unless the picture has light at its rim, where it ends abruptly.
        """
        side = self.side if self.on_sensor else self.side * magnification
        return 2 if side * frequency >= 0.35 and not self._ends_in_light else 1

    @cached_property
    def _ends_in_light(self) -> bool:
        return any(bool(end.any()) for end in (*self.image[[0, -1]], *self.image.mT[[0, -1]]))

    def _half(self, axis: int, magnification: float, shift: Shift) -> float:
        """Return the largest distance of a scene picture's light from the axis, on the sensor."""
        side = self.side if self.on_sensor else self.side * magnification
        aside = abs(self.offset[axis] + shift[axis]) * magnification
        return aside + (self.image.shape[axis] + 1) * side / 2

    def light(self, plane: Plane, magnification: float, shift: Shift = STILL) -> torch.Tensor:
        side = self.side if self.on_sensor else self.side * magnification
        if side == 0:
            return torch.zeros(plane.shape)
        along = [
            averaging_matrix(
                self.image.shape[axis],
                side,
                (self.offset[axis] + shift[axis]) * magnification,
                edges(plane, axis),
            )
            for axis in (0, 1)
        ]
        values = self.image.to(torch.float32).numpy()
        return torch.from_numpy(np.ascontiguousarray((along[1] @ (along[0] @ values).T).T))


def edges(plane: Plane, axis: int) -> NDArray[np.float64]:
    """Return the cell edges, in metres, along an axis of the plane on which a scene is drawn.

    There is one more edge than there are cells.
    """
    n, pitch = plane.shape[axis], plane.pitch[axis]
    index = np.arange(n + 1, dtype=np.float64) - n // 2 - 0.5
    return np.asarray(index * pitch + plane.centre[axis])
