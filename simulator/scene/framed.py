"""Targets made of pixels, whose size is given or follows from the camera's frame."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch

from optics.camera import Camera
from optics.light.spectrum import Spectrum
from optics.validation import require_finite, require_positive
from simulator.scene.colours import Basis, primaries
from simulator.scene.pixel_picture import PixelPicture
from simulator.scene.target import Layer, Part, Target


def require_image(image: torch.Tensor, bands: str) -> None:
    """Raise ValueError unless an image is finite and has shape (rows, columns, bands)."""
    if image.ndim != 3 or image.numel() == 0:
        raise ValueError(f"image is {tuple(image.shape)}; it needs rows, columns and {bands}")
    require_finite("image", image)


def require_colours(image: torch.Tensor) -> None:
    """Raise ValueError unless a photograph is finite and has three colours."""
    require_image(image, "3 colours")
    if image.shape[2] != 3:
        raise ValueError(f"image is {tuple(image.shape)}; it needs rows, columns and 3 colours")


def colour_planes(basis: Basis, image: torch.Tensor) -> tuple[tuple[Spectrum, torch.Tensor], ...]:
    """Return a photograph's planes (rows, columns), each with the reflectance of its primary."""
    colours = (one.contiguous().to(torch.float32) for one in image.unbind(-1))
    return tuple(zip(basis, colours, strict=True))


class _Pixels(ABC):
    """Declare the field `image`, (rows, columns, bands), which each subclass defines."""

    image: torch.Tensor


@dataclass(frozen=True, eq=False, kw_only=True)
class FramedPicture(_Pixels, Target):
    """Target that is a picture of pixels.

    cover, height, offset, side: as of PhotographPrint.
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
        """Return the image's rows and columns."""
        return self.image.shape[0], self.image.shape[1]

    def for_camera(self, camera: Camera) -> Target:
        if self.height is not None:
            return self
        sensor = camera.sensor
        sides = zip(sensor.shape, self.shape, strict=True)
        side = self.cover * max(n * sensor.pitch / size for n, size in sides)
        if self.side == side:
            return self
        if side not in self._copies_by_side:
            # Alternating cameras get the same object again, so a few copies are kept.
            if len(self._copies_by_side) >= 4:
                self._copies_by_side.clear()
            self._copies_by_side[side] = replace(self, side=side)
        return self._copies_by_side[side]

    def place_image(self, image: torch.Tensor) -> PixelPicture:
        """Give a picture (rows, columns) this target's position and size."""
        if self.height is not None:
            return PixelPicture(image, self.height / self.shape[0], self.offset)
        if self.side is None:
            raise ValueError("a print's size follows from the frame; use for_camera() first")
        return PixelPicture(image, self.side, self.offset, on_sensor=True)

    def painted_layer(
        self, distance: float, images: Iterable[tuple[Spectrum, torch.Tensor]]
    ) -> Layer:
        """Return a layer whose light is the sum of reflectances times pictures (rows, columns)."""
        return Layer(
            distance,
            tuple(Part(self.reflected_radiance(one), self.place_image(im)) for one, im in images),
        )


@dataclass(frozen=True, eq=False)
class PhotographPrint(FramedPicture):
    """Flat, matt, evenly lit print of a photograph.

    Parameters
    ----------
    image : torch.Tensor
        Linear red, green and blue, shape (rows, columns, 3), 1 = white.
    distance, radiance : float
        Metres from the panel, positive; spectral radiance of white, W / (sr m² m), not negative.
    basis : tuple of Spectrum, default primaries()
        Reflectances of red, green and blue.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    cover : float, default 1.05
        Side of the picture over side of the frame, along the axis where this ratio is smaller.
    height : float, optional
        Height of the picture at the object in metres, which replaces `cover`.
    offset : tuple of float, default (0.0, 0.0)
        Position (y, x) of the picture's middle relative to the axis, metres on the object.
    side : float, optional
        Side of the pixels on the sensor in metres; `for_camera` sets it.

    Raises
    ------
    ValueError
        If the image isn't a finite picture in three colours, or a size isn't positive.
    """

    image: torch.Tensor
    distance: float
    radiance: float
    basis: Basis = field(default_factory=primaries)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_colours(self.image)

    @property
    def images(self) -> tuple[tuple[Spectrum, torch.Tensor], ...]:
        """The reflectances of the primaries, and their pictures."""
        return colour_planes(self.basis, self.image)

    @cached_property
    def layers(self) -> tuple[Layer, ...]:
        return (self.painted_layer(self.distance, self.images),)
