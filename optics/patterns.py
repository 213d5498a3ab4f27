"""What a user shows: phases in radians over the panel, (rows, columns), float64."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.edge import require_positive, rounded_down, rounded_up


def _require_slope(name: str, slope: float, panel: Panel, remedy: str) -> None:
    """A slope of more than half a wave per pixel can't be told from its alias."""
    step = slope * panel.pitch
    if step > math.pi * (1 + 1e-9):
        raise ValueError(
            f"{name} changes the phase by {step / math.pi:.2f} pi per pixel and the panel can "
            f"show 1 pi at most; {remedy}"
        )


def constant(panel: Panel, phase: float = 0.0) -> torch.Tensor:
    """The same phase everywhere: a neutral pattern."""
    return torch.full(panel.shape, phase, dtype=torch.float64)


def fresnel_lens(panel: Panel, focal_length: float, wavelength: float) -> torch.Tensor:
    """A thin lens, -pi r² / (wavelength f) (thesis Eq. 2.14); lengths in metres.

    A positive focal length converges. Raises ValueError with the shortest focal length
    that the pixels allow, pitch x side / wavelength (slope of half a wave at the edge).
    """
    if focal_length == 0 or not math.isfinite(focal_length):
        raise ValueError(f"focal_length is {focal_length} m; it must be finite and not zero")
    require_positive("wavelength", wavelength, "m")
    y, x = panel.plane.mesh()
    half = max(panel.shape) * panel.pitch / 2
    shortest = 2 * half * panel.pitch / wavelength
    _require_slope(
        "focal_length",
        2 * math.pi * half / (wavelength * abs(focal_length)),
        panel,
        f"choose at least {rounded_up(shortest)} m in size",
    )
    return -math.pi / (wavelength * focal_length) * (y**2 + x**2)


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
    _require_slope("radius", abs(slope), panel, remedy)
    y, x = panel.plane.mesh()
    return slope * torch.hypot(y, x)
