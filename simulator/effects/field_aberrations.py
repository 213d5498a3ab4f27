"""Coma, astigmatism and field curvature off the lens' axis."""

from __future__ import annotations

import math

from simulator.effects.blur_effects import BlurEffect, light_share_bound
from simulator.effects.field_waves import (
    displacement,
    interpolation_error,
    phase_span,
    psf_change,
)
from simulator.effects.psf_bounds import full_aperture_density
from simulator.effects.rendering_work import FIELD_ABERRATIONS, LEVELS
from simulator.planning import Bound
from simulator.situation import Situation

_UNRESOLVED = 0.1
"""Error of PSFs between the finest places, as a bound of the L1 norm, above which no picture is
rendered. Those of a pattern that isn't the worst are several times better. Chosen."""


class FieldAberrations(BlurEffect):
    """The change of the PSF over the field, as the lens' aberrations grow off its axis."""

    name = FIELD_ABERRATIONS
    kind = "stage"
    likely_shares = (0.5, 0.2)
    recipe_field, recipe_values = "aberrated_places", LEVELS.aberrated_places
    physics = "off the axis a lens is aberrated more: coma, astigmatism, and a curved field"
    source = "Seidel's aberrations; Welford 1986, Aberrations of Optical Systems"
    levels = ("off", *(f"{n}x{n}" for n in LEVELS.aberrated_places[1:]))

    def is_present(self, s: Situation) -> bool:
        by = s.camera.lens.field_aberrations
        if by is None or s.picture_probe.is_dark:
            return False
        return any((by.coma, by.astigmatism, by.curvature))

    def finest_level(self, s: Situation) -> int:
        """Return the level whose places interpolate PSFs as well as numbers are computed."""
        last = len(self.levels) - 1
        for level in range(1, last):
            if interpolation_error(s, LEVELS.aberrated_places[level]) <= s.numerics:
                return level
        missed = interpolation_error(s, LEVELS.aberrated_places[last])
        if missed > _UNRESOLVED:
            raise ValueError(
                f"field_aberrations span {phase_span(s) / 2 / math.pi:.3g} waves in the frame's "
                f"corner, more than {self.levels[last]} PSFs resolve; give smaller coefficients, "
                "or the image height that they belong to"
            )
        return last

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        where = "between the outermost places" if level else "at corners and sides"
        how = f"proved: trace norm of the waves' difference, {where}"
        change = self._change(s, level)
        # No point of Δh is brighter than the largest part of the change, were all of it in phase.
        shorter = s.wavelength / s.band.support[0]
        density = change / 2 * shorter**2 * full_aperture_density(s)
        return light_share_bound(s, change, how, density)

    def explain(self, s: Situation) -> str:
        waves, away = phase_span(s) / 2 / math.pi, displacement(s) / s.camera.sensor.pitch
        return (
            f"in the corner they span {waves:.2g} waves more than on the axis, and displace rays "
            f"by {away:.2g} pixels at most"
        )

    def _change(self, s: Situation, level: int) -> float:
        """Bound ‖Δh‖₁ of PSFs. Where places are too few, more may be worse, which counts, too."""
        counts = LEVELS.aberrated_places[max(level, 1) : self.finest_level(s)]
        between = max((interpolation_error(s, count) for count in counts), default=0.0)
        return between if level else max(psf_change(s), between)
