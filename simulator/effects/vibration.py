"""Vibration: the image trembles on the sensor during an exposure."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.rendering_work import channel_count_at, picture_samples_at
from simulator.formation.mean_picture import image_vibration
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation


class Vibration(OnOffEffect, LightEffect):
    name = "vibration"
    recipe_field = "vibration"
    physics = "the image trembles on the sensor while it is exposed, which blurs it"
    source = "Wulich and Kopeika 1987, Image resolution limits resulting from mechanical vibrations"

    def is_present(self, s: Situation) -> bool:
        return s.camera.vibration > 0 and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, self._change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "audited ×1: the loss of contrast by frequency, and that of what pixels fold back"
        return sensor_error_bound(s, self._change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        samples = math.prod(picture_samples_at(s, levels)) if levels[self.name] else 0
        return 10.0 * samples * channel_count_at(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = image_vibration(s) / s.camera.sensor.pitch
        return f"in {s.exposure * 1e3:.3g} ms the image trembles by {pixels:.2g} pixels rms"

    def _change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that move."""
        rms, probe, pitch = image_vibration(s), s.picture_probe, s.camera.sensor.pitch

        def loss(k: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(1 - np.exp(-2 * (np.pi * rms * k) ** 2)) * mtf_bound(s, k)

        resolved = probe.change_bound([loss] * len(probe.distances))
        folded = (1 - math.exp(-2 * (math.pi * rms / pitch) ** 2)) * finest_octave_norm(s)
        return min(math.hypot(resolved, folded) * max_light_seconds(s), light_norm_bound(s))
