"""Draw targets, the PSF shapes that a user requests: intensities on a plane, sum 1, float64.

Each is a Target: `spiral(plane, radius, width)` draws it, and `spiral.reach(radius, width)` tells
how far from the axis its light reaches, from which the size of a window follows. Lengths are
metres on the sensor. y points down and x to the right; angles go from x towards y. `width` is the
standard deviation of a Gaussian across a stroke, or of a dot.
"""

from __future__ import annotations

from optics.targets.dots import (
    dispersed_positions,
    dots,
    grid_positions,
    linear_dispersion,
    ring,
    ring_positions,
)
from optics.targets.logo import logo
from optics.targets.strokes import eye, heart, infinity, letters, shrinking_spiral, spiral
from optics.targets.target import Target

__all__ = [
    "Target",
    "dispersed_positions",
    "dots",
    "eye",
    "grid_positions",
    "heart",
    "infinity",
    "letters",
    "linear_dispersion",
    "logo",
    "ring",
    "ring_positions",
    "shrinking_spiral",
    "spiral",
]
