"""Phase masks that extend the depth of field: their PSFs hardly change with defocus."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel
from optics.patterns.slope import largest_phase_step, require_slope, scale_within_slope
from optics.validation import require_positive, rounded_down

__all__ = ["annular_phase_mask", "cubic_phase_mask", "logarithmic_asphere"]


def cubic_phase_mask(panel: Panel, strength: float, radius: float | None = None) -> torch.Tensor:
    """Compute the cubic phase mask, strength (x³ + y³) (thesis Eq. 2.41).

    x and y are in units of `radius`.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    strength : float
        Radians at one radius from the centre, along an axis; about 20 pi for a large depth of
        field.
    radius : float, optional
        Metres on the panel; by default half of the panel's longer side.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the strength isn't finite, the radius isn't positive, or the phase is too steep; the
        message names the largest strength.

    References
    ----------
    Dowski and Cathey 1995, doi 10.1364/AO.34.001859.
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
    """Compute the annular phase mask, rings with the same parabola across each.

    The rings are equally wide, and each spreads its light by much more than defocus does. The
    phase is zero at the rings' edges and beyond the last ring. The thesis compares its results with
    this mask (section 5.6, Fig. 5.5).

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    rings : int
        Number of rings, 1 or more.
    depth : float
        Radians in the middle of a ring, relative to its edges.
    radius : float, optional
        Outer edge of the last ring, metres; by default the panel's corners.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If a number is out of range, or the phase is too steep; the message names the largest depth
        or number of rings.

    References
    ----------
    Ohta et al., Jpn. J. Appl. Phys. 54, 09ME03, 2015.
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
    # The parabola is steepest at a ring's edges.
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
    """Compute the logarithmic asphere, whose zones focus at different distances.

    The middle of the panel is in focus for an object at `near`, and the zone at `radius` for one
    at `far`. Between them the distance in focus grows linearly with the zone's area, so that every
    distance gets the same light: s(r) = near + (far - near) r² / radius². An object at s is in
    focus where the slope of the phase cancels those of the object's wave and of the lens. The
    slope is therefore -2 pi r / wavelength (1 / s - 1 / focus), and its integral with s(r) is the
    logarithmic asphere of Chi and George. By stationary phase, the light on the axis is
    2 wavelength s² / ((far - near) radius²) of that in focus.

    Parameters
    ----------
    panel : Panel
        The panel that shows the pattern.
    near, far : float
        Nearest and farthest distance in focus, metres from the panel.
    focus : float
        Metres from the panel to the plane in focus of the lens; ``math.inf`` is allowed.
    wavelength : float
        Metres.
    radius : float
        Metres on the panel; beyond it the distance in focus stays `far`.

    Returns
    -------
    torch.Tensor, (rows, columns), float64
        Phase in radians.

    Raises
    ------
    ValueError
        If the distances aren't positive or in order, or the phase is too steep; the message names
        the limit.

    References
    ----------
    W. Chi and N. George, Opt. Lett. 26, 875, 2001; N. George and W. Chi, J. Opt. A 5, S157, 2003.
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
