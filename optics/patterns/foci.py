"""Check the depths of patterns whose parts focus at different depths, and share out their light.

Depths are vergences in dioptres; optics.patterns.multi_focus says what that means.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Panel
from optics.patterns.slope import largest_phase_step, require_slope
from optics.validation import require_positive, require_wavelength, rounded_down


def require_depth_range(near: float, far: float) -> None:
    """Raise ValueError unless near and far are the limits of a range of depth in dioptres."""
    for name, value in (("near", near), ("far", far)):
        if not math.isfinite(value):
            raise ValueError(
                f"{name} is {value:g} dioptres; it must be finite (infinity is 0 dioptres)"
            )
    if not near > far:
        raise ValueError(
            f"near is {near:g} dioptres; it must be more than far, {far:g} (1 over the distance "
            "in metres)"
        )


def require_vergences(vergences: Sequence[float]) -> tuple[float, ...]:
    """Return depths in focus as floats; raise ValueError if they can't be vergences."""
    foci = tuple(float(one) for one in vergences)
    if not foci:
        raise ValueError("vergences is empty; give one depth in dioptres or more")
    for one in foci:
        if not math.isfinite(one):
            raise ValueError(
                f"vergences has {one:g}; they must be finite dioptres (infinity is 0 dioptres)"
            )
    return foci


def require_lengths(panel: Panel, wavelength: float, focus: float, radius: float | None) -> float:
    """Check wavelength, focus and radius; return the outer radius in metres, up to the corners."""
    require_wavelength("wavelength", wavelength)
    if not math.isfinite(focus):
        raise ValueError(f"focus is {focus:g} dioptres; it must be finite (infinity is 0 dioptres)")
    corner = corner_radius(panel)
    radius = corner if radius is None else radius
    require_positive("radius", radius, "m")
    return min(radius, corner)


def require_slope_within(
    phase: torch.Tensor,
    part: torch.Tensor | None,
    name: str,
    panel: Panel,
    wavelength: float,
    focus: float,
) -> None:
    """Raise ValueError for a phase that is too steep within a part, between which it may jump."""
    most = rounded_down(wavelength / (max(panel.shape) * panel.pitch**2))
    remedy = f"choose depths within {most} dioptres of focus, {focus:g}"
    require_slope(name, largest_phase_step(phase, part), remedy)


def visible_area(panel: Panel, squared_radius: torch.Tensor) -> torch.Tensor:
    """Compute the area of a panel's pixels within circles about their centre, m².

    It is that of the disc less the segments that reach beyond the panel's sides. The circles end at
    its corners.
    """
    area = math.pi * squared_radius
    for pixels in panel.shape:
        side = pixels * panel.pitch / 2
        squared = torch.clamp(squared_radius, min=side**2)
        angle = torch.acos(torch.clamp(side / torch.sqrt(squared), max=1.0))
        area = area - 2 * (squared * angle - side * torch.sqrt(squared - side**2))
    return area


def visible_share(panel: Panel, squared_radius: torch.Tensor, radius: float) -> torch.Tensor:
    """Compute the share of a panel's light within circles, of all that is within the last circle.

    squared_radius: of the circles, m²; one beyond the last has the share 1.
    radius: of the last one, metres, up to the panel's corners.
    """
    last = torch.tensor(radius**2, dtype=torch.float64)
    inside = torch.clamp(squared_radius, max=radius**2)
    share = visible_area(panel, inside) / float(visible_area(panel, last))
    return torch.clamp(share, min=0.0, max=1.0)


def corner_radius(panel: Panel) -> float:
    """Return the distance from the centre of a panel's pixels to its corners, metres."""
    return 0.5 * math.hypot(*panel.shape) * panel.pitch
