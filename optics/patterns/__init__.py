"""Compute patterns to show on the panel: phases in radians, (rows, columns), float64.

Phases aren't wrapped here, so that a panel can use its whole range; optics.slm wraps them. A
pattern steeper than half a wave per pixel looks the same as its alias, and is refused with an
error that names the limit. y points down the rows and x along the columns, from the panel's
centre; angles go from x towards y. A phase that grows along an axis sends light to that side of
the sensor.
"""

from __future__ import annotations

from optics.patterns.aberrations import zernike_pattern
from optics.patterns.constant import constant_phase
from optics.patterns.extended_depth import (
    annular_phase_mask,
    cubic_phase_mask,
    logarithmic_asphere,
)
from optics.patterns.gratings import (
    binary_grating,
    blazed_grating,
    sine_grating,
    steering_grating,
)
from optics.patterns.lenses import axicon, fresnel_lens
from optics.patterns.patches import random_patches
from optics.patterns.slope import superpose

__all__ = [
    "annular_phase_mask",
    "axicon",
    "binary_grating",
    "blazed_grating",
    "constant_phase",
    "cubic_phase_mask",
    "fresnel_lens",
    "logarithmic_asphere",
    "random_patches",
    "sine_grating",
    "steering_grating",
    "superpose",
    "zernike_pattern",
]
