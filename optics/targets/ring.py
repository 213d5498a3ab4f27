"""Draw the ring."""

from __future__ import annotations

import math

import torch

from optics.plane import Plane
from optics.targets.target import Drawing, Target, format_micrometres


@Target
def ring(radius: float, width: float) -> Drawing:
    """Draw a ring with a Gaussian profile; a radius of zero gives a spot.

    Parameters
    ----------
    radius : float
        Radius of the brightest circle, metres, 0 or more.
    width : float
        Standard deviation of the profile, metres.

    Returns
    -------
    Drawing
        The shape, which `Target` puts on a plane.

    Raises
    ------
    ValueError
        If the radius is negative, the width isn't positive, or one of them isn't finite.
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
