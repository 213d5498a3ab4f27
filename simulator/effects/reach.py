"""How far from its image a point's light is followed."""

from __future__ import annotations

import math

from optics.validation import as_number
from simulator.effects.blur_effects import BlurEffect, occlusion_factor
from simulator.effects.electron_bounds import (
    light_norm_bound,
    sensor_error_bound,
    sharp_norm_bound,
    total_electrons,
)
from simulator.effects.psf_bounds import blur_sensitivity, psf_energy_bound
from simulator.effects.rendering_work import PSF_REACH, PSF_WINDOWS, first_level_reaching
from simulator.effects.spectra import leak_share
from simulator.formation.windows import max_blur_distance
from simulator.planning import Bound
from simulator.situation import Situation

_MARGIN = 1.5
"""Audited: with some of the panel's effects off, or all on, more light may go far."""

_FADING = 6.0
"""Sensor pixels beyond a period, over which the next order comes in."""


class PSFReach(BlurEffect):
    name = PSF_REACH
    kind = "stage"
    recipe_field, recipe_values = "window", PSF_WINDOWS
    physics = "a PSF's skirts reach far, and hold little light at a time"
    source = "far field of the shown pattern"
    levels = tuple(f"{n} px" for n in PSF_WINDOWS)

    def finest_level(self, s: Situation) -> int:
        """All of the panel's middle order, at the longest wavelength, that can fall on a pixel."""
        longest = max(s.band.support[1], s.band.leak_range[1] if s.band.leak else 0.0)
        period = longest * as_number(s.camera.ray_matrix_b) / s.camera.panel.pitch
        far = min(period, 2 * max(max_blur_distance(s)))
        return first_level_reaching(PSF_WINDOWS, far / s.camera.sensor.pitch + _FADING)

    def estimated_error(self, s: Situation, level: int) -> float:
        return 0.0 if level >= self.finest_level(s) else 0.5 * _beyond(s, level)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        how = f"audited ×{_MARGIN:g}: Young; light beyond, in the far field"
        missing = sum(
            share * math.sqrt(psf_energy_bound(s, _half(s, level, longest)))
            for share, longest in _waves(s)
        ) * total_electrons(s)
        change = min(
            _MARGIN * _beyond(s, level) * sharp_norm_bound(s), missing, light_norm_bound(s)
        )
        return sensor_error_bound(s, occlusion_factor(s) * blur_sensitivity(s) * change, how)

    def explain(self, s: Situation) -> str:
        half = PSF_WINDOWS[0] / 2
        return f"{_beyond(s, 0):.2g} of a point's light falls more than {half:.0f} pixels from it"


def _waves(s: Situation) -> list[tuple[float, float]]:
    """Shares of the light, at most, and the longest wavelength of each, which is spread the
    farthest: of the band, and of what leaks beside it."""
    leak = [(leak_share(s), s.band.leak_range[1])] if s.band.leak else []
    return [(1.0, s.band.support[1]), *leak]


def _half(s: Situation, level: int, longest: float) -> float:
    """Metres from a point's image to the sides of the window, as if light of a wavelength were of
    the middle one."""
    half = (PSF_WINDOWS[level] / 2 - 1) * s.camera.sensor.pitch
    turned = abs(math.cos(2 * s.mount.rotation)) < 1 - 1e-9
    return half * s.wavelength / longest / (math.sqrt(2) if turned else 1.0)


def _beyond(s: Situation, level: int) -> float:
    found = (
        share * s.pattern_probe.share_beyond(_half(s, level, longest))
        for share, longest in _waves(s)
    )
    return min(sum(found), 1.0)
