"""A camera's sharpness, its MTF from stop to pixel, and how much light it takes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import constants

from optics.camera import Camera
from optics.camera.pupil import open_area
from optics.gauss_legendre import gauss_legendre
from optics.validation import as_number, require_positive, require_wavelength


def electron_rate(
    camera: Camera,
    radiance: float,
    bandwidth: float,
    wavelength: float,
    distance: float = math.inf,
) -> float:
    """Compute the photo-electrons that a diffuse object causes, per second and m² of sensor.

    radiance: W / (sr m² m), per metre of wavelength. bandwidth: metres of wavelength.
    distance: metres from the object to the panel; it matters where the lens stands apart from it.

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


Array = NDArray[np.float64]


def system_mtf(
    camera: Camera,
    wavelength: float,
    frequencies: ArrayLike,
    angle: float = 0.0,
    distance: float | None = None,
) -> Array:
    """Compute the MTF of lens and pixels together, with a neutral panel.

    frequencies: cycles per metre on the sensor, any shape, not negative.
    angle: radians, the direction in which the fringes change, from x (along rows) towards y.
    distance: metres from the panel to the object, on the axis; by default the object is in focus.

    The MTF is the modulus of neutral_panel_otf() times sinc(p fx) sinc(p fy) of square pixels of
    pitch p.
    """
    along = np.asarray(frequencies, dtype=np.float64)
    pitch = camera.sensor.pitch
    pixel = np.sinc(pitch * along * math.cos(angle)) * np.sinc(pitch * along * math.sin(angle))
    return np.abs(neutral_panel_otf(camera, wavelength, along, angle, distance) * pixel)


def neutral_panel_otf(
    camera: Camera,
    wavelength: float,
    frequencies: ArrayLike,
    angle: float = 0.0,
    distance: float | None = None,
) -> Array:
    """Compute the OTF of lens and neutral panel without the pixels; 1 at frequency 0.

    It is real and may be negative; the parameters are those of system_mtf(). The pupil is the
    intersection of the lens' round stop and the panel's rectangle, projected from the object's
    point into the lens' plane. Its autocorrelation at a shift of λ z f (Goodman, Introduction to
    Fourier Optics, 6.3) is integrated along x in closed form, and along y by Gauss' rule; defocus
    adds a phase that is linear over the overlap. The panel counts as one mirror: light that its
    pixel grid sends into far diffraction orders is left out.

    Raises ValueError for a stop that isn't a clear circle, aberrations, a lens that isn't thin, or
    an object that isn't in front of the panel.
    """
    require_wavelength("wavelength", wavelength)
    pupil = _Pupil(camera, distance)
    along = np.asarray(frequencies, dtype=np.float64)
    if not np.isfinite(along).all() or (along < 0).any():
        raise ValueError("a frequency is negative or not finite; give cycles per metre")
    shift = wavelength * pupil.image_distance * along
    curvature = 2 * math.pi * pupil.defocus / wavelength
    values = [
        pupil.autocorrelation(one * math.sin(angle), one * math.cos(angle), curvature)
        for one in shift.ravel()
    ]
    return np.array(values).reshape(along.shape) / pupil.autocorrelation(0.0, 0.0, 0.0)


class _Pupil:
    """The overlap of panel and round stop in the lens' plane, in metres.

    It has half the panel's height and width, and the stop's radius.
    defocus: 1/m, vergence of the object's wave less that of a wave from the plane in focus.
    """

    def __init__(self, camera: Camera, distance: float | None) -> None:
        lens, panel = camera.lens, camera.panel
        if not (lens.has_clear_stop and lens.has_quadratic_phase):
            raise ValueError(
                "the transfer function of this lens isn't known in closed form; give a thin lens "
                "with a round, clear stop and no aberrations"
            )
        separation, focus = as_number(camera.separation), as_number(lens.focus_distance)
        from_lens = focus if distance is None else distance + separation
        seen = from_lens - separation
        if not seen > 0:
            raise ValueError(f"distance is {seen:g} m; the object must be in front of the panel")
        wider = 1.0 if math.isinf(seen) else from_lens / seen
        self.radius = 0.5 * as_number(lens.stop_diameter)
        rows, columns = panel.shape
        self.half_height = min(0.5 * rows * panel.pitch * wider, self.radius)
        self.half_width = 0.5 * columns * panel.pitch * wider
        self.image_distance = as_number(lens.image_distance)
        self.defocus = 1 / from_lens - 1 / focus

    def autocorrelation(self, dy: float, dx: float, curvature: float) -> float:
        """Compute the autocorrelation in square metres, at a shift of (dy, dx) metres.

        Defocus adds the phase curvature (dy y + dx x).
        """
        half = self.half_height - abs(dy) / 2
        if half <= 0:
            return 0.0
        waves = abs(curvature) * math.hypot(dy, dx) * 2 * self.radius / (2 * math.pi)
        # There are 320 lines across the pupil, and 8 more for each wave of defocus across it.
        nodes, weights = gauss_legendre(320 + 8 * math.ceil(waves))
        # The nodes are denser at both ends, where the chord of a circle falls as a square root.
        y = half * np.sin(0.5 * np.pi * nodes)
        step = 0.5 * np.pi * half * np.cos(0.5 * np.pi * nodes) * weights
        above, below = self._half_chord(y + dy / 2), self._half_chord(y - dy / 2)
        low = np.maximum(-above - dx / 2, -below + dx / 2)
        high = np.minimum(above - dx / 2, below + dx / 2)
        length = np.maximum(high - low, 0.0)
        turn = curvature * dx
        line = length * np.sinc(turn * length / (2 * np.pi))
        return float((step * line * np.cos(turn * (low + high) / 2 + curvature * dy * y)).sum())

    def _half_chord(self, y: Array) -> Array:
        """Return half the width at a height y, in metres."""
        round_part = np.sqrt(np.maximum(self.radius**2 - y**2, 0.0))
        return np.minimum(round_part, self.half_width)
