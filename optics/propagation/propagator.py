"""Define the interface of all free-space propagation methods."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.accuracy import CandidateMethod, ErrorEstimate, MachineSpeed
from optics.propagation.precision import tolerance_below_error_floor
from optics.propagation.span import FreeSpaceSpan


class Propagator(CandidateMethod):
    """Base class of all methods of free-space propagation: a linear map from source to target.

    It maps samples on a span's source to the field on its target. The constructor allocates
    nothing large. It computes the memory, the processor time and the sampling error, and raises
    ToleranceError where the method isn't valid. `prepare` computes what is kept between calls. Then
    `forward` and `adjoint` may be called any number of times, with batches (..., rows, columns).
    `forward` is differentiable in the field and in the span's lengths.

    Parameters
    ----------
    span : FreeSpaceSpan
        Describes the propagation.

    Attributes
    ----------
    name, sampling, precision : str
        The method, its sampling and its dtype in words.
    dtype : torch.dtype
        complex64 or complex128.
    error : ErrorEstimate
        Largest L2 norm of the error from sampling on the target over the L2 norm of the field on
        the source, each weighted by the area of its samples. Light that misses the target counts in
        the denominator.
    arithmetic : float
        The same ratio, for the error from rounding.

    Raises
    ------
    ToleranceError
        Where the method isn't valid for the span.
    """

    sampling: str
    dtype: torch.dtype
    error: ErrorEstimate
    arithmetic: float

    def __init__(self, span: FreeSpaceSpan) -> None:
        self.span = span

    def _require_parallel(self) -> None:
        """Raise ValueError if the propagation's source and target plane aren't parallel."""
        if any(self.span.tilt):
            raise ValueError(
                f"tilt is {self.span.tilt} rad; {self.name} needs parallel planes, a target that "
                "faces the source: use the tilted angular spectrum or direct quadrature"
            )

    def _set_error_bound(self, error: float, share: float, model: float) -> None:
        """Set the propagator's error bound, or raise ToleranceError if it exceeds the tolerance.

        The exception names the least tolerance that can be kept. share: the share of any tolerance
        that sampling may use. model: the error of the paraxial model, which doesn't decrease with
        the tolerance.
        """
        self.error, tol = ErrorEstimate(error, "bound"), self.span.tol
        if not error + self.arithmetic <= tol:
            raise tolerance_below_error_floor(tol, share, self.arithmetic + model)

    def _slowness(self, speed: MachineSpeed) -> float:
        """Return the time of an operation in this propagator's dtype over that in complex64."""
        return speed.double if self.dtype == torch.complex128 else 1.0

    @property
    def rounding_share(self) -> float:
        """Return the largest share of a propagation's rounding errors that are on the target.

        The share is of their power. Rounding errors are uncorrelated between samples, so that they
        spread over all of the light's range, and a small or dim target gets few of them.
        """
        return 1.0

    @property
    def precision(self) -> str:
        """Return the name of the propagator's floating-point precision."""
        return "float64" if self.dtype == torch.complex128 else "float32"

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Propagate a field from the source to the target, ``(..., *target.shape)``."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of the propagation, from target to source samples."""
