"""Pixels that differ, always in the same way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from optics.sensor import uneven
from simulator.effects.on_pixels import (
    FURTHEST,
    at_most,
    brightest,
    held,
    hot_norm,
    light,
    near_zero,
    pixels,
    root_pixels,
    through_sensor,
)
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation


class FixedPattern(Stage):
    name = "fixed pattern"
    entry = "fixed_pattern"
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

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 3.0 * pixels(s) if levels[self.name] else 0.0

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
