"""How much light the shadows of dust take, for the bounds of effects."""

from __future__ import annotations

import math
from dataclasses import dataclass

from simulator.formation.dust_shadows import dust_shadows
from simulator.situation import Situation


@dataclass(frozen=True)
class DustLosses:
    """Sums of the dust effect's losses over the pixels, each a share of a pixel's light.

    deepest: of any pixel. total: of all. norm: root of the sum of squares. pixels: that are shaded.
    Shadows that overlap count as if they added up.
    """

    deepest: float
    total: float
    norm: float
    pixels: float


def dust_losses(s: Situation) -> DustLosses:
    """Return the losses of the dust effect; all are 0 for a sensor without dust."""
    sensor = s.camera.sensor
    if not sensor.dust:
        return DustLosses(0.0, 0.0, 0.0, 0.0)
    losses = [one.loss for one in dust_shadows(sensor, s.camera.lens)]
    left = math.prod(1 - float(one.max()) for one in losses)
    return DustLosses(
        1 - left,
        sum(float(one.sum()) for one in losses),
        sum(math.sqrt(float((one**2).sum())) for one in losses),
        float(sum(one.size for one in losses)),
    )
