"""Waves, or the rays of the same wavefront."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blurs import BlurStage, filtered
from simulator.effects.costs import WAVES
from simulator.planning import Bound
from simulator.situation import Situation

_MARGIN = 1.5


class Diffraction(BlurStage):
    name = WAVES
    entry = "wave"
    likely = 0.3
    last = True
    physics = "light is a wave: it spreads behind every edge and interferes where rays cross"
    source = "Goodman, Introduction to Fourier Optics 6.4"
    levels = ("rays", "waves")

    def left_out(self, s: Situation) -> Bound:
        turn = s.pattern.mean_turn + s.camera.sensor.pitch
        waves = s.pattern.transfer

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            rays = np.minimum(2 * math.pi * k * turn, 2.0)
            apart = waves.lost_at(k.ravel()).reshape(k.shape) + rays
            return np.where(k > 0, np.minimum(_MARGIN * apart, 2.0), s.pattern.order_light)

        how = f"audited ×{_MARGIN:g}: |1 - H| of the waves, and of the rays by how far they turn"
        return filtered(s, gain, how)

    def why(self, s: Situation) -> str:
        spot = s.wavelength * s.camera.lens.image_distance / s.camera.lens.stop_diameter
        return (
            f"a diffraction spot is {spot * 1e6:.2g} µm wide and a pixel "
            f"{s.camera.sensor.pitch * 1e6:.3g} µm"
        )
