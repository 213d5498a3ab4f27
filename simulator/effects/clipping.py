"""Wells that are full, and a converter that ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.on_pixels import (
    FURTHEST,
    brightest,
    full,
    limit,
    near_limit,
    near_zero,
    pixels,
)
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation


class Clipping(Stage):
    name = "clipping"
    entry = "clipping"
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

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 2.0 * pixels(s) if levels[self.name] else 0.0

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
