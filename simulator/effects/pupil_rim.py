"""How far a lens' colours, and shifts of its focus, move light on the sensor at most."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from optics.validation import as_number
from simulator.situation import Situation


def rim_displacement(s: Situation, shift: float) -> float:
    """Bound how far a shift of focus moves light from the pupil's rim on the sensor, metres.

    Light crosses the lens no farther from the axis than the stop's edge, or than light from the
    panel's corners does.
    shift: metres by which images lie behind the sensor.
    """
    lens, panel = s.camera.lens, s.camera.panel
    half = math.hypot(*(n * panel.pitch / 2 for n in panel.shape)) + math.hypot(*s.mount.shift)
    if s.camera.separation:
        half = math.inf
    radius = min(as_number(lens.stop_diameter) / 2, half)
    z = as_number(lens.image_distance)
    return radius * abs(shift) / (z + shift)


def colour_turns(
    s: Situation, wavelengths: NDArray[np.float64], k: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Return by how many radians a lens' colours turn light against that of the band's centre.

    They are those of a transfer function at frequencies k in cycles/m: of light from the pupil's
    rim by axial colour, and of light in the frame's corners by lateral colour; each (frequencies,
    wavelengths).
    """
    lens, sensor = s.camera.lens, s.camera.sensor
    ways = []
    if lens.axial_colour:
        shifts = [lens.focus_shift(one) for one in (s.wavelength, *wavelengths.tolist())]
        ways.append([math.copysign(rim_displacement(s, one), one) for one in shifts])
    if lens.lateral_colour:
        corner = math.hypot(*sensor.shape) * sensor.pitch / 2
        scales = [lens.image_scale(one) for one in (s.wavelength, *wavelengths.tolist())]
        ways.append([corner * one for one in scales])
    return [
        np.asarray(2 * np.pi * np.multiply.outer(k, np.array(way[1:]) - way[0])) for way in ways
    ]
