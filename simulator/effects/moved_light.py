"""Bound what changes in a picture if its light lands elsewhere, as by a lens' distortion."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from simulator.effects.electron_bounds import (
    area_change,
    finest_octave_norm,
    light_norm_bound,
    max_light_seconds,
    off_plane_star_electrons,
)
from simulator.effects.psf_bounds import mtf_bound
from simulator.situation import Situation

Array = NDArray[np.float64]


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
