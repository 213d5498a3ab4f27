"""Rows that are exposed one after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optics.sensor.shutter import row_starts
from simulator.effects.on_pixels import PixelStage, flickers, light, through_sensor
from simulator.planning import Bound

if TYPE_CHECKING:
    from simulator.situation import Situation


class RollingShutter(PixelStage):
    name = "rolling shutter"
    entry = "rolling"
    physics = "rows are exposed in turn, so each sees lamp, pattern and object at its own time"
    source = "EMVA 1288 release 4, general; Liang, Chang, Chen 2008"

    def caused(self, s: Situation) -> bool:
        return s.camera.sensor.shutter == "rolling" and self._changing(s) and not s.picture.dark

    def missed(self, s: Situation) -> float:
        return self._share(s)

    def left_out(self, s: Situation) -> Bound:
        return through_sensor(
            s, self._share(s) * light(s), "proved: light of the times that a row doesn't share"
        )

    def why(self, s: Situation) -> str:
        late = s.lasts - s.exposure
        return (
            f"the last row starts {late * 1e3:.3g} ms after the first, of an exposure of "
            f"{s.exposure * 1e3:.3g} ms"
        )

    def _changing(self, s: Situation) -> bool:
        return s.target.moves or s.shown.moves or flickers(s)

    def _share(self, s: Situation) -> float:
        """Of the light, what is another in some row than in the first, at most."""
        begins = row_starts(s.camera.sensor, s.moment).numpy()
        if s.target.moves or s.shown.moves:
            # Both windows have light of their own, of the time by which they are apart.
            return float(2 * min(s.lasts / s.exposure - 1, 1.0))
        lamp = s.target.lamp
        assert lamp is not None
        seen = lamp.mean(begins, begins + s.exposure)
        return float(np.abs(seen - seen[0]).max())
