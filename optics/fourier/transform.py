"""What all transforms between two planes share: geometry, phases and derivatives."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import torch

from optics.accuracy import CandidateMethod, MachineSpeed
from optics.fourier.differentiation import Derivatives, ShapedMap, Term, apply_linear_map
from optics.plane import Plane, RectilinearGrid


def unit_phasor(turns: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """Compute the phasor exp(2 pi i turns), with the phase reduced to half a turn.

    The reduction is done in float64.

    Parameters
    ----------
    turns : torch.Tensor
        Phase in turns, float64.
    dtype : torch.dtype
        complex64 or complex128.

    Returns
    -------
    torch.Tensor
        The phasor, in `dtype`, of the shape of `turns`.
    """
    angle = 2 * math.pi * (turns - torch.round(turns.detach()))
    real = dtype.to_real()
    return torch.complex(torch.cos(angle).to(real), torch.sin(angle).to(real))


@dataclass(frozen=True)
class FourierGeometry:
    """The two planes of a transform, and the product of wavelength and distance.

    A pupil with unevenly spaced rows and columns has no step. Only matrix and gridded transforms
    accept it.

    Parameters
    ----------
    pupil : Plane or RectilinearGrid
        Where the field is known.
    image : Plane
        Where its transform is computed.
    scale : float
        Wavelength times distance in square metres, positive.

    Raises
    ------
    ValueError
        For a scale that isn't positive and finite.
    """

    pupil: Plane | RectilinearGrid
    image: Plane
    scale: float

    def __post_init__(self) -> None:
        if not 0 < self.scale < math.inf:
            raise ValueError(
                f"scale {self.scale} m² (wavelength x distance) must be positive and finite"
            )

    def step(self, axis: int) -> float:
        """Compute the phase in turns per pupil sample and image sample along axis 0 (y) or 1 (x).

        Raises ValueError for a pupil with unevenly spaced rows and columns.
        """
        if isinstance(self.pupil, RectilinearGrid):
            raise ValueError("a pupil of uneven rows has no step; use the gridded transform")
        return self.pupil.pitch[axis] * self.image.pitch[axis] / self.scale

    def pupil_offsets(self, axis: int) -> torch.Tensor:
        """Return the pupil's positions relative to its centre along an axis, metres, float64."""
        return self.pupil.coordinates(axis) - self.pupil.centre[axis]

    def pupil_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """Compute the phasors over the pupil that shift the image to its off-axis centre.

        There is one for each sample along the axis; None if the image is centred.
        """
        centre = self.image.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.pupil_offsets(axis) * centre / self.scale, dtype)

    def image_tilt(self, axis: int, dtype: torch.dtype) -> torch.Tensor | None:
        """Compute the phasors over the image for a pupil that is off-axis; None if it isn't."""
        centre = self.pupil.centre[axis]
        if centre == 0:
            return None
        return unit_phasor(-self.image.coordinates(axis) * centre / self.scale, dtype)


RETAINED_BYTES = 32 << 20
"""Bytes that an allocator keeps for the next call and that caches hold, so that they cost no
time."""

PASSES_PER_PHASOR = 50
"""Time to compute a phasor in double precision, over that of one pass over a sample; measured."""


class Transform(CandidateMethod):
    """Base class of all linear maps from the pupil to the image plane.

    It computes ::

        F(u, v) = sum over (y, x) of f(y, x) exp(-2 pi i (y u + x v) / scale).

    Call it with a field ``(..., *pupil samples)``; the result is (..., rows, columns). It is
    differentiable in the field.

    Attributes
    ----------
    name : str
        The method's name.
    error : float
        Relative L2 error beyond rounding.
    dtype : torch.dtype
        complex64 or complex128.
    image : Plane
        Where the transform is computed.
    scale : float
        Wavelength times distance in square metres.

    References
    ----------
    J. W. Goodman, Introduction to Fourier Optics; thesis Eq. 2.13 and 3.1.
    """

    error: float = 0.0
    dtype: torch.dtype
    image: Plane
    scale: float

    @abstractmethod
    def _forward(self, field: torch.Tensor) -> torch.Tensor:
        """Map a field without derivatives."""

    @abstractmethod
    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose without derivatives."""

    @abstractmethod
    def _require_samples(self, field: torch.Tensor) -> None:
        """Raise ValueError if a field's samples aren't the pupil's."""

    @abstractmethod
    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pupil's positions (y, x) in metres.

        The two arrays broadcast against a field.
        """

    def __call__(
        self,
        field: torch.Tensor,
        stretch: torch.Tensor | None = None,
        shift: tuple[torch.Tensor, torch.Tensor] | None = None,
    ) -> torch.Tensor:
        """Transform a field from the pupil to the image plane.

        field: ``(..., *pupil samples)``; the result is complex, (..., rows, columns) of the image.
        stretch, shift: 0-d tensors of the values 1 and (0, 0), given for their derivatives only,
            which are those of F(u, v) = sum of f(y, x)
            exp(-2 pi i stretch (y (u + shift_y) + x (v + shift_x)) / scale). The derivatives with
            respect to wavelength, distance, focal length and position follow from them.
        Raises ValueError for a field whose samples aren't those of the pupil.
        """
        self._require_samples(field)
        field = field.to(self.dtype)
        if stretch is None and shift is None:
            return apply_linear_map(self._forward, self._adjoint, field)
        zero = torch.zeros((), dtype=torch.float64)
        y, x = shift or (zero, zero)
        one = torch.ones_like(zero) if stretch is None else stretch
        return ShapedMap(self._forward, self._adjoint, self._derive)(field, (one, y, x))

    def _derive(self, same: ShapedMap) -> Derivatives:
        """Return the derivatives of the map in `stretch` and in both parts of `shift`."""
        y, x = (position * (-2j * math.pi / self.scale) for position in self.positions())
        u, v = (self.image.coordinates(axis) for axis in (0, 1))
        stretch: list[Term] = [(u[:, None], same, y), (v[None, :], same, x)]
        return [stretch, [(1.0, same, y)], [(1.0, same, x)]]

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose, from the image back to the pupil."""
        _require_shape(self.image, field)
        return apply_linear_map(self._adjoint, self._forward, field.to(self.dtype))


class PlaneTransform(Transform):
    """Base class of transforms from a pupil that is sampled on a grid."""

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        self.geometry, self.dtype = geometry, dtype
        self.image, self.scale = geometry.image, geometry.scale

    @abstractmethod
    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Transform along axis 0 (y) or 1 (x) only, without derivatives.

        field: complex, (..., rows, columns), of which `axis` has the samples of the pupil, and in
            the result those of the image. The other axis may have any length.
        """

    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self.geometry.pupil.mesh()

    def _require_samples(self, field: torch.Tensor) -> None:
        _require_shape(self.geometry.pupil, field)

    def allocation_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds that each call spends on new memory."""
        return max(self.bytes - RETAINED_BYTES, 0) * speed.fresh


def _require_shape(plane: Plane | RectilinearGrid, field: torch.Tensor) -> None:
    """Raise ValueError if a field's last axes aren't the samples of a plane."""
    if field.shape[-2:] != plane.shape:
        raise ValueError(f"field is {tuple(field.shape)}; its plane has {plane.shape} samples")
