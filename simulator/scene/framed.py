"""Pictures of pixels, which are as large as the frame asks for or as somebody says."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch

from optics.camera import Camera
from optics.light.spectrum import Spectrum
from optics.validation import require_finite, require_positive
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.target import Layer, Part, Target

_FRAMES = 4
"""Sizes for which a target is kept: it is one object for each camera that looks at it in turn."""


def require_image(image: torch.Tensor, bands: str) -> None:
    """Raise a ValueError for what isn't a finite picture (rows, columns, bands)."""
    if image.ndim != 3 or image.numel() == 0:
        raise ValueError(f"image is {tuple(image.shape)}; it needs rows, columns and {bands}")
    require_finite("image", image)


def covering(shape: tuple[int, ...], cover: float, camera: Camera) -> float:
    """Side on the sensor, in metres, of the pixels of a picture that covers the frame.

    shape: (rows, columns) of the picture. cover: side of the picture over side of the frame,
    where it just covers it.
    """
    sensor = camera.sensor
    sides = zip(sensor.shape, shape, strict=False)
    return cover * max(n * sensor.pitch / size for n, size in sides)


class _Pixels(ABC):
    """image: (rows, columns, bands), a field of each kind's own."""

    image: torch.Tensor


@dataclass(frozen=True, eq=False, kw_only=True)
class FramedPicture(_Pixels, Target):
    """A picture of pixels.

    cover: side of the picture over side of the frame, where it just covers it; what exceeds the
    frame lies beyond its edges. height: of the picture at the object in metres, which counts
    instead of `cover` where it is given. offset: (y, x) metres from the axis to its middle.
    side: of its pixels on the sensor, metres, where a camera is known: see for_camera().
    """

    cover: float = 1.05
    height: float | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    side: float | None = None
    _copies_by_side: dict[float, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive("cover", self.cover, "")
        if self.height is not None:
            require_positive("height", self.height, "m")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return self.image.shape[0], self.image.shape[1]

    @property
    @abstractmethod
    def images(self) -> tuple[tuple[Spectrum, torch.Tensor], ...]:
        """What adds up to it: reflectances and pictures (rows, columns)."""

    def for_camera(self, camera: Camera) -> Target:
        if self.height is not None:
            return self
        side = covering(self.shape, self.cover, camera)
        if self.side == side:
            return self
        if side not in self._copies_by_side:
            if len(self._copies_by_side) >= _FRAMES:
                self._copies_by_side.clear()
            self._copies_by_side[side] = replace(self, side=side)
        return self._copies_by_side[side]

    def place_image(self, image: torch.Tensor) -> PixelPicture:
        """A picture (rows, columns) where and as large as this is."""
        if self.height is not None:
            return PixelPicture(image, self.height / self.shape[0], self.offset)
        if self.side is None:
            raise ValueError("a print's size follows from the frame; use for_camera() first")
        return PixelPicture(image, self.side, self.offset, on_sensor=True)

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        parts = tuple(
            Part(self.reflected_radiance(s), self.place_image(image)) for s, image in self.images
        )
        return (Layer(self.distance, parts),)
