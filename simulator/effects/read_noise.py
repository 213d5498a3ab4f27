"""Noise of reading a pixel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from simulator.effects.on_pixels import (
    FURTHEST,
    brightest,
    held,
    limit,
    near_limit,
    near_zero,
    pixels,
    root_pixels,
)
from simulator.planning import Bound, Stage

if TYPE_CHECKING:
    from simulator.situation import Situation


class ReadNoise(Stage):
    name = "read noise"
    entry = "read_noise"
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

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return 8.0 * pixels(s) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        sensor = s.camera.sensor
        return (
            f"{sensor.read_noise:g} electrons, against {sensor.gain / math.sqrt(12):.2g} of "
            "rounding and the root of the light's own"
        )

    def _cut(self, s: Situation) -> bool:
        sensor = s.camera.sensor
        return near_zero(sensor) or (near_limit(s) and limit(sensor) < sensor.full_well)
