"""The effect of distortion: the lens' magnification changes over the field."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    area_change,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.rendering_work import channel_count_at, picture_samples_at
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
        if not levels[self.name]:
            return 0.0
        shape = picture_samples_at(s, levels)
        one = 6 * transform_operations(*shape) + DISTORTION_OPERATIONS * math.prod(shape)
        return one * channel_count_at(s, levels) * max(1, len(s.panel_content.pictures))

    def explain(self, s: Situation) -> str:
        frame = distorted_frame(s.camera)
        return (
            f"light moves by {frame.reach / s.camera.sensor.pitch:.3g} pixels at most, and areas "
            f"change by {area_change(s) - 1:.2g}"
        )

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the distortion effect moves.

        A picture m and its distorted one differ by the change of brightness, and by m at places
        that are apart. Of detail coarser than any limit the latter is at most the way times its
        gradient, and of finer detail at most both norms. With the best limit, both together are at
        most √2 times the norm of the lesser of the two at each frequency.
        """
        moved, gain = distorted_frame(s.camera).reach, area_change(s)
        whole = light_norm_bound(s)

        def lesser(k: NDArray[np.float64]) -> NDArray[np.float64]:
            along = np.minimum(2 * np.pi * k * moved * math.sqrt(gain), 1 + math.sqrt(gain))
            return np.asarray(math.sqrt(2) * along * mtf_bound(s, k))

        power, pitch = s.picture_probe.power_spectrum, s.camera.sensor.pitch
        folded = min(2 * np.pi * moved / pitch, 2.0) * finest_octave_norm(s)
        resolved = math.hypot(power.filtered_norm_bound(lesser), folded) * max_light_seconds(s)
        most = (1 + math.sqrt(gain)) * whole
        brighter = 0.0 if s.camera.lens.relative_illumination else gain - 1
        return min(resolved + 2 * off_plane_star_electrons(s), most) + brighter * whole
