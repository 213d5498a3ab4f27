"""How far from its image a point's light is followed."""

from __future__ import annotations

import math

from optics.edge import as_number
from simulator.effects.blurs import Blurring, hiding
from simulator.effects.costs import REACH, WINDOWS, smallest_above
from simulator.effects.limits import energy, uneven
from simulator.effects.on_pixels import light, sharp, through_sensor, whole
from simulator.effects.spectra import leaking
from simulator.formation.windows import span
from simulator.planning import Bound
from simulator.situation import Situation

_MARGIN = 1.5
"""Audited: with some of the panel's effects off, or all on, more light may go far."""

_FADING = 6.0
"""Sensor pixels beyond a period, over which the next order comes in."""


class Reach(Blurring):
    name = REACH
    kind = "stage"
    entry, values = "window", WINDOWS
    physics = "a PSF's skirts reach far, and hold little light at a time"
    source = "far field of the shown pattern"
    levels = tuple(f"{n} px" for n in WINDOWS)

    def finest(self, s: Situation) -> int:
        """All of the panel's middle order, at the longest wavelength, that can fall on a pixel."""
        longest = max(s.band.support[1], s.band.leak_range[1] if s.band.leak else 0.0)
        period = longest * as_number(s.camera.lever) / s.camera.panel.pitch
        far = min(period, 2 * max(span(s)))
        return smallest_above(WINDOWS, far / s.camera.sensor.pitch + _FADING)

    def estimate(self, s: Situation, level: int) -> float:
        return 0.0 if level >= self.finest(s) else 0.5 * _beyond(s, level)

    def coarser(self, s: Situation, level: int) -> Bound:
        how = f"audited ×{_MARGIN:g}: Young; light beyond, in the far field"
        missing = sum(
            share * math.sqrt(energy(s, _half(s, level, longest))) for share, longest in _waves(s)
        ) * whole(s)
        change = min(_MARGIN * _beyond(s, level) * sharp(s), missing, light(s))
        return through_sensor(s, hiding(s) * uneven(s) * change, how)

    def why(self, s: Situation) -> str:
        half = WINDOWS[0] / 2
        return f"{_beyond(s, 0):.2g} of a point's light falls more than {half:.0f} pixels from it"


def _waves(s: Situation) -> list[tuple[float, float]]:
    """Shares of the light, at most, and the longest wavelength of each, which is spread the
    farthest: of the band, and of what leaks beside it."""
    leak = [(leaking(s), s.band.leak_range[1])] if s.band.leak else []
    return [(1.0, s.band.support[1]), *leak]


def _half(s: Situation, level: int, longest: float) -> float:
    """Metres from a point's image to the sides of the window, as if light of a wavelength were of
    the middle one."""
    half = (WINDOWS[level] / 2 - 1) * s.camera.sensor.pitch
    turned = abs(math.cos(2 * s.mount.rotation)) < 1 - 1e-9
    return half * s.wavelength / longest / (math.sqrt(2) if turned else 1.0)


def _beyond(s: Situation, level: int) -> float:
    found = (share * s.pattern.beyond(_half(s, level, longest)) for share, longest in _waves(s))
    return min(sum(found), 1.0)
