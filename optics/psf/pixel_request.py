"""Define what a PSFOperator is asked for: the light on sensor pixels, however it is sampled."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from optics.accuracy import FLOAT64_ARITHMETIC, Budget, require_memory
from optics.camera import Camera, Lens
from optics.camera.pupil import Scalar, cutoff_frequencies, numeric_camera, require_valid_source
from optics.plane import Plane
from optics.psf.choice import require_method
from optics.psf.request import PSFRequest, SphericalWaveCorrection
from optics.psf.symmetry import symmetric_shape
from optics.sensor import PixelIntegration
from optics.validation import (
    as_number,
    require_number,
    require_positive,
    require_size,
    require_tolerance,
    to_plain_numbers,
)

_PIXEL_TOL_SHARE = 0.01  # share of the tolerance that the integration over pixels may use. Chosen.

# Radians per stop radius by which a phase on a lens' points may change unless stated. Chosen.
_PHASE_SLOPE = 20.0


@dataclass(frozen=True)
class PixelRequest:
    """Describes the light that a PSFOperator is asked for; its parameters are told there.

    Raises ValueError or TypeError for what can't be asked for.
    """

    optics: Camera | Lens
    distance: Scalar
    wavelength: Scalar
    pixels: Plane
    field: tuple[Scalar, Scalar]
    sphere: bool
    integrate: bool
    symmetry: str
    tol: float
    method: str | None
    pixel_tol: float | None
    phase_slope: float | None
    budget: Budget

    def __post_init__(self) -> None:
        symmetric_shape(self.symmetry, (1, 1))
        if self.camera is None and self.symmetry != "none":
            raise ValueError(f"symmetry is {self.symmetry!r}; a lens without a panel has no pixels")
        require_valid_source(self.distance, self.wavelength)
        require_tolerance(self.tol)
        require_method(self.method, self.camera)
        _require_pixels(self.pixels)
        _require_slope(self.phase_slope)
        _require_field_position(self.field)
        if self.sphere and self.camera is None:
            raise ValueError("sphere is True; it is a wave over a panel, and a lens has none")
        if self.integrate and self.pixel_tol is not None:
            require_positive("pixel_tol", self.pixel_tol, "")

    @property
    def camera(self) -> Camera | None:
        """The camera; None for a lens alone."""
        return self.optics if isinstance(self.optics, Camera) else None

    @property
    def lens(self) -> Lens:
        return self.optics.lens if isinstance(self.optics, Camera) else self.optics

    @cached_property
    def floor(self) -> float:
        """The smallest tolerance that is ever kept, since the integration has its part of it."""
        share = _PIXEL_TOL_SHARE if self.integrate else 0.0
        return 20 * FLOAT64_ARITHMETIC / (1 - 2 * share)

    @cached_property
    def integration(self) -> PixelIntegration | None:
        """The integration over the pixels; None where the light at their centres is wanted."""
        if not self.integrate:
            rows, columns = self.pixels.shape
            what = f"the light at {columns}x{rows} points"
            require_memory(what, 8.0 * rows * columns, self.budget.memory, "ask for fewer pixels")
            return None
        plain = (
            numeric_camera(self.optics)
            if isinstance(self.optics, Camera)
            else to_plain_numbers(self.optics)
        )
        cutoff = cutoff_frequencies(plain, as_number(self.wavelength))
        # Below the floor nothing is kept: no weights are sought for what is refused anyway.
        tol = self.pixel_tol or _PIXEL_TOL_SHARE * max(self.floor, self.tol)
        return PixelIntegration(self.pixels, cutoff, self.budget, tol)

    @cached_property
    def integration_error(self) -> float:
        """The relative L2 error that is planned for the integration over pixels; 0 without one."""
        return self.integration.error if self.integration else 0.0

    def on_samples(self) -> PSFRequest:
        """Return the request of the light on the samples that the integration takes."""
        return PSFRequest(
            self.lens,
            self.distance,
            self.wavelength,
            self.integration.plane if self.integration else self.pixels,
            self.tol - self.integration_error,
            self.budget,
            self.integration.margin if self.integration else (0, 0),
            _PHASE_SLOPE if self.phase_slope is None else self.phase_slope,
            self.camera.separation if self.camera else 0.0,
            (self.field[0], self.field[1]),
            self._spherical_wave,
            self.pixels.pitch if self.integrate else (0.0, 0.0),
        )

    @property
    def _spherical_wave(self) -> SphericalWaveCorrection | None:
        """The spherical-wave correction over the panel, if it is asked for."""
        if self.camera is None or not self.sphere:
            return None
        image, z1 = self.camera.lens.image_distance, self.camera.separation
        sines = (self.field[0] / image, self.field[1] / image)
        meets = (-z1 * sines[0], -z1 * sines[1])
        return SphericalWaveCorrection(self.distance, self.wavelength, sines, meets)


def _require_pixels(pixels: Plane) -> None:
    """Raise TypeError or ValueError for pixels that no sensor has."""
    if not isinstance(pixels, Plane):
        raise TypeError(f"pixels is a {type(pixels).__name__}; give a Plane, as Sensor.window does")
    for pitch, place in zip(pixels.pitch, pixels.centre, strict=True):
        require_size("pixel_pitch", "the pixels' pitch", pitch)
        require_size("field", "the pixels' centre", place)


def _require_slope(phase_slope: float | None) -> None:
    if phase_slope is None:
        return
    require_number("phase_slope", phase_slope, "rad per stop radius")
    if not 0 <= phase_slope < math.inf:
        raise ValueError(
            f"phase_slope is {phase_slope:g}; give the radians per stop radius, 0 or more"
        )


def _require_field_position(field: tuple[Scalar, Scalar]) -> None:
    if len(field) != 2 or not all(math.isfinite(as_number(place)) for place in field):
        raise ValueError(f"field is {field}; give two finite lengths (y, x) in metres")
    for place in field:
        require_size("field", "field", place)
