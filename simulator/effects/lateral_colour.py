"""The effect of lateral colour: the lens images each wavelength at another scale."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.colour_changes import Which, mean_change_bound
from simulator.effects.moved_light import MovedLight, moved_light_bound
from simulator.effects.rendering_work import (
    FILTER_BANDWIDTH,
    LATERAL_COLOUR,
    LEVELS,
    OUT_OF_BAND_LEAK,
)
from simulator.formation.distorting import distorted_frame, lateral_scales
from simulator.situation import Situation

Array = NDArray[np.float64]


class LateralColour(MovedLight):
    name = LATERAL_COLOUR
    recipe_field = "lateral_colour"
    physics = "the lens' glass images each wavelength at another scale: edges get coloured fringes"
    source = "Kingslake, Lens Design Fundamentals, chapter 11"

    def is_present(self, s: Situation) -> bool:
        return bool(s.camera.lens.lateral_colour) and not s.picture_probe.is_dark

    def lookups(self, levels: Mapping[str, int]) -> int:
        of_band = LEVELS.wavelengths[levels.get(FILTER_BANDWIDTH, 0)]
        return of_band + LEVELS.leak[levels.get(OUT_OF_BAND_LEAK, 0)]

    def explain(self, s: Situation) -> str:
        low, high = lateral_scales(s)
        pixels = (high - low) * _corner(s) / s.camera.sensor.pitch
        return f"in the corners, colours lie up to {pixels:.2g} pixels apart"

    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the lateral colour effect moves."""
        lens, corner = s.camera.lens, _corner(s)

        def phase(rate: Array, most: float) -> Array:
            def at(wavelength: float, which: Which) -> Array:
                moved = corner * abs(1 - 1 / lens.image_scale(wavelength))
                return np.minimum(rate * moved, most)

            return mean_change_bound(s, rate.shape, at)

        areas = mean_change_bound(
            s, (), lambda one, which: np.array(abs(lens.image_scale(one) ** -2 - 1))
        )
        return moved_light_bound(s, phase, float(areas))


def _corner(s: Situation) -> float:
    """Return the largest height of an image in the frame, in metres, before distortion."""
    sensor = s.camera.sensor
    return math.hypot(*sensor.shape) * sensor.pitch / 2 + distorted_frame(s.camera).reach
