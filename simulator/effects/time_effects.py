"""Time within an exposure: a flickering lamp, and a rolling shutter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from optics.light.waveform import Waveform
from optics.sensor.readout import row_delay, row_starts
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    is_lamp_flickering,
    light_norm_bound,
    max_panel_power,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation


class LampFlicker(LightEffect, OnOffEffect):
    name = "lamp flicker"
    recipe_field = "lamp"
    physics = "the lamp is brighter or darker than its mean while the shutter is open"
    source = "Waveform.mean(), exact integrals over each row's exposure; IEEE Std 1789"

    def is_present(self, s: Situation) -> bool:
        return is_lamp_flickering(s) and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self._max_row_deviation(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        if s.panel_content.is_changing or s.target.is_moving:
            share, how = (
                self._mean_deviation(s),
                "proved: mean deviation of the lamp within the exposure",
            )
        else:
            share, how = self._max_row_deviation(s), "proved: largest deviation of a row's exposure"
        change = share * s.picture_probe.norm_bound * s.exposure * max_panel_power(s)
        return sensor_error_bound(s, change, how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return float(s.camera.sensor.shape[0]) if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        lamp = _lamp(s)
        periods = s.exposure * lamp.frequency
        return (
            f"the lamp's {lamp.ripple:.3g} at {lamp.frequency:g} Hz, over {periods:.3g} periods, "
            f"leave {self._max_row_deviation(s):.2g}"
        )

    def _max_row_deviation(self, s: Situation) -> float:
        """Return the largest deviation from 1 of the lamp's mean light over a row's exposure.

        Without a rolling shutter, all rows are exposed with the first.
        """
        begins = row_starts(s.camera.sensor, s.exposure_start).numpy()
        return float(np.abs(_lamp(s).mean(begins, begins + s.exposure) - 1).max())

    def _mean_deviation(self, s: Situation) -> float:
        """Bound the mean deviation of the lamp's light within the exposure.

        The panel or a motion may favour bright or dark times. The deviation is computed from exact
        means over 4096 parts of the exposure; a bound of what they can't show is added.
        """
        lamp = _lamp(s)
        if row_delay(s.camera.sensor):
            return lamp.ripple
        count = 4096
        ends = s.exposure_start + s.exposure * np.linspace(0, 1, count + 1)
        parts = np.abs(lamp.mean(ends[:-1], ends[1:]) - 1).mean()
        # A change of sign hides at most the part that it occurs in; there are two in a period.
        hidden = (2 * s.exposure * lamp.frequency + 2) / count
        return min(float(parts) + hidden * lamp.ripple, lamp.ripple)


def _lamp(s: Situation) -> Waveform:
    assert s.target.lamp is not None
    return s.target.lamp


class RollingShutter(LightEffect, PixelwiseEffect):
    name = "rolling shutter"
    likely_shares = (0.5,)
    recipe_field = "rolling"
    physics = "rows are exposed in turn, so each sees lamp, pattern and object at its own time"
    source = "EMVA 1288 release 4, general; Liang, Chang, Chen 2008"

    def is_present(self, s: Situation) -> bool:
        changing = s.target.is_moving or s.panel_content.is_changing or is_lamp_flickering(s)
        return s.camera.sensor.shutter == "rolling" and changing and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self._row_difference(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        return sensor_error_bound(
            s,
            self._row_difference(s) * light_norm_bound(s),
            "proved: light of the times that a row doesn't share",
        )

    def explain(self, s: Situation) -> str:
        late = s.exposure_span - s.exposure
        return (
            f"the last row starts {late * 1e3:.3g} ms after the first, of an exposure of "
            f"{s.exposure * 1e3:.3g} ms"
        )

    def _row_difference(self, s: Situation) -> float:
        """Bound how much any row's light differs from the first row's, as a share of the light."""
        begins = row_starts(s.camera.sensor, s.exposure_start).numpy()
        if s.target.is_moving or s.panel_content.is_changing:
            # Each of the two exposures has light of its own for as long as they don't overlap.
            return float(2 * min(s.exposure_span / s.exposure - 1, 1.0))
        seen = _lamp(s).mean(begins, begins + s.exposure)
        return float(np.abs(seen - seen[0]).max())
