"""Shot noise: the number of photons is random."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

from optics.camera import Sensor
from optics.sensor.stages import FEW_ELECTRONS
from simulator.effects.electron_bounds import (
    MAX_PIXEL_SIGMAS,
    can_clip_at_zero,
    clipping_onset,
    dark_current_electrons,
    electron_norm_bound,
    full_well_count,
    peak_electrons,
    pixel_count,
    shot_noise_norm,
    sqrt_pixel_count,
)
from simulator.planning import Bound, Effect
from simulator.situation import Situation


class ShotNoise(Effect):
    """Shot noise, as Poisson's distribution or as a normal one that approximates it.

    operations_by_level: per pixel. A normal number takes as long as 20 operations of a Fourier
    transform, one of Poisson's distribution as long as 180.
    """

    operations_by_level: ClassVar[tuple[float, ...]] = (0.0, 20.0, 24.0, 180.0)
    name = "shot noise"
    kind = "stage"
    recipe_field, recipe_values = "shot", ("none", "Gaussian", "skewed", "Poisson")
    physics = "photons arrive by chance: their number's variance is its mean"
    source = "Poisson; EMVA 1288 release 4, section 2.2; Edgeworth's series for the normal one"
    is_per_frame = True
    levels = ("off", "Gaussian", "skewed Gaussian", "Poisson")

    def is_present(self, s: Situation) -> bool:
        return electron_norm_bound(s) > 0

    def estimated_error(self, s: Situation, level: int) -> float:
        return self.error_bound(s, level).shape

    def error_bound_below_finest(self, s: Situation, level: int) -> Bound:
        if level and peak_electrons(s) < FEW_ELECTRONS:
            return Bound()
        bounds = self._bound_without_noise, self._gaussian_bound, self._skewed_gaussian_bound
        return bounds[level](s)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        return self.operations_by_level[levels[self.name]] * pixel_count(s)

    def explain(self, s: Situation) -> str:
        most, least = peak_electrons(s), dark_current_electrons(s)
        few = "enough for a normal one"
        if least < FEW_ELECTRONS:
            few = "too few for a normal distribution"
        brightest = f"holds {most:.3g} electrons and varies by {math.sqrt(most):.2g}"
        return f"the brightest pixel {brightest}; the darkest may hold {least:.2g}, {few}"

    def _bound_without_noise(self, s: Situation) -> Bound:
        """Bound the frame's error if no noise is drawn."""
        sensor, root = s.camera.sensor, sqrt_pixel_count(s)
        step = sensor.gain
        kinked = 0.5 * math.sqrt(peak_electrons(s) * full_well_count(s))
        if can_clip_at_zero(sensor):
            kinked += 0.5 * (sensor.read_noise + MAX_PIXEL_SIGMAS * sensor.dsnu) * root
        floor = 1.5 * sensor.read_noise**2 + step**2
        spread = shot_noise_norm(s)
        normal = self._gaussian_bound(s)
        mean, sigma = step * root + kinked, spread + (step + sensor.read_noise) * root
        variance = electron_norm_bound(s) + step * spread + floor * root
        found = max(mean, normal.mean), max(variance, normal.variance), max(sigma, normal.sigma)
        return Bound(*found, 1.0, "proved: the number's variance is its mean")

    def _gaussian_bound(self, s: Situation) -> Bound:
        """Bound the frame's error if a normal distribution replaces Poisson's.

        Means and variances agree except where full wells and rounding cut the distributions. The
        cumulative distributions differ by 0.068 / √electrons: 1/(6 √(2π)) from Edgeworth's first
        term, and 2 % more for the following terms, from ten electrons on.
        """
        sensor, count = s.camera.sensor, sqrt_pixel_count(s)
        step = sensor.gain / math.sqrt(FEW_ELECTRONS)
        most = math.sqrt(peak_electrons(s))
        mean = 0.15 * step + 1e-3
        variance = sensor.gain + 0.2 * sensor.gain * step + 0.05
        wells = math.sqrt(full_well_count(s))
        knee = min(most, math.sqrt(clipping_onset(sensor) + 50 * most)) if wells else 0.0
        sigma = _max_sigma_change(variance, sensor) * count + math.sqrt(0.6 * knee) * wells
        mean, variance = mean * count + 0.2 * wells, variance * count + 0.6 * knee * wells
        how = "audited ×1.5: first term of Edgeworth's series"
        return Bound(mean, variance, sigma, 0.068 / math.sqrt(FEW_ELECTRONS), how)

    def _skewed_gaussian_bound(self, s: Situation) -> Bound:
        """Bound the frame's error if a skewed normal distribution replaces Poisson's.

        The skewed one has the right third and fourth moments. The cumulative distributions differ
        by 3e-4 at ten electrons, and by less for more electrons.
        """
        sensor, count, distance = s.camera.sensor, sqrt_pixel_count(s), 3e-4
        mean = distance * (4 + sensor.gain)
        variance = distance * (8 + 3 * sensor.gain**2)
        sigma = _max_sigma_change(variance, sensor)
        how = "audited ×1.1: against Poisson's distribution, from ten electrons on"
        return Bound(mean * count, variance * count, sigma * count, distance, how)


def _max_sigma_change(variance: float, sensor: Sensor) -> float:
    """Bound the error of σ from an error of the variance, which counts most where that is least."""
    if sensor.gain**2 > FEW_ELECTRONS:
        # A step of the converter may hide all of the variance.
        return math.sqrt(variance)
    return variance / math.sqrt(FEW_ELECTRONS)
