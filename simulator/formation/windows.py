"""How far from an image its light is followed, and how large a picture has to be for that.

No light goes farther than from the outermost of the target to the outermost pixel: a PSF that is
known up to there is as good as a larger one, and what is carried around the picture's edges stays
outside the sensor all the same.
"""

from __future__ import annotations

import math

from simulator.situation import Situation

_SPARE = 32
"""Pixels more than the outermost light needs: of detail that is finer than the samples, these
ring beside it."""


def light_extent(s: Situation) -> tuple[float, float]:
    """Metres on the sensor, (y, x), from the axis to the outermost light, at any time of an
    exposure; infinite of what has no end."""
    y, x = (side + s.image_motion for side in s.picture_probe.extent)
    return y, x


def max_blur_distance(s: Situation) -> tuple[float, float]:
    """Metres on the sensor, along each of the panel's axes, from any light's image to any pixel,
    at most."""
    sensor = s.camera.sensor
    y, x = (
        side + n * sensor.pitch / 2 for side, n in zip(light_extent(s), sensor.shape, strict=True)
    )
    if s.mount.is_aligned:
        return y, x
    whole = math.hypot(y, x)
    return whole, whole


def psf_window(s: Situation, window: int) -> tuple[int, int]:
    """Sensor pixels, (rows, columns), of a PSF whose window has so many to a side, or of which
    all that can count lies within less."""
    pitch = s.camera.sensor.pitch
    # Infinity has no whole number.
    sides = (2 * math.ceil(min(one / pitch, window)) + _SPARE for one in max_blur_distance(s))
    rows, columns = (min(window, side) for side in sides)
    return rows, columns


def picture_shape(s: Situation, window: int, orders: int) -> tuple[int, int]:
    """Sensor pixels, (rows, columns), of a picture around the frame on which PSFs of such a window
    may be carried around the edges: not as far as onto the sensor.

    orders: of the panel's pixels that are looked for. Theirs begin far from any image, and need
    all of the window.
    """
    sides = (window, window) if orders else psf_window(s, window)
    lit = [math.inf if orders else one / s.camera.sensor.pitch for one in light_extent(s)]
    found = []
    for n, side, far in zip(s.camera.sensor.shape, sides, lit, strict=True):
        around = (n + side) / 2
        found.append(max(math.ceil(around + min(far, around)) + _SPARE, n, side))
    rows, columns = found
    return rows, columns
