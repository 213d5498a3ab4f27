"""Where the light is rendered: finely enough for its fringes, and as far as it goes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from optics.camera import Camera, Sensor
from optics.plane import Plane
from optics.psf import nyquist_samples
from optics.pupil import blur_radius

_FINER = 2
"""Samples per sensor pixel of the rendered light, at least."""

_TO_SPARE = 1.05
"""Over the samples that resolve the PSF's finest fringe: the filter's band reaches below
its centre."""

_SMALLEST_WINDOW, _LARGEST_WINDOW = 256, 1024
"""Sensor pixels across the rendered PSF; what falls beyond is lost to the picture."""

_WINDOW_STEP = 64

_WINDOW_MARGIN = 128
"""Sensor pixels around the light that geometric optics predicts, for its diffraction."""


@dataclass(frozen=True)
class Grid:
    """Where light is rendered: a PSF `window` sensor pixels wide, `finer` samples a pixel."""

    window: int
    finer: int

    def plane(self, sensor: Sensor) -> Plane:
        """The sensor with a margin of half a PSF around it."""
        rows, columns = (n + self.window for n in sensor.shape)
        return sensor.window((rows, columns)).finer(self.finer)

    def psf_plane(self, sensor: Sensor) -> Plane:
        """Of a point's light, around its geometric image."""
        return sensor.window((self.window, self.window)).finer(self.finer)


def grid_for(camera: Camera, distance: float, spread: float, wavelength: float) -> Grid:
    """Fine enough for the finest fringe, and wide enough for the light of a point.

    spread: metres to which a pattern sends light. Light that a wild one scatters beyond the
    largest window is lost. Raises ValueError if defocus alone goes beyond it.
    """
    finer = max(_FINER, math.ceil(_TO_SPARE * nyquist_samples(camera, wavelength)))
    pitch = camera.sensor.pitch
    blurred = 2 * blur_radius(camera, distance) / pitch + _WINDOW_MARGIN
    if blurred > _LARGEST_WINDOW:
        raise ValueError(
            f"a point at {distance:g} m is blurred over {blurred:.0f} pixels and "
            f"{_LARGEST_WINDOW} can be rendered; bring it closer to the plane in focus, "
            f"{camera.lens.focus_distance - camera.separation:g} m"
        )
    window = min(max(blurred + 2 * spread / pitch, _SMALLEST_WINDOW), _LARGEST_WINDOW)
    return Grid(_WINDOW_STEP * math.ceil(window / _WINDOW_STEP), finer)
