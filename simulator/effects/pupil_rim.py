"""How far light from the rim of the pupil moves on the sensor if the focus moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.situation import Situation


def rim_displacement(s: Situation, shift: float) -> float:
    """Bound how far an effect's shift of focus moves light from the pupil's rim, metres.

    shift: metres by which images lie behind the sensor. Light crosses the lens no farther from the
    axis than the stop's edge, or than light from the panel's corners does.
    """
    lens, panel = s.camera.lens, s.camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape)) + math.hypot(*s.mount.shift)
    if s.camera.separation:
        half = math.inf
    radius = min(as_number(lens.stop_diameter) / 2, half)
    z = as_number(lens.image_distance)
    return radius * abs(shift) / (z + shift)


def focus_turns(
    s: Situation, wavelengths: NDArray[np.float64], k: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how axial colour turns light from the pupil's rim over a band, for the band effects.

    The radians are those by which its transfer function at frequencies k in cycles/m turns against
    that of the band's centre, (frequencies, wavelengths).
    """
    lens = s.camera.lens
    middle = lens.focus_shift(s.wavelength)
    moved = [
        math.copysign(rim_displacement(s, shift), shift) - math.copysign(
            rim_displacement(s, middle), middle)
        for shift in map(lens.focus_shift, wavelengths.tolist())
    ]  # fmt: skip
    return np.asarray(2 * np.pi * np.multiply.outer(k, np.array(moved)))
