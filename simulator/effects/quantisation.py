"""Numbers are whole."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.on_pixels import held, pixels, root_pixels
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation


class Quantisation(Stage):
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

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return float(pixels(s)) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return f"steps of {sensor.gain:g} electrons, of {sensor.bits} bits"
