"""What varies over the field: the lit part of the panel, the lens' aberrations, vignetting."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.effects.electron_bounds import (
    light_norm_bound,
    max_light_seconds,
    proportional_error_bound,
)
from simulator.effects.light_effects import (
    BlurEffect,
    OnOffBlurEffect,
    light_share_bound,
    occlusion_factor,
)
from simulator.effects.psf_bounds import (
    displacement,
    full_aperture_density,
    illuminated_area_change,
    interpolation_error,
    phase_span,
    psf_change,
)
from simulator.effects.rendering_work import FIELD_ABERRATIONS, FIELD_POSITION, LEVELS, VIGNETTING
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.vignetting_bounds import vignetting_change
from simulator.formation.windows import light_extent, max_blur_distance
from simulator.planning import Bound
from simulator.situation import Situation


class FieldPosition(BlurEffect):
    """The change of the PSF over the field, as the stop's shadow moves over the panel."""

    name = FIELD_POSITION
    kind = "axis"
    recipe_field, recipe_values = "places", LEVELS.places
    physics = "the stop's shadow moves over the panel as the point moves over the field"
    source = "thesis §5.3; Trefethen, Approximation Theory and Approximation Practice 8"
    levels = ("1", "3x3", "5x5", "9x9")

    def is_caused(self, s: Situation) -> bool:
        return bool(s.camera.separation)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        area, share = illuminated_area_change(s), _CHEBYSHEV_ERROR_SHARES[level]
        how = "proved: Cauchy-Schwarz; the panel's area that isn't lit alike"
        if level:
            how = f"audited ×{share:g} of that: Chebyshev nodes in the field"
        return light_share_bound(s, (2 * math.sqrt(area) + area) * share, how)

    def likely_error(self, s: Situation, level: int) -> Bound:
        if level >= self.finest_level(s):
            return Bound()
        how = "estimated: transfer functions by the far field along the field's diagonals"
        change = occlusion_factor(s) * max_light_seconds(s) * _likely_error_rates(s)[level]
        return self.likely_light_error(s, change, how)

    def explain(self, s: Situation) -> str:
        share = illuminated_area_change(s)
        return f"from the axis to a corner {share:.2g} of the lit panel changes"


# Share of the largest change over the field that is left at each level, from audits.
_CHEBYSHEV_ERROR_SHARES = (1.0, 0.5, 0.15)

# Share of the change along the frame's diagonals that the picture's error reached at most in
# audits of random scenes, with one place and with 3 x 3. More places may do no better than to
# halve it again: the stop's shadow has edges, and what moves with an edge isn't smooth.
_LIKELY_SHARES = (0.8, 1.0)


@cached_across_exposures
def _likely_error_rates(s: Situation) -> tuple[float, ...]:
    """Estimate the L2 errors with few places in the field, electrons/s, for each number of places.

    Transfer functions are compared along a diagonal of the frame: those of the corners with that of
    the axis, and that halfway with the parabola through both corners and the axis.
    """
    plane, some = s.picture_probe.plane, s.picture_probe.sampled_frequencies
    if not len(some.ky):
        return (0.0, 0.0, 0.0)
    squared = torch.stack([squared for _, squared in s.picture_probe.powers_by_spectrum]).sum(0)
    power = some.represented_power(squared, plane)
    # The stop's shadow moves to the outermost light: of the frame, or of what is lit of it.
    sensor, lever = s.camera.sensor, as_number(s.camera.separation) / s.camera.lens.image_distance
    sides = zip(sensor.shape, light_extent(s), strict=True)
    half = (np.asarray(min(n * sensor.pitch / 2, lit) * lever) for n, lit in sides)
    corner = [float(one) for one in s.mount.to_panel_axes(*half)]
    steps = ((0.0, 0.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (0.5, 0.5))
    moves = [(y * corner[0], x * corner[1]) for y, x in steps]
    frequencies = s.mount.to_panel_axes(some.ky, some.kx)

    def norm(change: NDArray[np.complex128]) -> float:
        return math.sqrt(float((np.abs(change) ** 2 * power).sum()))

    axis_error = parabola_error = 0.0
    for axis, plus, minus, other, halfway in s.pattern_probe.transfers_behind_moved_stop(
        moves, *frequencies, max_blur_distance(s)
    ):
        axis_error = max(axis_error, *(norm(one - axis) for one in (plus, minus, other)))
        between = 0.375 * plus + 0.75 * axis - 0.125 * minus
        parabola_error = max(parabola_error, norm(halfway - between))
    parabola_error = min(parabola_error, axis_error)
    one_place, few = _LIKELY_SHARES
    return one_place * axis_error, few * parabola_error, few * parabola_error / 2


# Error of PSFs between the finest places, as a bound of the L1 norm, above which no picture is
# rendered. Those of a pattern that isn't the worst are several times better. Chosen.
_UNRESOLVED = 0.1


class FieldAberrations(BlurEffect):
    """The change of the PSF over the field, as the lens' aberrations grow off its axis."""

    name = FIELD_ABERRATIONS
    kind = "stage"
    likely_shares = (0.5, 0.2)
    recipe_field, recipe_values = "aberrated_places", LEVELS.aberrated_places
    physics = "off the axis a lens is aberrated more: coma, astigmatism, and a curved field"
    source = "Seidel's aberrations; Welford 1986, Aberrations of Optical Systems"
    levels = ("off", *(f"{n}x{n}" for n in LEVELS.aberrated_places[1:]))

    def is_caused(self, s: Situation) -> bool:
        by = s.camera.lens.field_aberrations
        return by is not None and any((by.coma, by.astigmatism, by.curvature))

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
        more = f"in the corner they span {waves:.2g} waves more than on the axis"
        return f"{more}, and displace rays by {away:.2g} pixels at most"

    def _change(self, s: Situation, level: int) -> float:
        """Bound ‖Δh‖₁ of PSFs. Where places are too few, more may be worse, which counts, too."""
        counts = LEVELS.aberrated_places[max(level, 1) : self.finest_level(s)]
        between = max((interpolation_error(s, count) for count in counts), default=0.0)
        return between if level else max(psf_change(s), between)


class Vignetting(OnOffBlurEffect):
    name = VIGNETTING
    likely_shares = (0.5,)
    recipe_field = "vignetting"
    physics = "off the axis the lens looks smaller, is farther away, and its stop cuts more"
    source = "cos⁴ law; Born and Wolf 4.8.3"

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: Young; the largest loss in the frame, and where side orders bring light from"
        change = occlusion_factor(s) * vignetting_change(s) * light_norm_bound(s)
        return proportional_error_bound(s, change, how)

    def explain(self, s: Situation) -> str:
        return f"{vignetting_change(s):.2g} of the light is lost, or gained, where it differs most"
