"""Patterns that focus: the Fresnel lens and the axicon."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.patterns.slope import require_slope, scale_within_slope
from optics.validation import require_positive, rounded_down, rounded_up

__all__ = ["axicon", "fresnel_lens"]


def fresnel_lens(
    panel: Panel,
    focal_length: float,
    wavelength: float,
    centre: tuple[float, float] = (0.0, 0.0),
) -> torch.Tensor:
    """A thin lens, -pi r² / (wavelength f) (thesis Eq. 2.14); lengths in metres.

    A positive focal length converges. centre: (y, x) of the lens on the panel; off the axis it
    shifts the image as well. Raises ValueError with the shortest focal length that the pixels
    allow: in the middle of the panel, pitch x side / wavelength.
    """
    if focal_length == 0 or not math.isfinite(focal_length) or not math.isfinite(1 / focal_length):
        raise ValueError(f"focal_length is {focal_length} m; it must be finite and not zero")
    require_positive("wavelength", wavelength, "m")
    if not all(math.isfinite(c) for c in centre):
        raise ValueError(f"centre {centre} m must be finite in each axis")
    y, x = panel.plane.mesh()
    shape = -math.pi / wavelength * ((y - centre[0]) ** 2 + (x - centre[1]) ** 2)
    return scale_within_slope(
        "focal_length",
        shape,
        1 / focal_length,
        lambda power: f"choose at least {rounded_up(1 / power)} m in size",
    )


def axicon(panel: Panel, radius: float, distance: float, wavelength: float) -> torch.Tensor:
    """A cone, which sends a point to a ring of a radius in the focal plane.

    radius: metres on the sensor; a negative one makes the cone converge first. distance:
    metres from the lens to the sensor. Raises ValueError with the largest radius that the
    pixels allow.
    """
    require_positive("distance", distance, "m")
    require_positive("wavelength", wavelength, "m")
    if not math.isfinite(radius):
        raise ValueError(f"radius is {radius:g} m; it must be finite")
    slope = 2 * math.pi * radius / (wavelength * distance)
    largest = wavelength * distance / (2 * panel.pitch)
    remedy = f"choose at most {rounded_down(largest)} m in size"
    require_slope("radius", abs(slope) * panel.pitch, remedy)
    y, x = panel.plane.mesh()
    return slope * torch.hypot(y, x)
