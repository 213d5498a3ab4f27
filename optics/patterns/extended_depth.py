"""Patterns that extend the depth of field: their PSFs hardly change with an object's distance."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.patterns.slope import largest_phase_step, require_slope, scale_within_slope
from optics.validation import require_positive, rounded_down

__all__ = ["annular_phase_mask", "cubic_phase_mask", "logarithmic_asphere"]


def cubic_phase_mask(panel: Panel, strength: float, radius: float | None = None) -> torch.Tensor:
    """Strength times (x³ + y³), with x and y in units of a radius (thesis Eq. 2.41).

    strength: radians at one radius from the centre, along an axis; of the order of 20 pi for a
    large depth of field (Dowski and Cathey 1995, 10.1364/AO.34.001859). radius: metres on the
    panel; None for half its longer side. Raises ValueError with the greatest strength that the
    pixels allow.
    """
    if not math.isfinite(strength):
        raise ValueError(f"strength is {strength} rad; it must be finite")
    radius = _longer_half(panel) if radius is None else radius
    require_positive("radius", radius, "m")
    y, x = panel.plane.mesh()
    return scale_within_slope(
        "strength",
        (y / radius) ** 3 + (x / radius) ** 3,
        strength,
        lambda most: f"choose at most {rounded_down(most)} rad in size, or a larger radius",
    )


def annular_phase_mask(
    panel: Panel, rings: int, depth: float, radius: float | None = None
) -> torch.Tensor:
    """Equally wide rings around the axis, with the same parabola across each of them.

    Every ring spreads its light by much more than defocus does: an annular phase mask, after
    Ohta et al. (Jpn. J. Appl. Phys. 54, 09ME03, 2015), with which the thesis compares
    (section 5.6, Fig. 5.5). depth: radians in the middle of a ring, over its edges,
    where the phase is zero, as it is beyond all rings. radius: metres, outer edge of the last
    ring; None for the panel's corners. Raises ValueError with the greatest depth, or number of
    rings, that the pixels allow.
    """
    if not math.isfinite(depth):
        raise ValueError(f"depth is {depth} rad; it must be finite")
    radius = 0.5 * math.hypot(*panel.shape) * panel.pitch if radius is None else radius
    require_positive("radius", radius, "m")
    most = math.floor(radius / (2 * panel.pitch) * (1 + 1e-9))
    if most < 1:
        raise ValueError(f"radius is {radius:g} m; a ring needs at least {2 * panel.pitch:g} m")
    if not 1 <= rings <= most:
        raise ValueError(
            f"rings is {rings}; choose 1 to {most}, so that a ring is two pixels wide at least"
        )
    width = radius / rings
    # The parabola's slope at a ring's edges.
    step = 4 * abs(depth) / width * panel.pitch
    deepest = math.pi * width / (4 * panel.pitch)
    remedy = f"choose at most {rounded_down(deepest)} rad in size, or fewer rings"
    require_slope("depth", step, remedy)
    y, x = panel.plane.mesh()
    place = torch.hypot(y, x) / width
    across = 2 * (place - torch.floor(place)) - 1
    return torch.where(place < rings, depth * (1 - across**2), 0.0)


def logarithmic_asphere(
    panel: Panel, near: float, far: float, focus: float, wavelength: float, radius: float
) -> torch.Tensor:
    """A lens whose zones are in focus one after the other, from a near object to a far one.

    The middle of the panel is in focus for an object at `near`, the zone at `radius` for one at
    `far`, and between them the distance in focus grows as the zone's area, so that every
    distance gets as much light: s(r) = near + (far - near) r² / radius². An object at s is in
    focus where the phase's slope undoes its wave's and the lens', -2 pi r / wavelength
    (1 / s - 1 / focus); the integral of that with s(r) is the logarithmic asphere of Chi and
    George (Opt. Lett. 26, 875, 2001; George and Chi, J. Opt. A 5, S157, 2003). By stationary
    phase, the light on the axis is 2 wavelength s² / ((far - near) radius²) of that in focus.

    near, far: metres from the panel. focus: metres from the panel to the plane that the lens is
    focused at, math.inf allowed. radius: metres on the panel; beyond it the distance stays
    `far`. Raises ValueError with the limit for what is steeper than the pixels allow.
    """
    for name, value in {"near": near, "wavelength": wavelength, "radius": radius}.items():
        require_positive(name, value, "m")
    if not near < far < math.inf:
        raise ValueError(f"far is {far:g} m; it must be finite and more than near, {near:g} m")
    if not focus > 0:
        raise ValueError(f"focus is {focus:g} m; it must be positive (inf is allowed)")
    y, x = panel.plane.mesh()
    area = y**2 + x**2
    inside = torch.clamp(area, max=radius**2)
    growth = (far - near) / radius**2
    path = torch.log1p(growth / near * inside) / growth + (area - inside) / far - area / focus
    phase = -math.pi / wavelength * path
    most = rounded_down(wavelength / (2 * _longer_half(panel) * panel.pitch))
    remedy = f"choose both so that 1/near and 1/far are within {most} /m of 1/focus, {1 / focus:g}"
    require_slope(f"near {near:g} m or far {far:g} m", largest_phase_step(phase), remedy)
    return phase


def _longer_half(panel: Panel) -> float:
    return max(panel.shape) * panel.pitch / 2
