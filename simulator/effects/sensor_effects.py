"""What the sensor's electronics do to the electrons of each pixel."""

from __future__ import annotations

import math

from optics.sensor import uneven
from simulator.effects.on_pixels import (
    FURTHEST,
    PixelStage,
    at_most,
    brightest,
    dark,
    full,
    held,
    hot_norm,
    light,
    limit,
    near_limit,
    near_zero,
    pixels,
    root_pixels,
    through_sensor,
)
from simulator.planning import Bound
from simulator.situation import Situation


class DarkCurrent(PixelStage):
    name = "dark current"
    entry = "dark_current"
    physics = "heat frees electrons in the silicon, as many in every second, and hot pixels more"
    source = "EMVA 1288 release 4, section 2.4"

    def caused(self, s: Situation) -> bool:
        return dark(s) > 0 or hot_norm(s) > 0

    def missed(self, s: Situation) -> float:
        return math.sqrt(dark(s)) / math.hypot(s.camera.sensor.read_noise, s.camera.sensor.gain)

    def left_out(self, s: Situation) -> Bound:
        change = dark(s) * root_pixels(s) + hot_norm(s)
        how = "proved: so many more electrons in every pixel"
        bound = through_sensor(s, change, how, read_noise=False)
        # σ grows by the root of the variance that is added, at most.
        slope = bound.variance / change
        hot = s.camera.sensor.hot_current * s.exposure
        count = at_most(s.camera.sensor.hot, pixels(s))
        alone = math.sqrt(slope * (dark(s) * pixels(s) + hot * count))
        return Bound(bound.mean, bound.variance, alone, how=bound.how)

    def why(self, s: Situation) -> str:
        noise = math.hypot(s.camera.sensor.read_noise, s.camera.sensor.gain / math.sqrt(12))
        return f"{dark(s):.3g} electrons over the exposure, against {noise:.3g} of noise"


class FixedPattern(PixelStage):
    name = "fixed pattern"
    entry = "fixed_pattern"
    operations = 3.0
    physics = "pixels differ in response (PRNU) and offset (DSNU), and some are dead or hot"
    source = "EMVA 1288 release 4, section 4"

    def caused(self, s: Situation) -> bool:
        return uneven(s.camera.sensor)

    def missed(self, s: Situation) -> float:
        return s.camera.sensor.prnu + s.camera.sensor.dead

    def left_out(self, s: Situation) -> Bound:
        sensor = s.camera.sensor
        dead = math.sqrt(at_most(sensor.dead, pixels(s))) * brightest(s)
        change = FURTHEST * sensor.prnu * light(s) + min(dead, light(s)) + hot_norm(s)
        how = "proved: the largest response and offset that there are"
        bound = through_sensor(s, change, how, read_noise=False)
        return bound.plus(self._offsets(s))

    def why(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return (
            f"responses differ by {sensor.prnu:.2%}, offsets by {sensor.dsnu:g} electrons; "
            f"{sensor.dead * 1e6:g} pixels in a million are dead, {sensor.hot * 1e6:g} hot"
        )

    def _offsets(self, s: Situation) -> Bound:
        """Offsets move means; variance only by rounding and at the converter's ends."""
        sensor, root = s.camera.sensor, root_pixels(s)
        if not sensor.dsnu:
            return Bound()
        step = sensor.gain
        spread = math.sqrt(held(s) * root) + sensor.read_noise * root
        varied = step * (2 * spread + step * root)
        top = (2**sensor.bits - 1 - sensor.black_level) * sensor.gain
        most = min(brightest(s) + 8 * math.sqrt(brightest(s)) + 30, sensor.full_well)
        high = most + 8 * sensor.read_noise + FURTHEST * sensor.dsnu > top
        cut = (
            (math.sqrt(brightest(s)) + sensor.read_noise) ** 2 if near_zero(sensor) or high else 0.0
        )
        offset = sensor.dsnu * math.sqrt(pixels(s) + 5 * math.sqrt(2 * pixels(s)))
        return Bound(
            offset + step * root, varied + cut * root, (step + math.sqrt(cut)) * root,
            how="proved: offsets, and a step of the converter's",
        )  # fmt: skip


class Clipping(PixelStage):
    name = "clipping"
    entry = "clipping"
    operations = 2.0
    physics = "a full well holds no more electrons, and the converter's numbers end"
    source = "EMVA 1288 release 4, section 2.3, saturation capacity"
    each_frame = True

    def caused(self, s: Situation) -> bool:
        return True

    def missed(self, s: Situation) -> float:
        most = brightest(s)
        return max(0.0, 1 - limit(s.camera.sensor) / most) if most else 0.0

    def left_out(self, s: Situation) -> Bound:
        return self._above(s).plus(self._below(s))

    def why(self, s: Situation) -> str:
        return (
            f"the brightest pixel could hold {brightest(s):.3g} electrons, and "
            f"{limit(s.camera.sensor):.3g} are read without clipping"
        )

    def _above(self, s: Situation) -> Bound:
        """Of pixels that can come near the limit, at most so many as their squares allow."""
        how = "proved: excess of the brightest pixel, in as many pixels as the light allows"
        if not near_limit(s):
            return Bound(how=how)
        sensor, most, least = s.camera.sensor, brightest(s), limit(s.camera.sensor)
        spread = math.sqrt(most)
        count = full(s).count
        noise = sensor.read_noise + sensor.gain
        excess = max(most - least, 0.0) + 0.5 * spread + 0.5 * noise + FURTHEST * sensor.dsnu
        varied = (spread + noise) ** 2
        root = math.sqrt(count)
        return Bound(excess * root, varied * root, math.sqrt(varied) * root, how=how)

    def _below(self, s: Situation) -> Bound:
        """Of dark pixels whose noise reaches below the number 0."""
        sensor = s.camera.sensor
        noise = sensor.read_noise + sensor.gain
        how = "proved: noise below the number 0"
        if not near_zero(sensor):
            return Bound(how=how)
        root, lost = math.sqrt(pixels(s)), 0.5 * noise + FURTHEST * sensor.dsnu
        return Bound(lost * root, noise**2 * root, noise * root, how=how)


class ReadNoise(PixelStage):
    name = "read noise"
    entry = "read_noise"
    operations = 8.0
    last = True
    physics = "amplifier and converter add a normal noise, the same in light and darkness"
    source = "EMVA 1288 release 4, section 2.4, temporal dark noise"
    each_frame = True

    def caused(self, s: Situation) -> bool:
        return s.camera.sensor.read_noise > 0

    def missed(self, s: Situation) -> float:
        sensor = s.camera.sensor
        mean = math.sqrt(max(float(s.picture.total) * s.exposure / pixels(s), 1e-12))
        return sensor.read_noise**2 / (mean**2 + sensor.read_noise**2)

    def left_out(self, s: Situation) -> Bound:
        sensor, root = s.camera.sensor, root_pixels(s)
        read, step = sensor.read_noise, sensor.gain
        # Rounding hides or shows some of it, and so does the converter's end.
        kink = 0.5 * (read + FURTHEST * sensor.dsnu) if self._cut(s) else 0.0
        # Whole electrons in steps of about as many: roundings follow the electrons for a while.
        beat = min(step, 1.0) * math.sqrt(held(s) * root)
        knee = read * math.sqrt(brightest(s)) if self._cut(s) else 0.0
        return Bound(
            (0.5 * step + kink) * root,
            (read**2 + step**2 + knee) * root + beat,
            (read + step) * root,
            how="audited ×1.5: its variance, and a step of the converter's",
        )

    def why(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return (
            f"{sensor.read_noise:g} electrons, against {sensor.gain / math.sqrt(12):.2g} of "
            "rounding and the root of the light's own"
        )

    def _cut(self, s: Situation) -> bool:
        sensor = s.camera.sensor
        return near_zero(sensor) or (near_limit(s) and limit(sensor) < sensor.full_well)


class Quantisation(PixelStage):
    name = "quantisation"
    entry = "quantisation"
    physics = "the converter rounds to whole numbers, half a step at most"
    source = "EMVA 1288 release 4, section 2.3; Widrow and Kollár, Quantization Noise"
    each_frame = True

    def caused(self, s: Situation) -> bool:
        return True

    def missed(self, s: Situation) -> float:
        sensor = s.camera.sensor
        noise = float(s.picture.total) * s.exposure / pixels(s) + sensor.read_noise**2
        return sensor.gain**2 / 12 / (noise + sensor.gain**2 / 12)

    def left_out(self, s: Situation) -> Bound:
        """Rounding moves a number by half a step, and so its mean and, by Minkowski, its σ; the
        variance by the sum of both σ times that."""
        sensor, root = s.camera.sensor, root_pixels(s)
        half = sensor.gain / 2
        spread = math.sqrt(held(s) * root) + sensor.read_noise * root
        return Bound(
            half * root,
            half * (2 * spread + half * root),
            half * root,
            how="proved: half a step; Minkowski's inequality",
        )

    def why(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return f"steps of {sensor.gain:g} electrons, of {sensor.bits} bits"
