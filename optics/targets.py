"""The PSF shapes that a user asks for: intensities on a plane, sum one, float64."""

from __future__ import annotations

import torch

from optics.plane import Plane


def ring(plane: Plane, radius: float, width: float) -> torch.Tensor:
    """A ring of a radius, with a Gaussian profile whose standard deviation is `width`.

    Lengths in metres. Raises ValueError if the ring doesn't fit on the plane.
    """
    if not (radius >= 0 and width > 0):
        raise ValueError(f"radius {radius:g} m and width {width:g} m must be positive")
    if width < 0.5 * max(plane.pitch):
        raise ValueError(
            f"width {width * 1e6:.3g} µm falls between samples of {max(plane.pitch) * 1e6:.3g} µm; "
            "choose at least half a sample"
        )
    reach = min(n // 2 * p for n, p in zip(plane.shape, plane.pitch, strict=True))
    if radius + 2 * width > reach:
        raise ValueError(
            f"radius {radius * 1e6:.0f} µm with width {width * 1e6:.0f} µm doesn't fit in the "
            f"window, which reaches {reach * 1e6:.0f} µm; choose a smaller radius"
        )
    y, x = plane.mesh()
    intensity = torch.exp(-((torch.hypot(y, x) - radius) ** 2) / (2 * width**2))
    return intensity / intensity.sum()
