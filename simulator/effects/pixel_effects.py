"""What pixels make of the light on them: apertures, colour filters, crosstalk, dust and speckle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from optics.light.spectrum import Spectrum
from optics.sensor.stages import max_contrast_loss
from simulator.effects.electron_bounds import (
    PixelwiseEffect,
    all_electrons,
    can_clip,
    can_clip_at_zero,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
    peak_electrons,
    pixel_count,
    proportional_error_bound,
    relative_light_change,
    sensor_error_bound,
    sigma_by_light,
    sqrt_pixel_count,
)
from simulator.effects.light_effects import MAX_SINC_LOSS, LightChange, LightEffect
from simulator.effects.picture_norms import dust_losses
from simulator.effects.rendering_work import COLOUR_FILTERS
from simulator.effects.result_cache import cached_per_situation
from simulator.planning import Bound, OnOffEffect
from simulator.probing.picture_probe import electron_rates
from simulator.situation import Situation
from simulator.speckle import speckle_variance


class Speckle(PixelwiseEffect):
    """Light of a rough object, which varies between pixels by its contrast, whatever its mean."""

    name = "speckle"
    recipe_field = "speckle"
    operations_per_pixel = 20.0
    physics = "light that a rough object scatters in random phase interferes with itself"
    source = "Goodman 2020, Speckle Phenomena in Optics, chapters 4 to 6"

    def is_present(self, s: Situation) -> bool:
        return s.target.speckle is not None and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return relative_light_change(s, math.sqrt(speckle_variance(s)) * light_norm_bound(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound what speckle adds to the variance, v m² for a mean m.

        √(a + v m²) - √a is at most √v m. Where wells or numbers clip, the mean changes by at most
        the mean deviation of the light, √v m.
        """
        variance, norm = speckle_variance(s), light_norm_bound(s)
        width = math.sqrt(variance) * norm
        slope = sensor_error_bound(s, 1.0, "").mean
        clips = can_clip(s) or can_clip_at_zero(s.camera.sensor)
        rounding = 0.5 * s.camera.sensor.gain * sqrt_pixel_count(s)
        mean = slope * width if clips else min(slope * width, rounding)
        varied = slope**2 * (variance * peak_electrons(s) * norm) + 2 * mean**2
        return Bound(mean, varied, slope * width, how="proved: the contrast's square")

    def likely_error(self, s: Situation, level: int) -> Bound:
        """Estimate what speckle adds beside shot noise: v m² over twice √m, for a mean m."""
        bound = self.error_bound(s, level)
        beside_shot = speckle_variance(s) * math.sqrt(peak_electrons(s)) * light_norm_bound(s) / 2
        how = "estimated: the contrast's square beside shot noise"
        return replace(bound, sigma=min(bound.sigma, beside_shot), how=how) if not level else bound

    def explain(self, s: Situation) -> str:
        variance = speckle_variance(s)
        if not variance:
            return "none is left"
        width, freedom = math.sqrt(variance), 1 / variance
        return f"on a pixel the light varies by {width:.2g}: {freedom:.3g} degrees of freedom"


class PixelAperture(LightEffect, PixelwiseEffect):
    name = "pixel aperture"
    likely_shares = (0.8,)
    recipe_field = "pixel_aperture"
    operations_per_pixel = 6.0
    assumed_by_other_bounds = True
    physics = "a pixel averages the light over its area, which takes contrast from fine detail"
    source = "sinc(p fx) sinc(p fy); Goodman, Introduction to Fourier Optics"

    def estimated_error_if_omitted(self, s: Situation) -> float:
        whole = s.picture_probe.norm_bound
        return self._resolved_loss(s) / whole if whole else 0.0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        # The light's frequencies go up to the lens' limit; those that the pixels don't resolve are
        # aliased, several to one.
        finest = 2 * s.camera.lens.image_numerical_aperture / s.band.support[0]
        aliases = max(math.ceil(2 * finest * s.camera.sensor.pitch), 1.0)
        folded = MAX_SINC_LOSS * aliases * finest_octave_norm(s)
        # Light above the Nyquist frequency may exceed that octave by a factor of 2 (audits).
        change = math.hypot(self._resolved_loss(s), 2.0 * folded)
        how = "audited ×2: 1 - sinc sinc ≤ (π p k)²/6 in every frequency"
        return proportional_error_bound(s, max_light_seconds(s) * change, how)

    def explain(self, s: Situation) -> str:
        pitch = s.camera.sensor.pitch
        share = self.estimated_error(s, 0)
        return f"pixels of {pitch * 1e6:g} µm would take {share:.2g} of the sharp picture"

    def _resolved_loss(self, s: Situation) -> float:
        """Return the loss at frequencies that pixels resolve, an L2 norm in electrons/s."""
        pitch = s.camera.sensor.pitch
        return s.picture_probe.power_spectrum.filtered_norm_bound(
            lambda k: np.minimum((np.pi * k * pitch) ** 2 / 6, MAX_SINC_LOSS)
        )


class Dust(LightChange, PixelwiseEffect):
    name = "dust"
    recipe_field = "dust"
    physics = "specks on the sensor's cover glass hold back some of each pixel's cone of light"
    source = "geometric shadow and penumbra; Gu et al. 2009, doi 10.1145/1661412.1618490"
    how = "proved: shadows on the brightest pixels, and at most the deepest on all"

    def is_caused(self, s: Situation) -> bool:
        return dust_losses(s).deepest > 0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the frame's error by the light that all shadows take.

        σ changes by no more than (1 - √(1 - loss)) of that of the light, which is the loss at most.
        """
        bound, losses = super().error_bound_if_omitted(s), dust_losses(s)
        lit = losses.deepest**2 * all_electrons(s)
        by_light = sigma_by_light(
            bound, self.change(s), min(losses.norm**2 * peak_electrons(s), lit)
        )
        return replace(bound, sigma=min(math.sqrt(bound.variance * losses.pixels**0.5), by_light))

    def explain(self, s: Situation) -> str:
        losses = dust_losses(s)
        deepest = f"the deepest shadow takes {losses.deepest:.2g} of a pixel's light"
        return f"{deepest}, all of them that of {losses.total:.3g} pixels"

    def change(self, s: Situation) -> float:
        losses = dust_losses(s)
        return min(losses.norm * peak_electrons(s), losses.deepest * light_norm_bound(s))


class ColourFilters(OnOffEffect):
    name = COLOUR_FILTERS
    recipe_field = "mosaic"
    physics = "each pixel has one of a few colour filters, and counts the photons that it passes"
    source = "Bayer, US patent 3,971,065"

    def is_present(self, s: Situation) -> bool:
        return s.camera.sensor.colour is not None and not s.picture_probe.is_dark

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return _filter_difference(s)

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: Young; the largest difference of a filter's electrons from the mean pixel's"
        return proportional_error_bound(s, _filter_difference(s) * light_norm_bound(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        colour = s.camera.sensor.colour
        if colour is None or not levels[self.name]:
            return 0.0
        return float(pixel_count(s) * len(colour.channels))

    def explain(self, s: Situation) -> str:
        share = _filter_difference(s)
        return f"in this light a pixel's electrons differ by {share:.2g} of the most"


@cached_per_situation
def _filter_difference(s: Situation) -> float:
    """Return the largest difference of filters from the mean pixel, over the best channel."""
    # Cameras without colour filters that see the difference itself.
    sensors = [
        replace(s.camera.sensor, colour=None, spectral_efficiency=one)
        for one in _curve_differences(s)
    ]
    differing, largest = [replace(s.camera, sensor=one) for one in sensors], 0.0
    lights = {(part.spectrum, one.distance) for one in s.target.layers for part in one.parts}
    for spectrum, distance in lights:
        best = max(electron_rates(spectrum, s.band, s.camera, distance))
        for camera in differing if best else ():
            # The difference is interpolated between the curves' nodes: 0.1 % is added for what
            # that may miss.
            rate = electron_rates(spectrum, s.band, camera, distance)[0]
            largest = max(largest, 1.001 * rate / best)
    return largest


def _curve_differences(s: Situation) -> list[Spectrum]:
    """Return each filter's absolute difference from the mean pixel's curve."""
    colour = s.camera.sensor.colour
    if colour is None:
        return []
    ends = [edge for one in colour.efficiencies.values() for edge in (one.low, one.high)]
    beside = [edge * (1 + side * 1e-9) for edge in ends for side in (-1, 1)]
    inner = [node for one in colour.efficiencies.values() for node in one.wavelengths]
    fine = np.linspace(min(ends), max(ends), 401)
    nodes = np.unique(np.concatenate([inner, beside, fine]))
    letters, mean = "".join(colour.pattern), np.zeros_like(nodes)
    curves = {name: colour.efficiencies[name].at(nodes) for name in colour.channels}
    for name, curve in curves.items():
        mean = mean + curve * (letters.count(name) / len(letters))
    return [Spectrum(tuple(nodes), tuple(np.abs(one - mean))) for one in curves.values()]


class PixelCrosstalk(LightChange, PixelwiseEffect):
    name = "pixel crosstalk"
    recipe_field = "crosstalk"
    operations_per_pixel = 8.0
    physics = "light and charge that enter a pixel obliquely are collected by its neighbours"
    source = "Djité et al. 2012, doi 10.1109/TED.2011.2176493"
    how = "audited ×1: the loss of contrast by frequency, and at most the largest one"

    def is_caused(self, s: Situation) -> bool:
        return s.camera.sensor.crosstalk > 0

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        """Bound the loss of contrast; dark pixels beside bright ones count as for veiling glare."""
        bound, change = super().error_bound_if_omitted(s), self.change(s)
        slope = bound.variance / change if change else 0.0
        moved = slope * 2 * self._largest_loss(s) * all_electrons(s)
        sigma = min(math.hypot(bound.sigma, math.sqrt(0.1 * moved)), math.sqrt(moved))
        return replace(bound, sigma=sigma)

    def explain(self, s: Situation) -> str:
        return f"each neighbour in row and column collects {s.camera.sensor.crosstalk:.2g} of it"

    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that move.

        No pixel's change and none of the whole picture's is more than the largest loss of contrast,
        and at frequencies that pixels resolve it is the loss there; all light in the finest octave
        that they resolve counts once more, for what is folded back.
        """
        sensor, most = s.camera.sensor, self._largest_loss(s) * light_norm_bound(s)
        if sensor.colour is not None:
            # Pixels behind different filters differ, however smooth the picture is.
            return most
        resolved = s.picture_probe.power_spectrum.filtered_norm_bound(
            lambda k: max_contrast_loss(sensor.crosstalk, k, sensor.pitch)
        )
        both = math.hypot(resolved, self._largest_loss(s) * finest_octave_norm(s))
        return min(both * max_light_seconds(s) + off_plane_star_electrons(s), most)

    def _largest_loss(self, s: Situation) -> float:
        """Return the largest loss of contrast at any frequency."""
        return 1 - (1 - 4 * s.camera.sensor.crosstalk) ** 2
