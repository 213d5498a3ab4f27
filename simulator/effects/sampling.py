"""Samples of pictures and of their blurred light in each pixel."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import max_light_seconds
from simulator.effects.light_effects import BlurEffect, occlusion_factor, transfer_error_bound
from simulator.effects.psf_bounds import has_occlusion, mtf_bound
from simulator.effects.rendering_work import LEVELS, LIGHT_SAMPLING, first_level_reaching
from simulator.effects.result_cache import cached_across_exposures
from simulator.planning import Bound
from simulator.probing.sampled_frequencies import Gain
from simulator.situation import Situation

Array = NDArray[np.float64]

# Factors of bound and estimate, from audits: of detail finer than pixels, only the finest that
# pixels resolve is known; and where edges lie at random, aliases may be in phase.
_MARGIN, _LIKELY_FACTOR = 2.0, 3.0

# Cycles per pixel from which on detail is taken to go on beyond what pixels resolve. Chosen.
_FINE_DETAIL = 0.4


class LightSampling(BlurEffect):
    """The samples of pictures before they are blurred, and of the blurred light.

    From some level on, the light has enough samples to resolve its finest fringe, and only pictures
    have more. With fewer, detail that is finer is left out: pixels would show it as coarser detail.
    """

    name = LIGHT_SAMPLING
    kind = "stage"
    recipe_field, recipe_values = "picture_samples_per_pixel", LEVELS.samples
    typical_bound_share = 0.5
    physics = "detail of the object that is finer than the samples looks like coarser detail"
    source = "Shannon; Gaskill, Linear Systems"
    levels = tuple(str(n) for n in LEVELS.samples)

    def finest_level(self, s: Situation) -> int:
        resolving = first_level_reaching(LEVELS.samples, s.coarsest_sampling)
        if _has_exact_spectra(s):
            return resolving
        # Chosen: at most four along a pixel, and 2^27 of a whole picture.
        pixels = math.prod(n + LEVELS.windows[0] for n in s.camera.sensor.shape)
        few = (n <= 4 and n * n * pixels <= 2**27 for n in LEVELS.samples)
        return max(sum(few) - 1, resolving)

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        pitch = s.camera.sensor.pitch
        aliases = _alias_power(s, level, lambda cycles: mtf_bound(s, cycles / pitch) ** 2)
        how = f"audited ×{_MARGIN:g}: what a picture's edges fold back, as blurred"
        return transfer_error_bound(s, lambda k: _MARGIN * np.sqrt(aliases(k * pitch)), how)

    def likely_error(self, s: Situation, level: int) -> Bound:
        if level >= self.finest_level(s):
            return Bound()
        rate = _likely_error_rate(s, level)
        change = _LIKELY_FACTOR * occlusion_factor(s) * max_light_seconds(s) * rate
        how = f"estimated ×{_LIKELY_FACTOR:g}: what edges fold back, blurred as by the far field"
        return self.likely_light_error(s, change, how)

    def explain(self, s: Situation) -> str:
        if _has_exact_spectra(s):
            return f"the finest fringe of the light takes {s.coarsest_sampling} samples in a pixel"
        falls = "sharp edges" if _spectral_decay(s) == 1 else "no edge sharper than its own pixels"
        return f"the picture has {falls}, and the light {s.coarsest_sampling} samples in a pixel"


@cached_across_exposures
def _likely_error_rate(s: Situation, level: int) -> float:
    """Estimate the L2 error of aliases at a level, electrons/s."""
    power, pitch = s.picture_probe.power_spectrum, s.camera.sensor.pitch
    transfers = s.pattern_probe.transfer_bounds
    aliases = _alias_power(s, level, lambda cycles: transfers.mean_square_near(cycles / pitch))
    middles = (power.low + power.high) / 2 * pitch
    return math.sqrt(float((power.power * aliases(middles)).sum()))


def _alias_power(s: Situation, level: int, contrast: Gain) -> Gain:
    """Return the power of aliases over that of a picture, by cycles per pixel.

    Where a picture has edges, its spectrum falls with 1/k, and the mean over a sample's cell falls
    with another 1/k: aliases from beyond the samples' Nyquist frequency add (k / (n - k))² of the
    spectrum at k cycles per pixel, for n samples. Between the Nyquist frequencies of pixels and
    samples, the spectrum begins as just below the former, and falls further.

    If light needs more samples to resolve its finest fringe, the pixels fold back what these
    samples leave out: as much of the picture's spectrum there, and averaged over pixels instead of
    cells. Aliases of the picture are blurred as the frequency at which they appear, those of the
    light as the one from which they come.

    contrast: square of the transfer function, by cycles per pixel.
    """
    samples = LEVELS.samples[level]
    exact, finest = _has_exact_spectra(s), s.coarsest_sampling / 2
    # A formula's picture needs no samples, and may be a point, whose spectrum doesn't fall.
    drawn, falls = (0.0, 0) if exact else (1.0, min(_spectral_decay(s), 2))

    def aliases(cycles: Array) -> Array:
        beyond = samples - cycles
        left_out = (samples < s.coarsest_sampling) & (beyond <= finest)
        blurred = drawn * contrast(cycles) + np.where(left_out, contrast(beyond), 0.0)
        return blurred * (cycles / beyond) ** (2 * (1 + falls))

    fine = np.linspace(0.5, samples / 2, 65)
    of_finer = (aliases(fine) * (np.sinc(fine) * (0.5 / fine) ** falls) ** 2).max()

    def power(cycles: Array) -> Array:
        known = aliases(np.minimum(cycles, samples / 2))
        return known + np.where(cycles >= _FINE_DETAIL, of_finer, 0.0)

    return power


def _spectral_decay(s: Situation) -> int:
    """Return the slowest decay of spectra, a power of the frequency, at the pixels' Nyquist one."""
    found, finest = [], 0.5 / s.camera.sensor.pitch
    for layer in s.target.layers:
        scale = s.camera.magnification(layer.distance)
        found += [part.picture.spectral_decay(scale, finest) for part in layer.parts]
        found += [layer.cover.spectral_decay(scale, finest)] if layer.cover is not None else []
    return min(found)


def _has_exact_spectra(s: Situation) -> bool:
    """Whether pictures need no samples, because formulas give their spectra."""
    parts = [part.picture for layer in s.target.layers for part in layer.parts]
    return all(one.has_exact_spectrum for one in parts) and not has_occlusion(s)
