"""The effect of a target that moves across the axis during the exposure."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.sensor.shutter import row_delay
from simulator.effects.blur_effects import MAX_SINC_LOSS
from simulator.effects.electron_bounds import (
    is_lamp_flickering,
    lamp_ripple,
    max_light_seconds,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.rendering_work import LEVELS, PSF_REACH, light_samples_at
from simulator.formation.windows import rendering_windows
from simulator.formation.work import transform_operations
from simulator.planning import Bound
from simulator.probing.radial import Gain
from simulator.situation import Situation


class Motion(LightEffect):
    name = "motion"
    likely_shares = (0.5,)
    kind = "axis"
    recipe_field, recipe_values = "motion", (1, 2, 4, 8, 16, 32)
    physics = "what moves during the exposure is smeared along its path"
    source = "the transfer function of a uniform motion, sinc(k v T); Goodman, Introduction to "\
        "Fourier Optics"  # fmt: skip
    levels = ("off", "2", "4", "8", "16", "32")

    def is_present(self, s: Situation) -> bool:
        return s.target.is_moving and not s.picture_probe.is_dark and any(self._paths(s))

    def finest_level(self, s: Situation) -> int:
        # A uniform motion is rendered exactly, if the light, the panel and the rows' times are
        # constant.
        changing = (
            s.panel_content.is_changing or is_lamp_flickering(s) or row_delay(s.camera.sensor)
        )
        return len(self.levels) - 1 if changing else 1

    def estimated_error(self, s: Situation, level: int) -> float:
        whole = s.picture_probe.norm_bound
        return self._change(s, level) / whole if whole and level < self.finest_level(s) else 0.0

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest_level(s))
        how = "proved: phases of light along the path, (π k v T)²/6 at most"
        return sensor_error_bound(s, change * max_light_seconds(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations that the motion effect adds: each further part is a picture.

        All parts use the same PSFs.
        """
        parts = sum(len(layer.parts) for layer in s.target.layers)
        more = self._parts(s, levels[self.name]) - 1
        return more * (2 * parts + 1) * transform(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = max(self._paths(s)) / s.camera.sensor.pitch
        return f"it moves by {pixels:.3g} pixels in {s.exposure * 1e3:.3g} ms"

    def _paths(self, s: Situation) -> list[float]:
        """Return the metres by which the motion effect smears each layer on the sensor."""
        speed = math.hypot(*s.target.velocity)
        scales = (s.camera.magnification(layer.distance) for layer in s.target.layers)
        return [speed * s.exposure * scale for scale in scales]

    def _parts(self, s: Situation, level: int) -> int:
        """Return how many parts a level of the motion effect divides the frame's motion into."""
        return 2**level * math.ceil(s.exposure_span / s.exposure) if level else 1

    def _change(self, s: Situation, level: int) -> float:
        """Bound the L2 error of the motion effect at a level, in electrons per second."""
        return s.picture_probe.change_bound([self._gain(s, path, level) for path in self._paths(s)])

    def _gain(self, s: Situation, path: float, level: int) -> Gain:
        """Bound the motion effect's error by frequency, for a layer that moves `path` metres.

        All light of a part of the path, of length ℓ, is spread evenly over the part: its phases 2π
        k x differ from that of the middle by 2π k ℓ/4 on average. They are weighted by the lamp's
        deviation, at most twice its ripple, or by the PSF's change, at most 2. With a rolling
        shutter, rows see parts of these parts: then the phase of each instant counts, over a path
        that is longer by the frame's duration over the exposure.
        """
        part = path / 2**level if level else path
        uneven = 2.0 * (1 + lamp_ripple(s)) if s.panel_content.is_changing else 2 * lamp_ripple(s)
        late = (
            math.sqrt(s.exposure_span / s.exposure) * (1 + lamp_ripple(s))
            if row_delay(s.camera.sensor)
            else 0.0
        )
        away = part if level else path * s.exposure_span / s.exposure

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            if late:
                # At level 0, light is rendered where it is in the middle of the first row's
                # exposure; other rows' light may be the path of a whole frame away from there.
                reach = 2 * np.pi if level == 0 else np.pi
                return late * np.minimum(2.0, reach * k * away)
            smear = np.minimum((np.pi * k * path) ** 2 / 6, MAX_SINC_LOSS) if level == 0 else 0.0
            return smear + uneven * np.minimum(1.0, np.pi * k * part / 2)

        return gain


def transform(s: Situation, levels: Mapping[str, int]) -> float:
    """Return the operations of a Fourier transform of the whole picture, to count effects' work.

    The number depends on how far the PSFs reach and how fine the samples are.
    """
    windows = rendering_windows(s, LEVELS.windows[levels.get(PSF_REACH, 0)])
    return transform_operations(*(n * light_samples_at(s, levels) for n in windows.picture))
