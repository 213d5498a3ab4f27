"""How much light an object sends to the sensor."""

from __future__ import annotations

import math

from optics.camera import Camera

PLANCK = 6.62607015e-34
SPEED_OF_LIGHT = 299792458.0


def electron_rate(camera: Camera, radiance: float, bandwidth: float, wavelength: float) -> float:
    """Photo-electrons per second and square metre of sensor from a diffuse object.

    radiance: W / (sr m² m), per metre of wavelength. bandwidth: metres of wavelength.
    The camera equation E = L A / z², with A the smaller of stop and panel, z the image
    distance, and photons of energy h c / wavelength; near the axis, where cos⁴ is one.
    """
    panel, lens, sensor = camera.panel, camera.lens, camera.sensor
    panel_area = panel.shape[0] * panel.shape[1] * panel.pitch**2
    area = min(panel_area, math.pi * lens.stop_diameter**2 / 4)
    irradiance = radiance * bandwidth * area / lens.image_distance**2
    passed = irradiance * panel.reflectivity * camera.transmission
    photons = passed * wavelength / (PLANCK * SPEED_OF_LIGHT)
    return photons * sensor.quantum_efficiency
