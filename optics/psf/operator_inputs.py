"""Check what a PSFOperator is asked for, and complete it."""

from __future__ import annotations

import math

from optics.camera import Camera, Lens
from optics.camera.pupil import Scalar, numeric_camera
from optics.plane import Plane
from optics.psf.request import SphericalWaveCorrection
from optics.psf.symmetry import symmetric_shape
from optics.validation import as_number, require_number, require_size, to_plain_numbers


def require_symmetry(symmetry: str, camera: Camera | None) -> str:
    """Return the symmetry of patterns, or raise ValueError if it isn't one, or has no panel."""
    symmetric_shape(symmetry, (1, 1))
    if camera is None and symmetry != "none":
        raise ValueError(f"symmetry is {symmetry!r}; a lens without a panel has no pixels")
    return symmetry


def resolve_unmodulated_share(camera: Camera | None, share: float | None) -> float:
    """Return the share of light that gets no phase from the panel, the panel's own by default.

    Raises ValueError unless it lies between 0 and 1, or if there is no panel.
    """
    if camera is None:
        if share:
            raise ValueError(f"unmodulated is {share:g}; a lens without a panel modulates nothing")
        return 0.0
    share = camera.panel.unmodulated if share is None else share
    if not 0 <= share <= 1:
        raise ValueError(f"unmodulated is {share:g}; it is a share and must lie between 0 and 1")
    return share


def validate_field_position(field: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
    """Return where the point is imaged, (y, x) in metres, or raise ValueError."""
    if len(field) != 2 or not all(math.isfinite(as_number(place)) for place in field):
        raise ValueError(f"field is {field}; give two finite lengths (y, x) in metres")
    for place in field:
        require_size("field", "field", place)
    return field[0], field[1]


def require_pixels(pixels: Plane) -> None:
    """Raise TypeError or ValueError for pixels that no sensor has."""
    if not isinstance(pixels, Plane):
        raise TypeError(f"pixels is a {type(pixels).__name__}; give a Plane, as Sensor.window does")
    for pitch, place in zip(pixels.pitch, pixels.centre, strict=True):
        require_size("pixel_pitch", "the pixels' pitch", pitch)
        require_size("field", "the pixels' centre", place)


def require_slope(phase_slope: float | None) -> None:
    """Raise an error for a phase slope that can't be."""
    if phase_slope is None:
        return
    require_number("phase_slope", phase_slope, "rad per stop radius")
    if not 0 <= phase_slope < math.inf:
        raise ValueError(
            f"phase_slope is {phase_slope:g}; give the radians per stop radius, 0 or more"
        )


def build_spherical_wave(
    camera: Camera | None, distance: Scalar, wavelength: Scalar, field: tuple[Scalar, Scalar]
) -> SphericalWaveCorrection:
    """Build the spherical-wave correction over the panel for a point imaged at `field`.

    field: (y, x) in metres on the sensor.
    """
    if camera is None:
        raise ValueError("sphere is True; it is a wave over a panel, and a lens has none")
    image, z1 = camera.lens.image_distance, camera.separation
    sines = (field[0] / image, field[1] / image)
    return SphericalWaveCorrection(distance, wavelength, sines, (-z1 * sines[0], -z1 * sines[1]))


def numeric_optics(optics: Camera | Lens) -> Camera | Lens:
    """Return the camera or lens in plain numbers, without derivatives."""
    return numeric_camera(optics) if isinstance(optics, Camera) else to_plain_numbers(optics)
