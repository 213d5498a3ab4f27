"""What the sensor's electronics do to the electrons of each pixel."""

from __future__ import annotations

import math
from dataclasses import replace

from optics.sensor import has_fixed_pattern
from simulator.effects.electron_bounds import (
    MAX_PIXEL_SIGMAS,
    PixelwiseEffect,
    affected_pixel_bound,
    can_clip,
    can_clip_at_zero,
    clipping_onset,
    dark_current_electrons,
    full_well_count,
    hot_pixel_norm,
    light_norm_bound,
    peak_electrons,
    pixel_count,
    sensor_error_bound,
    shot_noise_norm,
    sigma_by_light,
    sqrt_pixel_count,
)
from simulator.planning import Bound
from simulator.situation import Situation


class DarkCurrent(PixelwiseEffect):
    name = "dark current"
    recipe_field = "dark_current"
    physics = "heat frees electrons in the silicon, as many in every second, and hot pixels more"
    source = "EMVA 1288 release 4, section 2.4"

    def is_present(self, s: Situation) -> bool:
        return dark_current_electrons(s) > 0 or hot_pixel_norm(s) > 0

    def estimated_error_if_omitted(self, s: Situation) -> float:
        sensor = s.camera.sensor
        return math.sqrt(dark_current_electrons(s)) / math.hypot(sensor.read_noise, sensor.gain)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        change = dark_current_electrons(s) * sqrt_pixel_count(s) + hot_pixel_norm(s)
        how = "proved: so many more electrons in every pixel"
        bound = sensor_error_bound(s, change, how, read_noise=False)
        # σ grows by at most the square root of the added variance.
        hot = s.camera.sensor.hot_current * s.exposure
        count = affected_pixel_bound(s.camera.sensor.hot, pixel_count(s))
        added = dark_current_electrons(s) * pixel_count(s) + hot * count
        return replace(bound, sigma=sigma_by_light(bound, change, added))

    def explain(self, s: Situation) -> str:
        noise = math.hypot(s.camera.sensor.read_noise, s.camera.sensor.gain / math.sqrt(12))
        electrons = dark_current_electrons(s)
        return f"{electrons:.3g} electrons over the exposure, against {noise:.3g} of noise"


class FixedPattern(PixelwiseEffect):
    name = "fixed pattern"
    recipe_field = "fixed_pattern"
    operations_per_pixel = 3.0
    physics = "pixels differ in response (PRNU) and offset (DSNU), and some are dead or hot"
    source = "EMVA 1288 release 4, section 4"

    def is_present(self, s: Situation) -> bool:
        return has_fixed_pattern(s.camera.sensor)

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return s.camera.sensor.prnu + s.camera.sensor.dead

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        sensor = s.camera.sensor
        dead = math.sqrt(affected_pixel_bound(sensor.dead, pixel_count(s))) * peak_electrons(s)
        light = light_norm_bound(s)
        change = MAX_PIXEL_SIGMAS * sensor.prnu * light + min(dead, light) + hot_pixel_norm(s)
        how = "proved: the largest response and offset that there are"
        bound = sensor_error_bound(s, change, how, read_noise=False)
        return bound.plus(self._offsets(s))

    def explain(self, s: Situation) -> str:
        sensor = s.camera.sensor
        bad = f"{sensor.dead * 1e6:g} pixels in a million are dead, {sensor.hot * 1e6:g} hot"
        return f"responses differ by {sensor.prnu:.2%}, offsets by {sensor.dsnu:g} electrons; {bad}"

    def _offsets(self, s: Situation) -> Bound:
        """Bound the change by offsets (DSNU); variances change by rounding and clipping alone."""
        sensor, root = s.camera.sensor, sqrt_pixel_count(s)
        if not sensor.dsnu:
            return Bound()
        step, peak, pixels = sensor.gain, peak_electrons(s), pixel_count(s)
        spread = shot_noise_norm(s) + sensor.read_noise * root
        varied = step * (2 * spread + step * root)
        top = (sensor.top_number - sensor.black_level) * sensor.gain
        most = min(peak + 8 * math.sqrt(peak) + 30, sensor.full_well)
        high = most + 8 * sensor.read_noise + MAX_PIXEL_SIGMAS * sensor.dsnu > top
        cut = 0.0
        if can_clip_at_zero(sensor) or high:
            cut = (math.sqrt(peak) + sensor.read_noise) ** 2
        mean = sensor.dsnu * math.sqrt(pixels + 5 * math.sqrt(2 * pixels)) + step * root
        how = "proved: offsets, and a step of the converter's"
        return Bound(mean, varied + cut * root, (step + math.sqrt(cut)) * root, how=how)


class Clipping(PixelwiseEffect):
    name = "clipping"
    recipe_field = "clipping"
    operations_per_pixel = 2.0
    physics = "a full well holds no more electrons, and the converter's numbers end"
    source = "EMVA 1288 release 4, section 2.3, saturation capacity"
    is_per_frame = True

    def is_present(self, s: Situation) -> bool:
        return True

    def estimated_error_if_omitted(self, s: Situation) -> float:
        most = peak_electrons(s)
        return max(0.0, 1 - clipping_onset(s.camera.sensor) / most) if most else 0.0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        return self._above(s).plus(self._below(s))

    def explain(self, s: Situation) -> str:
        most, onset = peak_electrons(s), clipping_onset(s.camera.sensor)
        counted = "; errors are those of the picture before it is clipped" if most > onset else ""
        read = f"{onset:.3g} are read without clipping{counted}"
        return f"the brightest pixel could hold {most:.3g} electrons, and {read}"

    def _above(self, s: Situation) -> Bound:
        """Bound the change in pixels that may clip at the upper end."""
        how = "proved: excess of the brightest pixel, in as many pixels as the light allows"
        if not can_clip(s):
            return Bound(how=how)
        sensor, most, least = s.camera.sensor, peak_electrons(s), clipping_onset(s.camera.sensor)
        spread, root = math.sqrt(most), math.sqrt(full_well_count(s))
        noise, offset = sensor.read_noise + sensor.gain, MAX_PIXEL_SIGMAS * sensor.dsnu
        excess = max(most - least, 0.0) + 0.5 * spread + 0.5 * noise + offset
        varied = (spread + noise) ** 2
        return Bound(excess * root, varied * root, math.sqrt(varied) * root, how=how)

    def _below(self, s: Situation) -> Bound:
        """Bound the change in dark pixels whose noise reaches below the number 0."""
        sensor = s.camera.sensor
        noise = sensor.read_noise + sensor.gain
        how = "proved: noise below the number 0"
        if not can_clip_at_zero(sensor):
            return Bound(how=how)
        root, lost = sqrt_pixel_count(s), 0.5 * noise + MAX_PIXEL_SIGMAS * sensor.dsnu
        return Bound(lost * root, noise**2 * root, noise * root, how=how)


class ReadNoise(PixelwiseEffect):
    name = "read noise"
    recipe_field = "read_noise"
    operations_per_pixel = 8.0
    assumed_by_other_bounds = True
    physics = "amplifier and converter add a normal noise, the same in light and darkness"
    source = "EMVA 1288 release 4, section 2.4, temporal dark noise"
    is_per_frame = True

    def is_present(self, s: Situation) -> bool:
        return s.camera.sensor.read_noise > 0

    def estimated_error_if_omitted(self, s: Situation) -> float:
        sensor = s.camera.sensor
        mean = math.sqrt(max(float(s.picture_probe.total) * s.exposure / pixel_count(s), 1e-12))
        return sensor.read_noise**2 / (mean**2 + sensor.read_noise**2)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        sensor, root = s.camera.sensor, sqrt_pixel_count(s)
        read, step = sensor.read_noise, sensor.gain
        # Rounding, and clipping at the converter's ends, change how much read noise appears.
        kink = 0.5 * (read + MAX_PIXEL_SIGMAS * sensor.dsnu) if self._can_be_clipped(s) else 0.0
        # With a step of about an electron, rounding depends on the number of electrons.
        beat = min(step, 1.0) * shot_noise_norm(s)
        knee = read * math.sqrt(peak_electrons(s)) if self._can_be_clipped(s) else 0.0
        variance = (read**2 + step**2 + knee) * root + beat
        how = "audited ×1.5: its variance, and a step of the converter's"
        return Bound((0.5 * step + kink) * root, variance, (read + step) * root, how=how)

    def explain(self, s: Situation) -> str:
        sensor = s.camera.sensor
        rounding = f"{sensor.gain / math.sqrt(12):.2g} of rounding"
        return (
            f"{sensor.read_noise:g} electrons, against {rounding} and the root of the light's own"
        )

    def _can_be_clipped(self, s: Situation) -> bool:
        """Whether read noise can be clipped at the converter's ends."""
        sensor = s.camera.sensor
        at_top = can_clip(s) and clipping_onset(sensor) < sensor.full_well
        return can_clip_at_zero(sensor) or at_top


class Quantisation(PixelwiseEffect):
    name = "quantisation"
    recipe_field = "quantisation"
    physics = "the converter rounds to whole numbers, half a step at most"
    source = "EMVA 1288 release 4, section 2.3; Widrow and Kollár, Quantization Noise"
    is_per_frame = True

    def is_present(self, s: Situation) -> bool:
        return True

    def estimated_error_if_omitted(self, s: Situation) -> float:
        sensor = s.camera.sensor
        noise = float(s.picture_probe.total) * s.exposure / pixel_count(s) + sensor.read_noise**2
        return sensor.gain**2 / 12 / (noise + sensor.gain**2 / 12)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by half a step in each pixel.

        Rounding moves a number by at most half a step. So it moves the mean, and, by Minkowski, σ;
        the variance changes by the sum of both σ times that.
        """
        sensor, root = s.camera.sensor, sqrt_pixel_count(s)
        half, how = sensor.gain / 2, "proved: half a step; Minkowski's inequality"
        spread = shot_noise_norm(s) + sensor.read_noise * root
        return Bound(half * root, half * (2 * spread + half * root), half * root, how=how)

    def explain(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return f"steps of {sensor.gain:g} electrons, of {sensor.bits} bits"
