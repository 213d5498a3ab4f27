"""Where a camera's image lies, beside its sensor: by wavelength and time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from optics.camera import Camera, Lens
from optics.camera.camera import wavelengths_between
from optics.camera.pupil import vergence_error
from optics.light.bands import Band
from optics.validation import as_number

# Waves of path at the stop's edge by which two foci may differ to be probed as one, and below
# which the outermost ones are no different from none. Chosen: .05 change a PSF's peak by 1 %, by
# Maréchal.
_SAME_FOCUS, _NO_SHIFT = 0.05, 1e-4


# Waves of path at the stop's edge to which a drift of focus is rounded. Chosen: of no effect.
_DRIFT_STEP = 1e-6


def defocused(camera: Camera, shift: float) -> Camera:
    """Return the camera whose lens forms its image `shift` metres behind the sensor."""
    return replace(camera, lens=camera.lens.defocused(shift)) if shift else camera


def focus_range(lens: Lens, low: float, high: float) -> tuple[float, float]:
    """Return the outermost foci of a range of wavelengths, metres behind the sensor."""
    found = [lens.focus_shift(one) for one in wavelengths_between(lens.axial_colour, low, high)]
    return min(found), max(found)


def drifted_focus(camera: Camera, time: float, wavelength: float) -> float:
    """Return the drift of focus at a time in seconds, metres behind the sensor.

    It is rounded far below what changes a PSF: a camera that has warmed up shows the same picture.
    """
    if not camera.focus_drift:
        return 0.0
    step = _DRIFT_STEP * _depth(camera.lens, wavelength)
    return round(camera.focus_at(time) / step) * step


def focus_shifts(
    lens: Lens, band: Band, distances: Iterable[float], drift: float = 0.0
) -> tuple[float, ...]:
    """Return the foci of a band's light for which PSFs are probed, metres behind the sensor.

    They are the focus without any shift, that of the band's centre, the outermost two and those
    between them in which points at `distances` from the lens are sharp. drift: metres by which all
    light may be out of focus, too.
    """
    if not (lens.axial_colour or drift):
        return (0.0,)
    low, high = focus_range(lens, *band.support)
    low, high = low + min(drift, 0.0), high + max(drift, 0.0)
    z, sharp = as_number(lens.image_distance), []
    for distance in distances:
        # So far before the sensor does a thin lens form the image of a point.
        vergence = as_number(vergence_error(lens, distance))
        sharp.append(-(z**2 * vergence / (1 - z * vergence)) if z * vergence < 1 else -math.inf)
    between = (one for one in sharp if low < one < high)
    middle = lens.focus_shift(band.centre)
    depth = _depth(lens, band.support[0])
    ends = [one for one in (low, high) if abs(one) > _NO_SHIFT * depth]
    if len(ends) == 2 and low * high > 0 and high - low < _SAME_FOCUS * depth:
        ends = [max(ends, key=abs)]
    return _with_others([0.0, *ends], (middle, middle + drift, *between), depth)


def leaked_focus_shifts(
    lens: Lens, band: Band, distances: Iterable[float], drift: float = 0.0
) -> tuple[float, ...]:
    """Return the outermost foci of light that leaks through a filter, beyond its band's."""
    if not (lens.axial_colour and band.leak):
        return ()
    known = focus_shifts(lens, band, distances, drift)
    low, high = focus_range(lens, *band.leak_range)
    ends = low + min(drift, 0.0), high + max(drift, 0.0)
    return _with_others(list(known), ends, _depth(lens, band.support[0]))[len(known) :]


def _depth(lens: Lens, wavelength: float) -> float:
    """Return the metres of focus by which a wave's path changes by a wavelength at the edge."""
    z, radius = as_number(lens.image_distance), as_number(lens.stop_diameter) / 2
    return 2 * wavelength * (z / radius) ** 2


def _with_others(known: list[float], wanted: Iterable[float], depth: float) -> tuple[float, ...]:
    """Return known foci, and those of the wanted ones that a PSF tells from all others."""
    for one in wanted:
        if all(abs(one - other) > _SAME_FOCUS * depth for other in known):
            known.append(one)
    return tuple(known)
