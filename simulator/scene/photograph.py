"""A print of a photograph."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from optics.light.spectrum import Spectrum
from simulator.scene.colours import Basis, primaries
from simulator.scene.framed import FramedPicture, require_image


@dataclass(frozen=True, eq=False)
class PhotographPrint(FramedPicture):
    """A flat, matt print across the axis, evenly lit.

    image: (rows, columns, 3), linear red, green and blue, 1 = white. distance: metres.
    radiance: of white, W / (sr m² m). basis: what its colours reflect by wavelength.
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
    """Raise a ValueError for what isn't a finite picture in three colours."""
    require_image(image, "3 colours")
    if image.shape[2] != 3:
        raise ValueError(f"image is {tuple(image.shape)}; it needs rows, columns and 3 colours")
