"""Compute how much light an object sends to the sensor."""

from __future__ import annotations

import math

from scipy import constants

from optics.camera import Camera
from optics.pupil import open_area
from optics.validation import require_positive, require_wavelength


def electron_rate(
    camera: Camera,
    radiance: float,
    bandwidth: float,
    wavelength: float,
    distance: float = math.inf,
) -> float:
    """Compute the rate of photo-electrons that a diffuse object causes behind a camera's lens.

    The rate is per second and square metre of sensor. radiance: W / (sr m² m), per metre of
    wavelength. bandwidth: metres of wavelength. distance: metres from the object to the panel; it
    matters where the lens stands apart from the panel.

    The camera equation is E = L A / z², where A is the area that stop and panel leave open, and z
    the image distance. Photons have the energy h c / wavelength. The equation holds near the axis,
    where cos⁴ is one. The shares of a PSF refer to the light through A in the panel's plane. At the
    lens, from which the light converges to the image, this light is wider by the factor 1 +
    separation / distance.

    Raises ValueError for a negative radiance, or lengths that aren't positive.
    """
    if not 0 <= radiance < math.inf:
        raise ValueError(f"radiance is {radiance:g} W/(sr m² m); it must be finite, not negative")
    require_positive("bandwidth", bandwidth, "m")
    require_wavelength("wavelength", wavelength)
    panel, lens, sensor = camera.panel, camera.lens, camera.sensor
    if not distance > 0:
        raise ValueError(f"distance is {distance:g} m; the object must be in front of the camera")
    spread = 1 + camera.separation / distance
    irradiance = radiance * bandwidth * open_area(camera) * spread**2 / lens.image_distance**2
    passed = irradiance * panel.reflectivity * camera.transmission
    photons = passed * wavelength / (constants.h * constants.c)
    return photons * sensor.quantum_efficiency
