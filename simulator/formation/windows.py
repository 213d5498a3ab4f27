"""The windows of PSFs, and the size that a picture needs for them.

No light goes farther than from the outermost point of the target to the outermost pixel. A PSF up
to that distance is as good as a larger one. Light that is carried periodically around the picture's
edges doesn't reach the sensor.
"""

from __future__ import annotations

import math

from simulator.situation import Situation

_SPARE = 32
"""Pixels beyond the outermost light: detail finer than the samples causes ringing beside it."""

ORDER_FADE_PIXELS = 4.0
"""Sensor pixels over which one diffraction order of the panel fades into the next."""


def light_extent(s: Situation) -> tuple[float, float]:
    """Return how far from the axis a scene's rendered light reaches, (y, x) metres on the sensor.

    The result holds for any time of the exposure. It is infinite for endless light.
    """
    y, x = (side + s.image_motion for side in s.picture_probe.extent)
    return y, x


def max_blur_distance(s: Situation) -> tuple[float, float]:
    """Return the largest distance of rendered blur: from any light's image to any pixel.

    The distances (y, x) are in metres on the sensor, along the panel's axes.
    """
    sensor = s.camera.sensor
    y, x = (
        side + n * sensor.pitch / 2 for side, n in zip(light_extent(s), sensor.shape, strict=True)
    )
    if s.mount.is_aligned:
        return y, x
    whole = math.hypot(y, x)
    return whole, whole


def psf_window(s: Situation, window: int) -> tuple[int, int]:
    """Return the window of a rendered PSF in sensor pixels, (rows, columns).

    window: its side; the result is smaller where no light goes so far.
    """
    pitch = s.camera.sensor.pitch
    # min() comes first, as an infinite distance has no ceil().
    sides = (2 * math.ceil(min(one / pitch, window)) + _SPARE for one in max_blur_distance(s))
    rows, columns = (min(window, side) for side in sides)
    return rows, columns


def picture_shape(s: Situation, window: int, orders: int) -> tuple[int, int]:
    """Return the size of a rendered picture with its margin, (rows, columns) of sensor pixels.

    The margin is so wide that light carried periodically around the edges doesn't reach the sensor.
    orders: side orders of the panel that are rendered. Their light is far from any image, and needs
    the whole window.
    """
    sides = (window, window) if orders else psf_window(s, window)
    lit = [math.inf if orders else one / s.camera.sensor.pitch for one in light_extent(s)]
    found = []
    for n, side, far in zip(s.camera.sensor.shape, sides, lit, strict=True):
        around = (n + side) / 2
        found.append(max(math.ceil(around + min(far, around)) + _SPARE, n, side))
    rows, columns = found
    return rows, columns
