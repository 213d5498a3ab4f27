"""Time within an exposure: lamp flicker, motion, vibration, and a rolling shutter."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from optics.light.waveform import Waveform
from optics.sensor.readout import row_delay, row_starts
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    finest_octave_norm,
    is_lamp_flickering,
    lamp_ripple,
    light_norm_bound,
    max_light_seconds,
    max_panel_power,
    sensor_error_bound,
)
from simulator.effects.light_effects import MAX_SINC_LOSS, LightChange, LightEffect
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.rendering_work import (
    channel_count_at,
    picture_samples_at,
    picture_transform_operations,
)
from simulator.formation.mean_picture import image_vibration
from simulator.planning import Bound, OnOffEffect
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation

Array = NDArray[np.float64]


class LampFlicker(LightEffect, OnOffEffect):
    name = "lamp flicker"
    recipe_field = "lamp"
    physics = "the lamp is brighter or darker than its mean while the shutter is open"
    source = "Waveform.mean(), exact integrals over each row's exposure; IEEE Std 1789"

    def is_caused(self, s: Situation) -> bool:
        return is_lamp_flickering(s)

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self._max_row_deviation(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        share, how = self._max_row_deviation(s), "proved: largest deviation of a row's exposure"
        if s.panel_content.is_changing or s.target.is_moving:
            share = self._mean_deviation(s)
            how = "proved: mean deviation of the lamp within the exposure"
        change = share * s.picture_probe.norm_bound * s.exposure * max_panel_power(s)
        return sensor_error_bound(s, change, how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return float(s.camera.sensor.shape[0]) if levels[self.name] else 0.0

    def explain(self, s: Situation) -> str:
        lamp, left = _lamp(s), f"leave {self._max_row_deviation(s):.2g}"
        over = f"over {s.exposure * lamp.frequency:.3g} periods"
        return f"the lamp's {lamp.ripple:.3g} at {lamp.frequency:g} Hz, {over}, {left}"

    def _max_row_deviation(self, s: Situation) -> float:
        """Return the largest deviation from 1 of the lamp's mean light over a row's exposure."""
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


class Motion(LightEffect):
    name = "motion"
    likely_shares = (0.5,)
    kind = "axis"
    recipe_field, recipe_values = "motion", (1, 2, 4, 8, 16, 32)
    physics = "what moves during the exposure is smeared along its path"
    source = "the transfer function of a uniform motion, sinc(k v T); Goodman, Introduction to "\
        "Fourier Optics"  # fmt: skip
    levels = ("off", "2", "4", "8", "16", "32")

    def is_caused(self, s: Situation) -> bool:
        return s.target.is_moving and any(self._paths(s))

    def finest_level(self, s: Situation) -> int:
        # A uniform motion is rendered exactly if light, panel and the rows' times are constant.
        changing = s.panel_content.is_changing or is_lamp_flickering(s)
        return len(self.levels) - 1 if changing or row_delay(s.camera.sensor) else 1

    def estimated_error(self, s: Situation, level: int) -> float:
        whole = s.picture_probe.norm_bound
        return self._change(s, level) / whole if whole and level < self.finest_level(s) else 0.0

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        change = self._change(s, level) + self._change(s, self.finest_level(s))
        how = "proved: phases of light along the path, (π k v T)²/6 at most"
        return sensor_error_bound(s, change * max_light_seconds(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        """Return the operations of further parts of the motion: pictures with the same PSFs."""
        level, parts = levels[self.name], sum(len(layer.parts) for layer in s.target.layers)
        more = 2**level * math.ceil(s.exposure_span / s.exposure) - 1 if level else 0
        return more * (2 * parts + 1) * picture_transform_operations(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = max(self._paths(s)) / s.camera.sensor.pitch
        return f"it moves by {pixels:.3g} pixels in {s.exposure * 1e3:.3g} ms"

    def _paths(self, s: Situation) -> list[float]:
        """Return the metres on the sensor over which each layer is smeared."""
        speed = math.hypot(*s.target.velocity)
        scales = (s.camera.magnification(layer.distance) for layer in s.target.layers)
        return [speed * s.exposure * scale for scale in scales]

    def _change(self, s: Situation, level: int) -> float:
        """Bound the L2 error at a level, in electrons per second."""
        return s.picture_probe.change_bound([self._gain(s, path, level) for path in self._paths(s)])

    def _gain(self, s: Situation, path: float, level: int) -> Gain:
        """Bound the error by frequency, for a layer that moves `path` metres on the sensor.

        All light of a part of the path, of length ℓ, is spread evenly over the part: its phases 2π
        k x differ from that of the middle by 2π k ℓ/4 on average. They are weighted by the lamp's
        deviation, at most twice its ripple, or by the PSF's change, at most 2. With a rolling
        shutter, rows see parts of these parts: then the phase of each instant counts, over a path
        that is longer by the frame's duration over the exposure.
        """
        part = path / 2**level if level else path
        uneven = 2.0 * (1 + lamp_ripple(s)) if s.panel_content.is_changing else 2 * lamp_ripple(s)
        late = 0.0
        if row_delay(s.camera.sensor):
            late = math.sqrt(s.exposure_span / s.exposure) * (1 + lamp_ripple(s))
        away = part if level else path * s.exposure_span / s.exposure

        def gain(k: Array) -> Array:
            if late:
                # At level 0, light is rendered where it is in the middle of the first row's
                # exposure; other rows' light may be the path of a whole frame away from there.
                reach = 2 * np.pi if level == 0 else np.pi
                return late * np.minimum(2.0, reach * k * away)
            smear = np.minimum((np.pi * k * path) ** 2 / 6, MAX_SINC_LOSS) if level == 0 else 0.0
            return smear + uneven * np.minimum(1.0, np.pi * k * part / 2)

        return gain


class Vibration(LightChange):
    name = "vibration"
    recipe_field = "vibration"
    physics = "the image trembles on the sensor while it is exposed, which blurs it"
    source = "Wulich and Kopeika 1987, Image resolution limits resulting from mechanical vibrations"
    how = "audited ×1: the loss of contrast by frequency, and that of what pixels fold back"

    def is_caused(self, s: Situation) -> bool:
        return s.camera.vibration > 0

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        samples = math.prod(picture_samples_at(s, levels)) if levels[self.name] else 0
        return 10.0 * samples * channel_count_at(s, levels)

    def explain(self, s: Situation) -> str:
        pixels = image_vibration(s) / s.camera.sensor.pitch
        return f"in {s.exposure * 1e3:.3g} ms the image trembles by {pixels:.2g} pixels rms"

    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that move."""
        rms, probe, pitch = image_vibration(s), s.picture_probe, s.camera.sensor.pitch

        def loss(k: Array) -> Array:
            return np.asarray(1 - np.exp(-2 * (np.pi * rms * k) ** 2)) * mtf_bound(s, k)

        resolved = probe.change_bound([loss] * len(probe.distances))
        folded = (1 - math.exp(-2 * (math.pi * rms / pitch) ** 2)) * finest_octave_norm(s)
        return min(math.hypot(resolved, folded) * max_light_seconds(s), light_norm_bound(s))


class RollingShutter(LightEffect, PixelwiseEffect):
    name = "rolling shutter"
    likely_shares = (0.5,)
    recipe_field = "rolling"
    physics = "rows are exposed in turn, so each sees lamp, pattern and object at its own time"
    source = "EMVA 1288 release 4, general; Liang, Chang, Chen 2008"

    def is_caused(self, s: Situation) -> bool:
        changing = s.target.is_moving or s.panel_content.is_changing or is_lamp_flickering(s)
        return s.camera.sensor.shutter == "rolling" and changing

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return self._row_difference(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: light of the times that a row doesn't share"
        return sensor_error_bound(s, self._row_difference(s) * light_norm_bound(s), how)

    def explain(self, s: Situation) -> str:
        late, each = (s.exposure_span - s.exposure) * 1e3, s.exposure * 1e3
        return f"the last row starts {late:.3g} ms after the first, of an exposure of {each:.3g} ms"

    def _row_difference(self, s: Situation) -> float:
        """Bound how much any row's light differs from the first row's, as a share of the light."""
        if s.target.is_moving or s.panel_content.is_changing:
            # Each of the two exposures has light of its own for as long as they don't overlap.
            return float(2 * min(s.exposure_span / s.exposure - 1, 1.0))
        begins = row_starts(s.camera.sensor, s.exposure_start).numpy()
        seen = _lamp(s).mean(begins, begins + s.exposure)
        return float(np.abs(seen - seen[0]).max())
