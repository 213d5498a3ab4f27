"""From a change of how points spread to a change of the picture.

A picture's light f is blurred by PSFs h. Whatever the blur, ‖Δh ∗ f‖₂ is at most ‖Δh‖₁ ‖f‖₂, and
at most ‖Δh‖₂ ‖f‖₁ (Young), and by frequency at most that of |ΔH| |F| (Parseval). Where layers hide
each other, what shines and what hides it are both blurred: the change counts twice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from simulator.effects.costs import added
from simulator.effects.limits import hides, uneven
from simulator.effects.on_pixels import in_proportion, light, seconds, sharp, through_sensor, whole
from simulator.planning import Bound, Effect, Stage
from simulator.probing.radial import Gain
from simulator.situation import Situation


def hiding(s: Situation) -> float:
    """How often a change counts."""
    return 2.0 if hides(s) else 1.0


def spread_otherwise(s: Situation, change: float, how: str, density: float = math.inf) -> Bound:
    """Of PSFs that differ by a share of their light, ‖Δh‖₁, 2 at most; both lose what the other
    hasn't.

    density: shares a square metre of sensor by which they differ anywhere, at most: ‖Δh‖₂² is no
    more than that times ‖Δh‖₁ times a pixel.
    """
    change = min(change, 2.0)
    on_pixel = min(density * s.camera.sensor.pitch**2, 1.0)
    of_points = math.sqrt(on_pixel * change) * whole(s)
    most = min(change * sharp(s), of_points, 2 * light(s))
    return through_sensor(s, hiding(s) * uneven(s) * most, how)


def filtered(s: Situation, gain: Gain, how: str) -> Bound:
    """Of transfer functions that differ by a gain at most, of cycles per metre."""
    return in_proportion(s, hiding(s) * float(s.picture.power.changed(gain)) * seconds(s), how)


def relative(s: Situation, bound: Bound) -> float:
    """About the relative change that a bound leaves of the sharp picture."""
    whole_light = light(s)
    return bound.mean / whole_light if whole_light else 0.0


class Blurring(Effect):
    """An effect that changes how points spread. likely: about how much of its bound is true."""

    likely: ClassVar[float] = 0.3

    def caused(self, s: Situation) -> bool:
        return not s.picture.dark

    def estimate(self, s: Situation, level: int) -> float:
        return self.likely * relative(s, self.bound(s, level))

    def work(self, s: Situation, levels: Mapping[str, int]) -> float:
        return added(s, levels, self.name)


class BlurStage(Stage, Blurring):
    """One of these that is on or off."""

    likely = 0.5

    def missed(self, s: Situation) -> float:
        return self.likely * relative(s, self.left_out(s))
