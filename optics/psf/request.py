"""Define what a PSF is asked for: lens, point, wavelength, samples at the sensor and a tolerance.

The point's spherical wave over the panel, and the samples that resolve a PSF, follow from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import torch

from optics.accuracy import Budget
from optics.camera import Camera, Lens
from optics.camera.pupil import Scalar, cutoff_frequency, phase_slope_bound, require_valid_source
from optics.camera.stop_nodes import PhaseSlopeBound
from optics.plane import Plane
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
    differentiable.
    samples: the plane of the samples; its centre may hold tensors.
    tol: relative L2 error of the intensity on the samples.
    margin: samples on each side, along y and x, that serve only the integration over sensor pixels.
    phase_slope: radians per stop radius by which a phase that is added to the lens' wave may
    change.
    separation: metres from a panel to the lens; `distance` is measured from the object to the
    panel.
    field: metres (y, x) on the sensor from the axis to the point's geometric image, around which
    the samples lie.
    sphere: the point's spherical wave over the panel; None for its parabola.
    pixel: size (y, x) in metres of the sensor pixels over which the samples are integrated
    afterwards; 0 if the samples themselves are wanted.
    pattern_tol: relative L2 error that light with a pattern must keep, where `tol` is planned
    smaller because patterns will be given; None if it is `tol`.
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
        """The same request in plain numbers, without derivatives."""
        return cast(PSFRequest, to_plain_numbers(self))

    @property
    def window_slices(self) -> tuple[slice, slice]:
        """The rows and columns of the samples without the margin."""
        rows, columns = self.samples.shape
        y, x = self.margin
        return slice(y, rows - y), slice(x, columns - x)

    @property
    def shadow_magnification(self) -> Scalar:
        """The width of the panel's shadow at the lens over the panel's."""
        return 1 + self.separation / self.distance

    @property
    def object_to_lens_distance(self) -> Scalar:
        """The distance from the object to the lens, in metres."""
        return self.distance + self.separation

    @property
    def chief_ray_slopes(self) -> tuple[Scalar, Scalar]:
        """The slopes (y, x) of the chief ray through the middle of the lens."""
        z = self.lens.image_distance
        return self.field[0] / z, self.field[1] / z

    @property
    def scale(self) -> Scalar:
        """The wavelength times the image distance, m²."""
        return self.wavelength * self.lens.image_distance

    @property
    def radius(self) -> Scalar:
        """The radius of the stop, in metres."""
        return self.lens.stop_diameter / 2

    @property
    def intensity_scale(self) -> Scalar:
        """The factor from ``|integral|²`` over the stop to shares of the light per sample.

        Lengths in the integral are in stop radii.
        """
        area = self.samples.pitch[0] * self.samples.pitch[1]
        return area * self.radius**2 / (self.scale**2 * self.lens.stop.area)

    @cached_property
    def farthest_sample_radius(self) -> float:
        """The distance from the axis to the farthest sample, in metres."""
        y, x = self.numeric.samples.mesh()
        return math.hypot(float(y.abs().max()), float(x.abs().max()))

    @cached_property
    def phase_slope_bound(self) -> PhaseSlopeBound:
        """A bound on the phase slope in the stop, including the kernel of the farthest sample."""
        n = self.numeric
        tilt = 2 * math.pi * n.radius * self.farthest_sample_radius / n.scale
        return phase_slope_bound(n.lens, n.distance, n.wavelength, tilt + self.phase_slope)

    @property
    def transform_variables(self) -> TransformVariables:
        """The stretch of the pupil and the shift of the image, as tensors with derivatives."""
        n = self.numeric
        stretch = (self.radius / n.radius) * (n.scale / self.scale)
        centre = self.samples.centre
        shift = None
        if any(needs_gradient(c) for c in centre):
            shift = tuple(torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in centre)
        return TransformVariables(stretch if needs_gradient(stretch) else None, shift)  # type: ignore[arg-type]

    def require_unchanged(self) -> None:
        """Raise ValueError if a tensor has changed since the plan was made."""
        if not self._has_tensors:
            return
        names = ("lens", "distance", "wavelength", "samples", "separation", "field")
        require_unchanged_attributes(names, self.numeric, replace(self).numeric, "PSFOperator")

    @cached_property
    def _has_tensors(self) -> bool:
        """Whether any length is a tensor, which might change after the plan."""
        return self.numeric is not self

    @property
    def differentiable(self) -> bool:
        """Whether derivatives with respect to any of the lengths are wanted."""
        lens = self.lens
        lengths = (self.distance, self.wavelength, lens.focal_length, lens.f_number)
        aberrations = (path for _, _, path in lens.aberrations)
        apart = (self.separation, *self.field)
        lengths = (*lengths, lens.focus_distance, *aberrations, *apart)
        return any(map(needs_gradient, lengths)) or self.needs_geometry_gradient

    @property
    def needs_geometry_gradient(self) -> bool:
        """Whether derivatives are wanted for lengths that shift light on the samples."""
        moving = (self.scale, self.radius, *self.samples.centre)
        return any(needs_gradient(value) for value in moving)


@dataclass(frozen=True)
class TransformVariables:
    """Holds stretch and shift of an `optics.fourier.Transform`, as tensors with derivatives.

    Their values are 1 and (0, 0); None where no derivative is wanted.
    """

    stretch: torch.Tensor | None
    shift: tuple[torch.Tensor, torch.Tensor] | None


@dataclass(frozen=True)
class SphericalWaveCorrection:
    """Computes the spherical wave of thesis Eq. 5.1 and 5.2, divided by its paraxial parabola.

    Let v = 1 / distance be the vergence, r0 the distance from the point to the centre, s the
    chief_ray_sines, w = 1 / r0 = v sqrt(1 - s²), and p a position relative to the centre. The
    sphere's path is r = r0 q with q² = 1 + 2 w s.p + w² p², and the parabola's path is s.p + v p² /
    2. Their difference r - r0 - s.p - v p² / 2 is computed without subtracting large numbers, so
    that a far object is the limit of a near one. The amplitude is 1 / r relative to the distance
    along the axis, 1 / (v r).

    distance: metres from the object to the panel's plane, math.inf allowed.
    chief_ray_sines: sines (y, x) of the chief ray's direction, which are field over image distance.
    centre: metres (y, x) where the chief ray meets the panel.
    """

    distance: Scalar
    wavelength: Scalar
    chief_ray_sines: tuple[Scalar, Scalar]
    centre: tuple[Scalar, Scalar]

    def __post_init__(self) -> None:
        if not math.hypot(*map(as_number, self.chief_ray_sines)) < 1:
            raise ValueError(
                "field lies at a sine of "
                f"{math.hypot(*map(as_number, self.chief_ray_sines)):.3g} from the axis; "
                "give a point nearer to it"
            )

    def wave_factor(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the complex factor at positions (y, x), complex128.

        y, x: metres on the panel, tensors that broadcast.
        """
        path, amplitude = self._path_and_amplitude(y, x)
        return torch.polar(amplitude, 2 * math.pi / self.wavelength * path)

    def phase(self, y: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """Return the phase of wave_factor(), radians, float64."""
        return 2 * math.pi / self.wavelength * self._path_and_amplitude(y, x)[0]

    def _path_and_amplitude(
        self, y: torch.Tensor, x: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        v, (sy, sx) = 1 / self.distance, self.chief_ray_sines
        y, x = y - self.centre[0], x - self.centre[1]
        sine2 = sy**2 + sx**2
        cosine = (1 - sine2) ** 0.5
        w = v * cosine
        along, p2 = sy * y + sx * x, y**2 + x**2
        beyond = 2 * w * along + w**2 * p2
        q = torch.sqrt(1 + beyond)
        tilted = -along * (2 * along + w * p2) * w / (1 + q) ** 2
        bent = -2 * sine2 / (1 + cosine) - beyond / (1 + q)
        return tilted + v * p2 * bent / (2 * (1 + q)), cosine / q

    def phase_gradient(
        self, y: torch.Tensor, x: torch.Tensor, spacing: float
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the slopes of wave_factor()'s phase along y and x, cycles/m.

        Each slope is the difference over `spacing` metres around a position.
        """
        ends = [
            (
                self._path_and_amplitude(y + h * a, x + h * b)[0]
                - self._path_and_amplitude(y - h * a, x - h * b)[0]
            )
            for h, a, b in ((spacing / 2, 1, 0), (spacing / 2, 0, 1))
        ]
        return ends[0] / (spacing * self.wavelength), ends[1] / (spacing * self.wavelength)

    def largest_phase_slope(self, half_diagonal: float) -> float:
        """Return the steepest phase slope on a panel, rad/m.

        half_diagonal: metres from the panel's middle to its corner.
        """
        line = torch.linspace(-half_diagonal, half_diagonal, 65, dtype=torch.float64)
        path, _ = self.numeric._path_and_amplitude(line[:, None], line[None, :])
        step = max(float(path.diff(dim=axis).abs().max()) for axis in (0, 1))
        return (
            2
            * math.sqrt(2)
            * math.pi
            / as_number(self.wavelength)
            * step
            / (2 * half_diagonal / 64)
        )

    @property
    def numeric(self) -> SphericalWaveCorrection:
        """The same wave in plain numbers, without derivatives."""
        return cast(SphericalWaveCorrection, to_plain_numbers(self))


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
