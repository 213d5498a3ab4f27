"""Check the depths of patterns whose parts focus at different depths.

Depths are vergences in dioptres; optics.patterns.multi_focus says what that means.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from optics.camera import Panel
from optics.patterns.slope import require_slope
from optics.patterns.visible_area import corner_radius
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
    """Raise ValueError for a phase that is too steep within a part.

    part: number of each pixel's part, between which the phase may jump; None for a smooth pattern.
    """
    largest = 0.0
    for axis in (0, 1):
        steps = torch.diff(phase, dim=axis).abs()
        if part is not None:
            steps = steps[torch.diff(part, dim=axis) == 0]
        largest = max(largest, float(steps.max()) if steps.numel() else 0.0)
    most = rounded_down(wavelength / (max(panel.shape) * panel.pitch**2))
    require_slope(name, largest, f"choose depths within {most} dioptres of focus, {focus:g}")
