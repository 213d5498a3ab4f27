"""Choose the grid in the focal plane on which a PSF is designed and its quality measured."""

from __future__ import annotations

import math

import scipy.fft

from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance
from optics.plane import Plane
from optics.validation import require_positive, require_wavelength, rounded_down

OVERSAMPLING = 2
"""Sampling rate of the design grid over the pupil's Nyquist rate.

A coarser grid would miss speckle between its samples.
"""


def far_field_length(camera: Camera, oversampling: int = OVERSAMPLING) -> int:
    """Return the number of samples along an axis of the far field of a phase retrieval.

    The panel can steer light to all of them. The number is the length of the Fourier transform from
    pixels to the design grid. It is at least `oversampling` times the longer side of the panel, and
    FFTs of that length are fast.
    """
    side = oversampling * max(camera.panel.shape)
    # A multiple of 16 is divisible by many superpixel sides.
    unit = 16 if side > 16**2 else 1
    return unit * int(scipy.fft.next_fast_len(math.ceil(side / unit), real=True))


def design_plane(
    camera: Camera, wavelength: float, window: tuple[int, int], oversampling: int = OVERSAMPLING
) -> Plane:
    """Choose the grid in the focal plane on which a phase retrieval designs a PSF.

    The grid is a window of the far field around the axis.

    Parameters
    ----------
    camera : Camera
        Camera whose panel steers the light.
    wavelength : float
        Metres.
    window : tuple of int
        (rows, columns) of the window in samples.
    oversampling : int, default 2
        How much finer than the pupil's Nyquist rate the grid is at least. On a coarser grid than
        the default, speckle hides between the samples.

    Returns
    -------
    Plane
        The samples of the window, with a pitch in metres on the sensor.

    Raises
    ------
    ValueError
        If the wavelength isn't positive, the panel lies in the plane in focus or beyond it, or the
        window is larger than the panel can steer light to.
    """
    require_wavelength("wavelength", wavelength)
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
    """Choose the size of a phase retrieval's window, for light up to `reach` from the axis.

    The window leaves a dark margin around the light.

    Parameters
    ----------
    camera : Camera
        Camera whose panel steers the light.
    wavelength : float
        Metres.
    reach : float
        Largest distance of the light from the axis along y or x, metres on the sensor.

    Returns
    -------
    tuple of int
        (rows, columns) of the window for `design_plane`; it is square.

    Raises
    ------
    ValueError
        If the reach isn't positive or is farther than the panel's pixels allow; the message gives
        the farthest reach.
    """
    require_positive("reach", reach, "m")
    pitch = design_plane(camera, wavelength, (1, 1)).pitch[0]
    length = far_field_length(camera)
    if 2 * reach > length * pitch:
        raise ValueError(
            f"the target reaches {reach * 1e6:.0f} µm from the axis and the panel steers light to "
            f"{rounded_down(length * pitch / 2 * 1e6)} µm at most; choose a smaller one"
        )
    # The window is 1.2 times as wide as the target, a multiple of 32 samples, and 128 at least.
    step = 32
    side = step * math.ceil(1.2 * 2 * reach / pitch / step)
    side = min(max(side, 128), length)
    return side, side
