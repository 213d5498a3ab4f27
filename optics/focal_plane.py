"""Compute the field in the back focal plane of a lens (thesis Eq. 2.13 to 2.15)."""

from __future__ import annotations

import math

import torch

from optics.fourier import FourierGeometry, plan_transform
from optics.plane import Plane
from optics.validation import (
    accepts_numpy,
    require_finite,
    require_positive,
    require_wavelength,
    rounded_down,
)


@accepts_numpy
def focal_field(
    field: torch.Tensor,
    pupil_plane: Plane,
    image_plane: Plane,
    focal_length: float,
    wavelength: float,
    *,
    distance_before_lens: float = 0.0,
) -> torch.Tensor:
    """Compute the complex field in a lens' back focal plane from a field before the lens.

        U_f(u) = exp(i k / (2 f) (1 - d / f) |u|²) / (i wavelength f)
                 x integral of U(x) exp(-2 pi i x u / (wavelength f)) dx

    (Goodman, Introduction to Fourier Optics, 5.2; thesis Eq. 2.15). The constant factor
    exp(i k (d + f)) is left out. With d = f (a 2f system) the result is the Fourier transform
    itself, without curvature.

    field: (..., rows, columns) on `pupil_plane`; each sample stands for its area. image_plane:
    the samples of the result. distance_before_lens: d, from the field to the lens, 0 or more.
    Lengths are in metres, and focal_length is positive. |U|² is light per square metre in both
    planes. The result is complex64, or complex128 for a field in double precision, and
    differentiable in the field.

    The model is a paraxial thin lens without a stop. The integral is a sum over the samples,
    exact where they resolve the field. Raises ValueError for an image plane wider than
    wavelength f / pitch, beyond which the sum repeats, and for lengths or fields that aren't
    valid numbers.
    """
    require_positive("focal_length", focal_length, "m")
    require_wavelength("wavelength", wavelength)
    if not 0 <= distance_before_lens < math.inf:
        raise ValueError(
            f"distance_before_lens is {distance_before_lens:g} m; the field must be in front of "
            "the lens, 0 m or more"
        )
    if field.shape[-2:] != pupil_plane.shape:
        raise ValueError(
            f"field is {tuple(field.shape)}; its pupil_plane has {pupil_plane.shape} samples"
        )
    require_finite("field", field)
    scale = wavelength * focal_length
    for axis in (0, 1):
        # The sampled transform repeats beyond this.
        half = scale / pupil_plane.pitch[axis] / 2
        reach = float(image_plane.coordinates(axis).abs().max())
        if reach > half * (1 + 1e-9):
            raise ValueError(
                f"image_plane reaches {reach:.4g} m in {'yx'[axis]}, and the field's samples "
                f"resolve light to {half:.4g} m; make the image plane smaller or pupil_plane's "
                f"pitch {rounded_down(scale / reach / 2)} m or finer"
            )
    dtype = torch.promote_types(field.dtype, torch.complex64)
    transform = plan_transform(FourierGeometry(pupil_plane, image_plane, scale), dtype)
    y, x = image_plane.mesh()
    bend = math.pi / scale * (1 - distance_before_lens / focal_length)
    curvature = bend * (y**2 + x**2) - math.pi / 2
    strength = torch.full_like(curvature, pupil_plane.pitch[0] * pupil_plane.pitch[1] / scale)
    # In single precision a phase of many turns would lose digits, so it is reduced to one turn.
    factor = torch.polar(strength, curvature.remainder(2 * math.pi))
    return transform(field) * factor.to(device=field.device, dtype=dtype)
