"""Light that lens and camera scatter over the whole sensor."""

from __future__ import annotations

import math

from simulator.effects.limits import uneven
from simulator.effects.on_pixels import PixelStage, beside, light, pixels, through_sensor, whole
from simulator.planning import Bound
from simulator.situation import Situation

_DIM = 0.1
"""Share of the pixels that may be dimmer than what a picture's dim tenth has."""


class VeilingGlare(PixelStage):
    name = "veiling glare"
    entry = "glare"
    operations = 3.0
    physics = "some of the light is reflected to and fro, and veils the picture evenly"
    source = "ISO 9358:1994, veiling glare index of image-forming systems"

    def caused(self, s: Situation) -> bool:
        return s.camera.glare > 0 and not s.picture.dark

    def missed(self, s: Situation) -> float:
        """Of a sharp picture: as much as it differs from its mean, all of which goes."""
        if not s.picture.l2:
            return 0.0
        even = s.picture.total**2 / pixels(s) / s.picture.l2**2
        return s.camera.glare * uneven(s) * math.sqrt(max(1 - even, 0.0))

    def left_out(self, s: Situation) -> Bound:
        """A picture differs from its mean by no more than from none. Dark pixels get much of
        theirs, so that the light of the dim tenth counts for the other nine only; of all that any
        pixels get or lose, σ² changes by no more than the variance (|√a - √b|² ≤ |a - b|)."""
        glare = s.camera.glare * uneven(s)
        how = "proved: the picture against its mean; Cauchy-Schwarz"
        bound = through_sensor(s, glare * light(s), how)
        slope = bound.variance / (glare * light(s)) if bound.variance else 0.0
        moved = slope * glare * (whole(s) + beside(s))
        sigma = min(math.hypot(bound.sigma, math.sqrt(_DIM * moved)), math.sqrt(2 * moved))
        return Bound(bound.mean, bound.variance, sigma, how=how)

    def why(self, s: Situation) -> str:
        return f"{s.camera.glare:.2g} of the light is spread evenly over the sensor"
