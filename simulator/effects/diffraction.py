"""Waves instead of the rays of the same wavefront, and how far from a point's image they reach."""

from __future__ import annotations

import itertools
import math

import numpy as np
import torch
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.effects.electron_bounds import (
    light_norm_bound,
    sensor_error_bound,
    sharp_norm_bound,
    total_electrons,
)
from simulator.effects.light_effects import (
    FAR,
    BlurEffect,
    OnOffBlurEffect,
    occlusion_factor,
    transfer_error_bound,
)
from simulator.effects.psf_bounds import displacement, psf_change, psf_energy_bound
from simulator.effects.rendering_work import DIFFRACTION, LEVELS, PSF_REACH, first_level_reaching
from simulator.effects.result_cache import cached_across_exposures
from simulator.effects.spectra import leak_share
from simulator.effects.vignetting_bounds import blur_sensitivity
from simulator.formation.windows import max_blur_distance
from simulator.planning import Bound
from simulator.situation import Situation

# Factor of error bounds, from audits: with some of the panel's imperfections off, or all on,
# light may change more, and more of it may fall outside a PSF's window.
_MARGIN = 1.5

# Lines of the panel along each axis from which the mean angle of rays is computed. Chosen.
_LINES = 128


class Diffraction(OnOffBlurEffect):
    """Diffraction of the light; without it, a PSF is the geometric blur of the wavefront."""

    name = DIFFRACTION
    likely_shares = (0.6,)
    recipe_field = "diffraction"
    typical_bound_share = 0.3
    assumed_by_other_bounds = True
    physics = "light is a wave: it spreads behind every edge and interferes where rays cross"
    source = "Goodman, Introduction to Fourier Optics 6.4"
    levels = ("rays", "waves")

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        turn = _mean_ray_displacement(s) + s.camera.sensor.pitch + displacement(s)
        aberrated = psf_change(s)
        waves = s.pattern_probe.transfer_bounds

        def gain(k: NDArray[np.float64]) -> NDArray[np.float64]:
            rays = np.minimum(2 * math.pi * k * turn, 2.0)
            apart = waves.loss_bound(k.ravel()).reshape(k.shape) + rays + aberrated
            found = np.minimum(_MARGIN * apart, 2.0)
            return np.where(k > 0, found, s.pattern_probe.side_order_share)

        how = "|1 - H| of the waves, and of the rays by how far they turn"
        return transfer_error_bound(s, gain, f"audited ×{_MARGIN:g}: {how}")

    def explain(self, s: Situation) -> str:
        spot = s.wavelength * s.camera.lens.image_distance / s.camera.lens.stop_diameter
        pitch = s.camera.sensor.pitch
        return f"a diffraction spot is {spot * 1e6:.2g} µm wide and a pixel {pitch * 1e6:.3g} µm"


class PSFReach(BlurEffect):
    """The light of a PSF outside its window."""

    name = PSF_REACH
    likely_shares = (0.7,)
    noise_change = FAR
    kind = "stage"
    recipe_field, recipe_values = "window", LEVELS.windows
    physics = "a PSF's skirts reach far, and hold little light at a time"
    source = "far field of the shown pattern"
    levels = tuple(f"{n} px" for n in LEVELS.windows)

    def finest_level(self, s: Situation) -> int:
        """Return the level whose window holds all zeroth-order light that can reach a pixel."""
        # The zeroth order is widest at the longest wavelength.
        period = s.band.whole_support[1] * as_number(s.camera.ray_matrix_b) / s.camera.panel.pitch
        far = min(period, 2 * max(max_blur_distance(s)))
        # The next order fades in over 6 pixels beyond a period.
        return first_level_reaching(LEVELS.windows, far / s.camera.sensor.pitch + 6.0)

    def estimated_error(self, s: Situation, level: int) -> float:
        return 0.0 if level >= self.finest_level(s) else 0.5 * _beyond(s, level)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        how = f"audited ×{_MARGIN:g}: Young; light beyond, in the far field"
        missing = sum(
            share * math.sqrt(psf_energy_bound(s, _window_half_side(s, level, longest)))
            for share, longest in _longest_waves(s)
        ) * total_electrons(s)
        outside = _MARGIN * _beyond(s, level)
        change = min(outside * sharp_norm_bound(s), missing, light_norm_bound(s))
        return sensor_error_bound(s, occlusion_factor(s) * blur_sensitivity(s) * change, how)

    def explain(self, s: Situation) -> str:
        half = LEVELS.windows[0] / 2
        return f"{_beyond(s, 0):.2g} of a point's light falls more than {half:.0f} pixels from it"


@cached_across_exposures
def _mean_ray_displacement(s: Situation) -> float:
    """Return the largest mean distance on the sensor from a point's image to its rays, metres."""
    probe, worst = s.pattern_probe, 0.0
    straight = torch.ones(probe.panel.shape, dtype=torch.complex64)
    for field, wave in itertools.product((*probe.fields, straight), probe.lens_phases):
        turns = [_mean_step(field, wave, probe.aperture_share, axis) for axis in (0, 1)]
        worst = max(worst, math.hypot(*turns) * 1.5)
    lever = as_number(probe.camera.ray_matrix_b) * probe.wavelength
    return worst / (2 * math.pi * probe.panel.pitch) * lever


def _mean_step(field: torch.Tensor, wave: torch.Tensor, opened: torch.Tensor, axis: int) -> float:
    """Return the mean phase step between neighbouring pixels along an axis, radians."""
    every = max(1, field.shape[1 - axis] // _LINES)
    lines = (slice(None), slice(None, None, every))[:: 1 if axis == 0 else -1]
    field, wave, opened = field[lines], wave[lines], opened[lines]
    n = field.shape[axis] - 1
    step = torch.angle(field.narrow(axis, 1, n) * field.narrow(axis, 0, n).conj())
    both = opened.narrow(axis, 1, n) * opened.narrow(axis, 0, n)
    turn = (step.double() + wave.diff(dim=axis)).abs()
    return float((turn * both).sum() / both.sum().clamp(min=1e-9))


def _longest_waves(s: Situation) -> list[tuple[float, float]]:
    """Return (largest share of light, longest wavelength) of band and leak."""
    leak = [(leak_share(s), s.band.leak_range[1])] if s.band.leak else []
    return [(1.0, s.band.support[1]), *leak]


def _window_half_side(s: Situation, level: int, longest: float) -> float:
    """Return the metres from a PSF window's centre to its side, at the band's centre.

    They are scaled from the longest wavelength to the centre. Light that a shifted panel or field
    aberrations move out of the window is beyond it.
    """
    half = (LEVELS.windows[level] / 2 - 1) * s.camera.sensor.pitch
    half = max(half - s.image_shift - displacement(s), 0.0)
    turned = abs(math.cos(2 * s.mount.rotation)) < 1 - 1e-9
    return half * s.wavelength / longest / (math.sqrt(2) if turned else 1.0)


def _beyond(s: Situation, level: int) -> float:
    """Return the share of a point's light that a level's window cuts off."""
    found = (
        share * s.pattern_probe.share_beyond(_window_half_side(s, level, longest))
        for share, longest in _longest_waves(s)
    )
    return min(sum(found), 1.0)
