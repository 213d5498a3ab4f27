"""Define the request for a PSF: a lens, a point, a wavelength, samples and a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import torch

from optics.accuracy import Budget
from optics.camera import Lens
from optics.plane import Plane
from optics.psf_engines.spherical_wave import SphericalWaveCorrection
from optics.pupil import Scalar, phase_slope_bound, require_valid_source
from optics.stop.quadrature import PhaseSlopeBound
from optics.validation import (
    as_number,
    needs_gradient,
    require_unchanged_attributes,
    to_plain_numbers,
)


@dataclass(frozen=True)
class PSFRequest:
    """Describes a PSF to be computed: a point's light behind a lens, on samples at the sensor.

    lens, distance, wavelength: SI units; numbers, or 0-d tensors in which the PSF shall be
    differentiable. samples: the plane of the samples; its centre may hold tensors. tol: relative L2
    error of the intensity on the samples. margin: samples on each side, along y and x, that serve
    only the integration over sensor pixels. phase_slope: radians per stop radius by which a phase
    that is added to the lens' wave may change.

    separation: metres from a panel to the lens; `distance` is measured from the object to the
    panel. field: metres (y, x) on the sensor from the axis to the point's geometric image, around
    which the samples lie. sphere: the point's spherical wave over the panel; None for its parabola.
    pixel: size (y, x) in metres of the sensor pixels over which the samples are integrated
    afterwards; 0 if the samples themselves are wanted. pattern_tol: relative L2 error that light
    with a pattern must keep, where `tol` is planned smaller because patterns will be given; None if
    it is `tol`.
    """

    lens: Lens
    distance: Scalar
    wavelength: Scalar
    samples: Plane
    tol: float
    budget: Budget
    margin: tuple[int, int] = (0, 0)
    phase_slope: float = 0.0
    separation: Scalar = 0.0
    field: tuple[Scalar, Scalar] = (0.0, 0.0)
    sphere: SphericalWaveCorrection | None = None
    pixel: tuple[float, float] = (0.0, 0.0)
    pattern_tol: float | None = None

    def __post_init__(self) -> None:
        require_valid_source(self.distance, self.wavelength)

    @cached_property
    def numeric(self) -> PSFRequest:
        """The same PSF request in plain numbers, without derivatives."""
        return cast(PSFRequest, to_plain_numbers(self))

    @property
    def window_slices(self) -> tuple[slice, slice]:
        """The rows and columns of the PSF request's samples without the margin."""
        rows, columns = self.samples.shape
        y, x = self.margin
        return slice(y, rows - y), slice(x, columns - x)

    @property
    def shadow_magnification(self) -> Scalar:
        """The width of the panel's shadow at the lens over the panel's, in the PSF request."""
        return 1 + self.separation / self.distance

    @property
    def object_to_lens_distance(self) -> Scalar:
        """The distance from the PSF request's object to the lens, in metres."""
        return self.distance + self.separation

    @property
    def chief_ray_slopes(self) -> tuple[Scalar, Scalar]:
        """The slopes (y, x) of the PSF request's chief ray through the middle of the lens."""
        z = self.lens.image_distance
        return self.field[0] / z, self.field[1] / z

    @property
    def scale(self) -> Scalar:
        """The wavelength times the image distance of the PSF request, m²."""
        return self.wavelength * self.lens.image_distance

    @property
    def radius(self) -> Scalar:
        """The stop radius of the PSF request, in metres."""
        return self.lens.stop_diameter / 2

    @property
    def intensity_scale(self) -> Scalar:
        """The PSF request's factor from ``|integral|²`` over the stop to light shares per sample.

        Lengths in the integral are in stop radii.
        """
        area = self.samples.pitch[0] * self.samples.pitch[1]
        return area * self.radius**2 / (self.scale**2 * self.lens.stop.area)

    @cached_property
    def farthest_sample_radius(self) -> float:
        """The distance from the axis to the PSF request's farthest sample, in metres."""
        y, x = self.numeric.samples.mesh()
        return math.hypot(float(y.abs().max()), float(x.abs().max()))

    @cached_property
    def phase_slope_bound(self) -> PhaseSlopeBound:
        """The PSF request's bound on the phase slope in the stop.

        The bound includes the kernel of the farthest sample.
        """
        n = self.numeric
        tilt = 2 * math.pi * n.radius * self.farthest_sample_radius / n.scale
        return phase_slope_bound(n.lens, n.distance, n.wavelength, tilt + self.phase_slope)

    @property
    def transform_variables(self) -> TransformVariables:
        """The PSF request's pupil stretch and image shift, as tensors with derivatives."""
        n = self.numeric
        stretch = (self.radius / n.radius) * (n.scale / self.scale)
        centre = self.samples.centre
        shift = None
        if any(needs_gradient(c) for c in centre):
            shift = tuple(torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in centre)
        return TransformVariables(stretch if needs_gradient(stretch) else None, shift)  # type: ignore[arg-type]

    def require_unchanged(self) -> None:
        """Raise ValueError if a tensor of the PSF request has changed since the plan was made."""
        if not self._has_tensors:
            return
        names = ("lens", "distance", "wavelength", "samples", "separation", "field")
        require_unchanged_attributes(names, self.numeric, replace(self).numeric, "PSFOperator")

    @cached_property
    def _has_tensors(self) -> bool:
        """Whether any length of the PSF request is a tensor, which might change after the plan."""
        return self.numeric is not self

    @property
    def differentiable(self) -> bool:
        """Whether the PSF request wants derivatives with respect to any of its lengths."""
        lens = self.lens
        lengths = (self.distance, self.wavelength, lens.focal_length, lens.f_number)
        aberrations = (path for _, _, path in lens.aberrations)
        apart = (self.separation, *self.field)
        lengths = (*lengths, lens.focus_distance, *aberrations, *apart)
        return any(map(needs_gradient, lengths)) or self.needs_geometry_gradient

    @property
    def needs_geometry_gradient(self) -> bool:
        """Whether the PSF request wants derivatives for lengths that shift light on the samples."""
        moving = (self.scale, self.radius, *self.samples.centre)
        return any(needs_gradient(value) for value in moving)


@dataclass(frozen=True)
class TransformVariables:
    """Holds stretch and shift of an `optics.fourier.Transform`, as tensors with derivatives.

    Their values are 1 and (0, 0); None where no derivative is wanted.
    """

    stretch: torch.Tensor | None
    shift: tuple[torch.Tensor, torch.Tensor] | None
