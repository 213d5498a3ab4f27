"""The print of a photograph as a target."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from optics.light.spectrum import Spectrum
from simulator.scene.colours import Basis, primaries
from simulator.scene.framed import FramedPicture, require_image


@dataclass(frozen=True, eq=False)
class PhotographPrint(FramedPicture):
    """Flat, matt, evenly lit print of a photograph.

    Parameters
    ----------
    image : torch.Tensor
        Linear red, green and blue, shape (rows, columns, 3), 1 = white.
    distance : float
        Distance from the panel in metres, positive.
    radiance : float
        Spectral radiance of white, W / (sr m² m), not negative.
    basis : tuple of Spectrum, default primaries()
        Reflectances of red, green and blue.
    light, lamp, velocity, polarisation_angle, speckle, name : optional
        See `Target`.
    cover : float, default 1.05
        Side of the picture over side of the frame, along the axis where this ratio is smaller;
        what exceeds the frame lies beyond its edges.
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
        colours = (one.contiguous().to(torch.float32) for one in self.image.unbind(-1))
        return tuple(zip(self.basis, colours, strict=True))


def require_colours(image: torch.Tensor) -> None:
    """Raise ValueError unless a photograph is finite and has three colours."""
    require_image(image, "3 colours")
    if image.shape[2] != 3:
        raise ValueError(f"image is {tuple(image.shape)}; it needs rows, columns and 3 colours")
