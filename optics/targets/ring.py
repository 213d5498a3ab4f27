"""The ring."""

from __future__ import annotations

import math

import torch

from optics.plane import Plane
from optics.targets.target import Drawing, Target, format_micrometres


@Target
def ring(radius: float, width: float) -> Drawing:
    """A ring of a radius, with a Gaussian profile whose standard deviation is `width`.

    A radius of zero makes a spot. Raises ValueError for sizes that aren't positive.
    """
    if not (0 <= radius < math.inf and 0 < width < math.inf):
        raise ValueError(f"radius {radius:g} m and width {width:g} m must be positive")

    def brightness(plane: Plane) -> torch.Tensor:
        y, x = plane.mesh()
        return torch.exp(-((torch.hypot(y, x) - radius) ** 2) / (2 * width**2))

    return Drawing(
        (-radius, radius, -radius, radius),
        width,
        brightness,
        f"radius {format_micrometres(radius)} with width {format_micrometres(width)}",
        "choose a smaller radius",
    )
