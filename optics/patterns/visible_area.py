"""Compute which share of a panel's visible area lies within a circle about its centre."""

from __future__ import annotations

import math

import torch

from optics.camera import Panel


def disc_in_rectangle(
    squared_radius: torch.Tensor, half_sides: tuple[float, float]
) -> torch.Tensor:
    """Compute the area that a disc and a rectangle with the same centre have in common.

    squared_radius: of the disc, m², up to the rectangle's corners. half_sides: of the rectangle,
    metres. The area is that of the disc less the segments that reach beyond the sides.
    """
    area = math.pi * squared_radius
    for side in half_sides:
        squared = torch.clamp(squared_radius, min=side**2)
        angle = torch.acos(torch.clamp(side / torch.sqrt(squared), max=1.0))
        area = area - 2 * (squared * angle - side * torch.sqrt(squared - side**2))
    return area


def visible_area(panel: Panel, radius: float) -> float:
    """Compute the area of a panel's pixels within a circle about their centre, m²."""
    return float(
        disc_in_rectangle(torch.tensor(radius**2, dtype=torch.float64), _half_sides(panel))
    )


def visible_share(panel: Panel, squared_radius: torch.Tensor, radius: float) -> torch.Tensor:
    """Compute the share of a panel's light within circles, of all that is within the last circle.

    squared_radius: of the circles, m². radius: of the last one, metres, up to the panel's corners;
    a larger circle has the share 1.
    """
    inside = torch.clamp(squared_radius, max=radius**2)
    share = disc_in_rectangle(inside, _half_sides(panel)) / visible_area(panel, radius)
    return torch.clamp(share, min=0.0, max=1.0)


def corner_radius(panel: Panel) -> float:
    """Return the distance from the centre of a panel's pixels to its corners, metres."""
    return 0.5 * math.hypot(*panel.shape) * panel.pitch


def _half_sides(panel: Panel) -> tuple[float, float]:
    rows, columns = panel.shape
    return rows * panel.pitch / 2, columns * panel.pitch / 2
