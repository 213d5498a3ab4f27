"""Diffraction: waves instead of the rays of the same wavefront."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from simulator.effects.blur_effects import OnOffBlurEffect, transfer_error_bound
from simulator.effects.field_waves import displacement, psf_change
from simulator.effects.rendering_work import DIFFRACTION
from simulator.planning import Bound
from simulator.situation import Situation


class Diffraction(OnOffBlurEffect):
    """Diffraction of the light; without it, a PSF is the geometric blur of the wavefront.

    audit_margin: factor of its error bound, from audits.
    """

    audit_margin: ClassVar[float] = 1.5
    name = DIFFRACTION
    likely_shares = (0.6,)
    recipe_field = "diffraction"
    typical_bound_share = 0.3
    assumed_by_other_bounds = True
    physics = "light is a wave: it spreads behind every edge and interferes where rays cross"
    source = "Goodman, Introduction to Fourier Optics 6.4"
    levels = ("rays", "waves")

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        turn = s.pattern_probe.mean_ray_displacement + s.camera.sensor.pitch + displacement(s)
        aberrated = psf_change(s)
        waves = s.pattern_probe.transfer_bounds

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            rays = np.minimum(2 * math.pi * k * turn, 2.0)
            apart = waves.loss_bound(k.ravel()).reshape(k.shape) + rays + aberrated
            return np.where(
                k > 0, np.minimum(self.audit_margin * apart, 2.0), s.pattern_probe.side_order_share
            )

        how = (
            f"audited ×{self.audit_margin:g}: |1 - H| of the waves, and of the rays by how far "
            "they turn"
        )
        return transfer_error_bound(s, gain, how)

    def explain(self, s: Situation) -> str:
        spot = s.wavelength * s.camera.lens.image_distance / s.camera.lens.stop_diameter
        return (
            f"a diffraction spot is {spot * 1e6:.2g} µm wide and a pixel "
            f"{s.camera.sensor.pitch * 1e6:.3g} µm"
        )
