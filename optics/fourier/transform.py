"""The base class of all Fourier transforms between two planes, and their derivatives."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import torch

from optics.accuracy import CandidateMethod, MachineSpeed
from optics.fourier.geometry import FourierGeometry
from optics.plane import Plane, RectilinearGrid

RETAINED_BYTES = 32 << 20
"""Bytes that an allocator keeps for the next call and that caches hold, so that they cost no
time."""

PASSES_PER_PHASOR = 50
"""Time to compute a phasor in double precision, over that of one pass over a sample; measured."""


class Transform(CandidateMethod):
    """Base class of all Fourier transforms: a linear map from the pupil to the image plane.

    It computes ::

        F(u, v) = sum over (y, x) of f(y, x) exp(-2 pi i (y u + x v) / scale).

    Call it with a field ``(..., *pupil samples)``; the result is (..., rows, columns). It is
    differentiable in the field. A transform is known by its name, its relative error beyond
    rounding, the bytes it takes, and its predicted processor time.

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
        """Apply the Fourier transform to a field, without derivatives."""

    @abstractmethod
    def _adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of the Fourier transform, without derivatives."""

    @abstractmethod
    def _require_samples(self, field: torch.Tensor) -> None:
        """Raise ValueError if a field's samples aren't those of the Fourier transform's pupil."""

    @abstractmethod
    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the Fourier transform's pupil positions (y, x) in metres.

        The two arrays broadcast against a field.
        """

    def __call__(
        self,
        field: torch.Tensor,
        stretch: torch.Tensor | None = None,
        shift: tuple[torch.Tensor, torch.Tensor] | None = None,
    ) -> torch.Tensor:
        """Transform a field from the pupil to the image plane.

        Parameters
        ----------
        field : torch.Tensor
            ``(..., *pupil samples)``.
        stretch : torch.Tensor, optional
            A 0-d tensor of value 1, given for its derivative only. The derivatives with respect to
            it and to `shift` are those of F(u, v) = sum of f(y, x)
            exp(-2 pi i stretch (y (u + shift_y) + x (v + shift_x)) / scale). The derivatives with
            respect to wavelength, distance, focal length and position follow from them.
        shift : tuple of torch.Tensor, optional
            Two 0-d tensors (y, x) of value 0, given for their derivatives only.

        Returns
        -------
        torch.Tensor
            Complex, (..., rows, columns) of the image.

        Raises
        ------
        ValueError
            For a field whose samples aren't those of the pupil.
        """
        self._require_samples(field)
        field = field.to(self.dtype)
        if stretch is None and shift is None and not _needs_gradient(field):
            return self._forward(field)
        zero = torch.zeros((), dtype=torch.float64)
        y, x = shift or (zero, zero)
        one = torch.ones_like(zero) if stretch is None else stretch
        return apply_function(_Forward, self, field, one, y, x)

    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the Fourier transform's conjugate transpose, from the image back to the pupil."""
        _require_shape(self.image, field)
        return apply_linear_map(self._adjoint, self._forward, field.to(self.dtype))


def _needs_gradient(field: torch.Tensor) -> bool:
    """Tell whether a Fourier transform of a field must record derivatives."""
    return field.requires_grad and torch.is_grad_enabled()


def apply_function(function: Any, *arguments: Any) -> torch.Tensor:
    """Call a Fourier transform's torch autograd function, which returns one tensor.

    This function exists because torch's `apply` has no type annotations.
    """
    answer: torch.Tensor = function.apply(*arguments)
    return answer


class _Forward(torch.autograd.Function):
    """The autograd function of a Fourier transform, whose derivative is the adjoint transform.

    With an explicit derivative, transforms may use libraries that have no autograd.
    """

    @staticmethod
    def forward(
        ctx: Any,
        transform: Transform,
        field: torch.Tensor,
        stretch: torch.Tensor,
        shift_y: torch.Tensor,
        shift_x: torch.Tensor,
    ) -> torch.Tensor:
        ctx.transform = transform
        ctx.save_for_backward(field, stretch, shift_y, shift_x)
        return transform._forward(field)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        transform: Transform = ctx.transform
        field, *numbers = ctx.saved_tensors
        answers: list[torch.Tensor | None] = [None] * 4
        if ctx.needs_input_grad[1]:
            answers[0] = transform._adjoint(gradient)
        if any(ctx.needs_input_grad[2:]):
            y, x = (
                _position_gradient(transform, field, p.to(field.device), gradient)
                for p in transform.positions()
            )
            u, v = (transform.image.coordinates(axis).to(y.device) for axis in (0, 1))
            found = (y * u[:, None]).sum() + (x * v[None, :]).sum(), y.sum(), x.sum()
            answers[1:] = [value.to(n) for n, value in zip(numbers, found, strict=True)]
        return (None, *answers)


def apply_linear_map(
    forward: Callable[[torch.Tensor], torch.Tensor],
    adjoint: Callable[[torch.Tensor], torch.Tensor],
    field: torch.Tensor,
) -> torch.Tensor:
    """Apply a linear map such as a Fourier transform, with its adjoint as the derivative."""
    if not _needs_gradient(field):
        return forward(field.detach())
    return apply_function(_Linear, forward, adjoint, field)


class _Linear(torch.autograd.Function):
    """The autograd function of a linear map, whose derivative is its adjoint."""

    @staticmethod
    def forward(ctx: Any, forward: Any, adjoint: Any, field: torch.Tensor) -> Any:
        ctx.adjoint, ctx.dtype = adjoint, field.dtype
        return forward(field)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: torch.Tensor) -> Any:
        return None, None, ctx.adjoint(gradient).to(ctx.dtype)


def _position_gradient(
    transform: Transform, field: torch.Tensor, position: torch.Tensor, gradient: torch.Tensor
) -> torch.Tensor:
    """Compute a loss' derivative by a shift of the Fourier transform's image, for each sample.

    `position` holds the pupil coordinates along the axis of the shift, and `gradient` is the
    gradient of the loss with respect to the transform.
    """
    moved = transform._forward((field * position).to(transform.dtype))
    turned = (-2j * math.pi / transform.scale) * moved.to(torch.complex128)
    change = (gradient.to(torch.complex128).conj() * turned).real
    return change.reshape(-1, *change.shape[-2:]).sum(0)


class PlaneTransform(Transform):
    """Base class of Fourier transforms from a pupil that is sampled on a grid."""

    def __init__(self, geometry: FourierGeometry, dtype: torch.dtype) -> None:
        self.geometry, self.dtype = geometry, dtype
        self.image, self.scale = geometry.image, geometry.scale

    @abstractmethod
    def forward_axis(self, field: torch.Tensor, axis: int) -> torch.Tensor:
        """Apply the Fourier transform along axis 0 (y) or 1 (x) only, without derivatives.

        Parameters
        ----------
        field : torch.Tensor
            Complex, (..., rows, columns), of which `axis` has the samples of the pupil. The other
            axis may have any length.
        axis : int
            0 (y) or 1 (x).

        Returns
        -------
        torch.Tensor
            The field with the samples of the image along `axis`.
        """

    def positions(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self.geometry.pupil.mesh()

    def _require_samples(self, field: torch.Tensor) -> None:
        _require_shape(self.geometry.pupil, field)

    def allocation_seconds(self, speed: MachineSpeed) -> float:
        """Predict the seconds that each call of the Fourier transform spends on new memory."""
        return max(self.bytes - RETAINED_BYTES, 0) * speed.fresh

    def precision_slowdown(self, speed: MachineSpeed) -> float:
        """Return the Fourier transform's time per operation relative to single precision."""
        return speed.double if self.dtype == torch.complex128 else 1.0


def _require_shape(plane: Plane | RectilinearGrid, field: torch.Tensor) -> None:
    """Raise ValueError if a field's last axes aren't the samples of a Fourier transform's plane."""
    if field.shape[-2:] != plane.shape:
        raise ValueError(f"field is {tuple(field.shape)}; its plane has {plane.shape} samples")
