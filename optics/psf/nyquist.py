"""The samples per sensor pixel that resolve a PSF."""

from __future__ import annotations

from optics.camera import Camera
from optics.pupil import cutoff_frequency


def nyquist_samples_per_pixel(camera: Camera, wavelength: float) -> float:
    """Compute the samples per sensor pixel that just resolve a PSF's finest fringe along an axis.

    Parameters
    ----------
    camera : Camera
        Its stop and image distance set the cutoff frequency, its sensor the pixel pitch.
    wavelength : float
        Metres.

    Returns
    -------
    float
        Twice the cutoff frequency times the pixel pitch.
    """
    return 2 * camera.sensor.pitch * cutoff_frequency(camera, wavelength)
