"""Electrons that come without light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.on_pixels import (
    at_most,
    dark,
    hot_norm,
    pixels,
    root_pixels,
    through_sensor,
)
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation


class DarkCurrent(Stage):
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

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return float(pixels(s)) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        return f"{dark(s):.3g} electrons over the exposure, against {self._noise(s):.3g} of noise"

    def _noise(self, s: Situation) -> float:
        sensor = s.camera.sensor
        return math.hypot(sensor.read_noise, sensor.gain / math.sqrt(12))
