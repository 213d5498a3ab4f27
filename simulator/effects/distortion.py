"""The effect of distortion: the lens' magnification changes over the field."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from simulator.effects.electron_bounds import (
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.moved_light import moved_light_bound
from simulator.effects.rendering_work import (
    LATERAL_COLOUR,
    channel_count_at,
    picture_samples_at,
)
from simulator.formation.distorting import DISTORTION_OPERATIONS, distorted_frame
from simulator.formation.work import transform_operations
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation


class Distortion(OnOffEffect, LightEffect):
    name = "distortion"
    recipe_field = "distortion"
    physics = "the lens' magnification changes with the image height: straight lines bend"
    source = "Brown 1971, Close-range camera calibration"

    def is_present(self, s: Situation) -> bool:
        return any(s.camera.lens.distortion) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.3 * relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: the gradient of coarse detail along the way, and all fine detail; area"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        if not levels[self.name] or levels.get(LATERAL_COLOUR, 0):
            return 0.0  # What scales each wavelength distorts it as well.
        shape = picture_samples_at(s, levels)
        one = 6 * transform_operations(*shape) + DISTORTION_OPERATIONS * math.prod(shape)
        return one * channel_count_at(s, levels) * max(1, len(s.panel_content.pictures))

    def explain(self, s: Situation) -> str:
        frame = distorted_frame(s.camera)
        return (
            f"light moves by {frame.reach / s.camera.sensor.pitch:.3g} pixels at most, and areas "
            f"change by {max(frame.largest, 1 / frame.least) - 1:.2g}"
        )

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the distortion effect moves."""
        frame = distorted_frame(s.camera)
        gain = max(frame.largest, 1 / frame.least)
        return moved_light_bound(
            s, lambda rate, most: np.minimum(rate * frame.reach, most), gain - 1
        )
