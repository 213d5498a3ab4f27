"""The effect of lateral colour: the lens images each wavelength at another scale."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.colour_changes import Which, mean_change_bound
from simulator.effects.electron_bounds import relative_light_change, sensor_error_bound
from simulator.effects.likely_errors import LightEffect
from simulator.effects.moved_light import moved_light_bound
from simulator.effects.rendering_work import (
    FILTER_BANDWIDTH,
    LATERAL_COLOUR,
    LEVELS,
    OUT_OF_BAND_LEAK,
    channel_count_at,
    picture_samples_at,
)
from simulator.formation.distorting import (
    DISTORTION_OPERATIONS,
    distorted_frame,
    lateral_scales,
)
from simulator.formation.work import transform_operations
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation

Array = NDArray[np.float64]


class LateralColour(OnOffEffect, LightEffect):
    name = LATERAL_COLOUR
    recipe_field = "lateral_colour"
    physics = "the lens' glass images each wavelength at another scale: edges get coloured fringes"
    source = "Kingslake, Lens Design Fundamentals, chapter 11"

    def is_present(self, s: Situation) -> bool:
        return bool(s.camera.lens.lateral_colour) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.3 * relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: the gradient of coarse detail along the way, and all fine detail; area"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        if not levels[self.name]:
            return 0.0
        shape = picture_samples_at(s, levels)
        one = 6 * transform_operations(*shape) + DISTORTION_OPERATIONS * math.prod(shape)
        nodes = (
            LEVELS.wavelengths[levels.get(FILTER_BANDWIDTH, 0)]
            + LEVELS.leak[levels.get(OUT_OF_BAND_LEAK, 0)]
        )
        return one * nodes * channel_count_at(s, levels) * max(1, len(s.panel_content.pictures))

    def explain(self, s: Situation) -> str:
        low, high = lateral_scales(s)
        pixels = (high - low) * _corner(s) / s.camera.sensor.pitch
        return f"in the corners, colours lie up to {pixels:.2g} pixels apart"

    def _change(self, s: Situation) -> float:
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
