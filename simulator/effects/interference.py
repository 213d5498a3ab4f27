"""Interference between unmodulated and modulated light."""

from __future__ import annotations

from simulator.effects.blur_effects import OnOffBlurEffect, psf_error_bound
from simulator.effects.field_distance import sample_pixels
from simulator.effects.rendering_work import POLARISATION_INTERFERENCE
from simulator.planning import Bound
from simulator.situation import Situation


class Interference(OnOffBlurEffect):
    name = POLARISATION_INTERFERENCE
    likely_shares = (0.5,)
    recipe_field = "interference"
    typical_bound_share = 0.3
    physics = "behind an analyser, light that the panel turns and light that it doesn't interfere"
    source = "Saleh and Teich, Fundamentals of Photonics 6.1; optics.polarisation"
    requires = ("unmodulated light", "diffraction")

    def is_present(self, s: Situation) -> bool:
        return bool(s.interference) and not s.picture_probe.is_dark

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        # Light from the gaps between pixels, and an uneven beam, may raise the power of either
        # wave above 1.
        how = "proved: Cauchy-Schwarz on two waves, each of all the light"
        return psf_error_bound(s, abs(s.interference) * _brightest(s), how)

    def explain(self, s: Situation) -> str:
        return f"the two beat by {abs(s.interference):.2g} of the light at most"


def _brightest(s: Situation) -> float:
    """Bound either wave's power relative to that of a uniform field."""
    pixels = sample_pixels(s)
    powers = [
        pixels.mean(pixels(field).abs().double() ** 2).real for field in s.pattern_probe.fields
    ]
    return max(1.0, *powers) * 1.2
