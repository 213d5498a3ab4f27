"""The base of effects by which light lands elsewhere, as by a lens' distortion, and their bound."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    area_change,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
    relative_light_change,
    sensor_error_bound,
)
from simulator.effects.likely_errors import LightEffect
from simulator.effects.psf_bounds import mtf_bound
from simulator.effects.rendering_work import channel_count_at, picture_samples_at
from simulator.formation.distorting import DISTORTION_OPERATIONS
from simulator.formation.work import transform_operations
from simulator.planning import Bound, OnOffEffect
from simulator.situation import Situation

Array = NDArray[np.float64]


class MovedLight(OnOffEffect, LightEffect):
    """An effect by which light lands elsewhere: the picture is looked up."""

    @abstractmethod
    def change(self, s: Situation) -> float:
        """Bound the L2 norm of the electrons that the effect moves; see moved_light_bound()."""

    @abstractmethod
    def lookups(self, levels: Mapping[str, int]) -> int:
        """Return how often a plan with these levels looks up the picture of each channel."""

    def estimated_error_if_omitted(self, s: Situation) -> float:
        return 0.3 * relative_light_change(s, self.change(s))

    def error_bound_if_omitted(self, s: Situation) -> Bound:
        how = "proved: the gradient of coarse detail along the way, and all fine detail; area"
        return sensor_error_bound(s, self.change(s), how)

    def added_operations(self, s: Situation, levels: Mapping[str, int]) -> float:
        lookups = self.lookups(levels) if levels[self.name] else 0
        if not lookups:
            return 0.0
        shape = picture_samples_at(s, levels)
        one = 6 * transform_operations(*shape) + DISTORTION_OPERATIONS * math.prod(shape)
        return one * lookups * channel_count_at(s, levels) * max(1, len(s.panel_content.pictures))


def moved_light_bound(
    s: Situation, phase: Callable[[Array, float], Array], brighter: float
) -> float:
    """Bound the L2 norm of the electrons that an effect moves to other places of the sensor.

    A picture m and its moved one differ by the change of brightness, and by m at places that are
    apart. Of detail coarser than any limit the latter is at most the way times its gradient, and of
    finer detail at most both norms. With the best limit, both together are at most √2 times the
    norm of the lesser of the two at each frequency.

    phase: returns the way times numbers in radians per metre, each at most the given one.
    brighter: largest relative change of brightness.
    """
    gain, whole = math.sqrt(area_change(s)), light_norm_bound(s)

    def lesser(k: Array) -> Array:
        along = phase(2 * np.pi * k * gain, 1 + gain)
        return np.asarray(math.sqrt(2) * along * mtf_bound(s, k))

    power, pitch = s.picture_probe.power_spectrum, s.camera.sensor.pitch
    folded = float(phase(np.array([2 * np.pi / pitch]), 2.0)[0]) * finest_octave_norm(s)
    resolved = math.hypot(power.filtered_norm_bound(lesser), folded) * max_light_seconds(s)
    if s.camera.lens.relative_illumination:
        brighter = 0.0
    return min(resolved + 2 * off_plane_star_electrons(s), (1 + gain) * whole) + brighter * whole
