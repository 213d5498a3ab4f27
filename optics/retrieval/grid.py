"""The grid in the focal plane on which a PSF is designed and judged."""

from __future__ import annotations

import math

import scipy.fft

from optics.camera import Camera
from optics.plane import Plane
from optics.stop_shadow import panel_to_focus_distance
from optics.validation import require_positive, rounded_down

OVERSAMPLING = 2
"""The design grid is twice finer than the pupil's Nyquist rate: on a coarser one speckle
hides between the samples."""

_SMALLEST_WINDOW = 128
_MARGIN = 1.2
"""Side of the window over that of the target."""

_WINDOW_STEP = 32
_DIVISIBLE = 16
"""A length that many superpixel sizes divide."""


def far_field_length(camera: Camera, oversampling: int = OVERSAMPLING) -> int:
    """Samples of the far field that the panel can steer light to, along either axis.

    One over it is the step of the Fourier transform from pixels to the design grid: at least
    `oversampling` times the longer side, and a length that FFTs are fast for.
    """
    side = oversampling * max(camera.panel.shape)
    unit = _DIVISIBLE if side > _DIVISIBLE**2 else 1
    return unit * int(scipy.fft.next_fast_len(math.ceil(side / unit), real=True))


def design_plane(
    camera: Camera, wavelength: float, window: tuple[int, int], oversampling: int = OVERSAMPLING
) -> Plane:
    """A window (rows, columns) of the design grid around the axis, metres on the sensor.

    Raises ValueError for a wavelength that isn't positive, a panel in the plane in focus or
    beyond it, or a window larger than the panel can steer light to.
    """
    require_positive("wavelength", wavelength, "m")
    panel_to_focus_distance(camera)
    length = far_field_length(camera, oversampling)
    if max(window) > length:
        raise ValueError(
            f"window is {window}; the panel steers light to {length} samples at most: choose a "
            "smaller target"
        )
    pitch = wavelength * camera.ray_matrix_b / (length * camera.panel.pitch)
    return Plane(window, (pitch, pitch))


def window_for_reach(camera: Camera, wavelength: float, reach: float) -> tuple[int, int]:
    """The window (rows, columns) that holds light up to `reach` metres from the axis, and a
    dark margin around it.

    Raises ValueError with the farthest reach that the panel's pixels allow.
    """
    require_positive("reach", reach, "m")
    pitch = design_plane(camera, wavelength, (1, 1)).pitch[0]
    length = far_field_length(camera)
    if 2 * reach > length * pitch:
        raise ValueError(
            f"the target reaches {reach * 1e6:.0f} µm from the axis and the panel steers light to "
            f"{rounded_down(length * pitch / 2 * 1e6)} µm at most; choose a smaller one"
        )
    side = _WINDOW_STEP * math.ceil(_MARGIN * 2 * reach / pitch / _WINDOW_STEP)
    side = min(max(side, _SMALLEST_WINDOW), length)
    return side, side
