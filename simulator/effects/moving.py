"""A target that moves across the axis while the shutter is open."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.sensor.shutter import row_delay
from simulator.effects.electron_bounds import (
    is_lamp_flickering,
    lamp_ripple,
    max_lamp_seconds,
    sensor_error_bound,
)
from simulator.effects.rendering_work import PSF_REACH, PSF_WINDOWS
from simulator.formation.windows import picture_shape
from simulator.formation.work import transform_operations
from simulator.planning import Bound, Effect
from simulator.probing.radial import Gain
from simulator.situation import Situation

_MOST = 1.2173
"""Of 1 - sinc, anywhere."""


class Motion(Effect):
    name = "motion"
    kind = "axis"
    recipe_field, recipe_values = "motion", (1, 2, 4, 8, 16, 32)
    physics = "what moves during the exposure is smeared along its path"
    source = "the transfer function of a uniform motion, sinc(k v T); Goodman, Introduction to "\
        "Fourier Optics"  # fmt: skip
    levels = ("off", "2", "4", "8", "16", "32")

    def is_present(self, s: Situation) -> bool:
        return s.target.is_moving and not s.picture_probe.is_dark and any(self._paths(s))

    def finest_level(self, s: Situation) -> int:
        # An even path in steady light, by a panel that stays as it is, is exact.
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
        return sensor_error_bound(s, change * max_lamp_seconds(s), how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Of parts of the path beyond one: each is a picture of its own, by the same PSFs."""
        parts = sum(len(layer.parts) for layer in s.target.layers)
        more = self._parts(s, levels[self.name]) - 1
        return more * (2 * parts + 1) * transform(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = max(self._paths(s)) / s.camera.sensor.pitch
        return f"it moves by {pixels:.3g} pixels in {s.exposure * 1e3:.3g} ms"

    def _paths(self, s: Situation) -> list[float]:
        """Metres on the sensor during the exposure, of each layer."""
        speed = math.hypot(*s.target.velocity)
        scales = (s.camera.magnification(layer.distance) for layer in s.target.layers)
        return [speed * s.exposure * scale for scale in scales]

    def _parts(self, s: Situation, level: int) -> int:
        return 2**level * math.ceil(s.exposure_span / s.exposure) if level else 1

    def _change(self, s: Situation, level: int) -> float:
        """L2 of electrons per second against the path itself, at most."""
        return s.picture_probe.change_bound([self._gain(s, path, level) for path in self._paths(s)])

    def _gain(self, s: Situation, path: float, level: int) -> Gain:
        """On the frequencies of a layer that moves so many metres.

        Within a part of length ℓ light stands for light up to ℓ away: the phases 2π k x differ
        by 2π k ℓ/4 in the mean from their middle's. What weighs them is the lamp's deviation,
        twice its ripple at most, or a PSF's, up to 2. Rows that are exposed in turn see
        parts of parts: then each light's own phase counts, as much longer as the frame takes.
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
                # A row's light is as far from the middle of the first as the frame takes.
                reach = 2 * np.pi if level == 0 else np.pi
                return late * np.minimum(2.0, reach * k * away)
            smear = np.minimum((np.pi * k * path) ** 2 / 6, _MOST) if level == 0 else 0.0
            return smear + uneven * np.minimum(1.0, np.pi * k * part / 2)

        return gain


def transform(s: Situation, levels: Mapping[str, int]) -> float:
    """Operations of a transform of all samples, by how far PSFs reach and how fine samples are."""
    shape = picture_shape(s, PSF_WINDOWS[levels.get(PSF_REACH, 0)], 0)
    rows, columns = (n * s.coarsest_sampling for n in shape)
    return transform_operations(rows, columns)
