"""What goes on while the shutter is open: a lamp that isn't steady, and rows in turn."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from optics.light.waveform import Waveform
from optics.sensor.shutter import row_starts, skew
from simulator.effects.on_pixels import PixelStage, flickers, light, through_sensor
from simulator.planning import Bound, Stage
from simulator.situation import Situation

_INSTANTS = 4096
"""Parts of an exposure, whose means are exact, for the mean deviation within it."""


class LampFlicker(Stage):
    name = "lamp flicker"
    entry = "lamp"
    physics = "the lamp is brighter or darker than its mean while the shutter is open"
    source = "Waveform.mean(), exact integrals over each row's exposure; IEEE Std 1789"

    def caused(self, s: Situation) -> bool:
        return flickers(s) and not s.picture.dark

    def missed(self, s: Situation) -> float:
        return self._rows(s)

    def left_out(self, s: Situation) -> Bound:
        if s.shown.moves or s.target.moves:
            share, how = self._within(s), "proved: mean deviation of the lamp within the exposure"
        else:
            share, how = self._rows(s), "proved: largest deviation of a row's exposure"
        return through_sensor(s, share * s.picture.l2 * s.exposure, how)

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return float(s.camera.sensor.shape[0]) if levels[self.name] else 0.0

    def why(self, s: Situation) -> str:
        lamp = _lamp(s)
        periods = s.exposure * lamp.frequency
        return (
            f"the lamp's {lamp.ripple:.3g} at {lamp.frequency:g} Hz, over {periods:.3g} periods, "
            f"leave {self._rows(s):.2g}"
        )

    def _rows(self, s: Situation) -> float:
        """Of all rows' exposures, the largest deviation of the mean from 1.

        Where a rolling shutter is left out, all are exposed with the first.
        """
        begins = row_starts(s.camera.sensor, s.moment).numpy()
        return float(np.abs(_lamp(s).mean(begins, begins + s.exposure) - 1).max())

    def _within(self, s: Situation) -> float:
        """Mean deviation: what is seen may favour the brighter or the darker times.

        Of means over parts; what they don't show of it is that of a part, at most.
        """
        lamp = _lamp(s)
        if skew(s.camera.sensor):
            return lamp.ripple
        ends = s.moment + s.exposure * np.linspace(0, 1, _INSTANTS + 1)
        parts = np.abs(lamp.mean(ends[:-1], ends[1:]) - 1).mean()
        # Each change of sign within a part hides no more than the part: two in a period.
        hidden = (2 * s.exposure * lamp.frequency + 2) / _INSTANTS
        return min(float(parts) + hidden * lamp.ripple, lamp.ripple)


def _lamp(s: Situation) -> Waveform:
    assert s.target.lamp is not None
    return s.target.lamp


class RollingShutter(PixelStage):
    name = "rolling shutter"
    entry = "rolling"
    physics = "rows are exposed in turn, so each sees lamp, pattern and object at its own time"
    source = "EMVA 1288 release 4, general; Liang, Chang, Chen 2008"

    def caused(self, s: Situation) -> bool:
        changing = s.target.moves or s.shown.moves or flickers(s)
        return s.camera.sensor.shutter == "rolling" and changing and not s.picture.dark

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

    def _share(self, s: Situation) -> float:
        """Of the light, what is another in some row than in the first, at most."""
        begins = row_starts(s.camera.sensor, s.moment).numpy()
        if s.target.moves or s.shown.moves:
            # Both windows have light of their own, of the time by which they are apart.
            return float(2 * min(s.lasts / s.exposure - 1, 1.0))
        seen = _lamp(s).mean(begins, begins + s.exposure)
        return float(np.abs(seen - seen[0]).max())
