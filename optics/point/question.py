"""What is asked of a PSF: a lens, a point, a wavelength, samples, a tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import torch

from optics.accuracy import Budget
from optics.camera import Lens
from optics.edge import as_number, numeric, recorded, require_same
from optics.plane import Plane
from optics.point.sphere import Sphere
from optics.pupil import Scalar, require_light, steepness
from optics.stop.quadrature import Steepness


@dataclass(frozen=True)
class Question:
    """A point's light behind a lens, sampled on a plane at the sensor.

    lens, distance, wavelength: SI; numbers, or 0-d tensors in which the answer shall be
    differentiable. samples: the plane; its centre may hold tensors. tol: relative L2 error
    of the intensity on the samples. margin: samples at each side that only help to integrate
    those inside. phase_slope: radians per stop radius by which phases that are added to a
    lens' wave may turn.

    separation: metres from a panel to the lens; `distance` is the object's from the panel.
    field: metres (y, x) on the sensor from the axis to the point's geometric image, around
    which the samples lie. sphere: what the point's wave over the panel has besides a parabola.
    pixel: metres (y, x) of the pixels over which the samples are integrated afterwards; 0 where
    the samples themselves are wanted.
    """

    lens: Lens
    distance: Scalar
    wavelength: Scalar
    samples: Plane
    tol: float
    budget: Budget
    margin: int = 0
    phase_slope: float = 0.0
    separation: Scalar = 0.0
    field: tuple[Scalar, Scalar] = (0.0, 0.0)
    sphere: Sphere | None = None
    pixel: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        require_light(as_number(self.distance), as_number(self.wavelength))

    @cached_property
    def numeric(self) -> Question:
        """The same in plain numbers."""
        return cast(Question, numeric(self))

    @property
    def inner(self) -> tuple[slice, slice]:
        """Rows and columns of the samples that aren't margin."""
        rows, columns = self.samples.shape
        return slice(self.margin, rows - self.margin), slice(self.margin, columns - self.margin)

    @property
    def spread(self) -> Scalar:
        """How much wider than the panel its shadow at the lens is, 1 + separation / distance."""
        return 1 + self.separation / self.distance

    @property
    def from_lens(self) -> Scalar:
        """Metres from the object to the lens."""
        return self.distance + self.separation

    @property
    def sines(self) -> tuple[Scalar, Scalar]:
        """Slopes (y, x) of the chief ray through the middle of the lens."""
        z = self.lens.image_distance
        return self.field[0] / z, self.field[1] / z

    @property
    def scale(self) -> Scalar:
        """Wavelength times image distance, m²."""
        return self.wavelength * self.lens.image_distance

    @property
    def radius(self) -> Scalar:
        """Of the stop, metres."""
        return self.lens.stop_diameter / 2

    @property
    def share(self) -> Scalar:
        """What turns |integral over the stop in stop radii|² into shares of the light a sample."""
        area = self.samples.pitch[0] * self.samples.pitch[1]
        return area * self.radius**2 / (self.scale**2 * self.lens.stop.area)

    @cached_property
    def farthest(self) -> float:
        """Metres from the axis to the farthest sample."""
        y, x = self.numeric.samples.mesh()
        return math.hypot(float(y.abs().max()), float(x.abs().max()))

    @cached_property
    def steepness(self) -> Steepness:
        """Of the wave in the stop and of the kernel towards the farthest sample."""
        n = self.numeric
        tilt = 2 * math.pi * n.radius * self.farthest / n.scale
        return steepness(n.lens, n.distance, n.wavelength, tilt + self.phase_slope)

    @property
    def derivatives(self) -> Derivatives:
        """How the pupil stretches and the image shifts with what is differentiable."""
        n = self.numeric
        stretch = (self.radius / n.radius) * (n.scale / self.scale)
        centre = self.samples.centre
        shift = None
        if any(recorded(c) for c in centre):
            shift = tuple(torch.as_tensor(c, dtype=torch.float64) - as_number(c) for c in centre)
        return Derivatives(stretch if recorded(stretch) else None, shift)  # type: ignore[arg-type]

    def require_unchanged(self) -> None:
        """Raise ValueError if a tensor has got another value since the plan was made."""
        names = ("lens", "distance", "wavelength", "samples", "separation", "field")
        require_same(names, self.numeric, replace(self).numeric, "PSFOperator")

    @property
    def differentiable(self) -> bool:
        """Whether any derivative is wanted."""
        lens = self.lens
        lengths = (self.distance, self.wavelength, lens.focal_length, lens.f_number)
        aberrations = (path for _, _, path in lens.aberrations)
        apart = (self.separation, *self.field)
        lengths = (*lengths, lens.focus_distance, *aberrations, *apart)
        return any(map(recorded, lengths)) or self.stretches

    @property
    def stretches(self) -> bool:
        """Whether derivatives are wanted that move the light on the samples."""
        moving = (self.scale, self.radius, *self.samples.centre)
        return any(recorded(value) for value in moving)


@dataclass(frozen=True)
class Derivatives:
    """The numbers 1 and (0, 0) of optics.fourier.Transform, with what they depend on."""

    stretch: torch.Tensor | None
    shift: tuple[torch.Tensor, torch.Tensor] | None
