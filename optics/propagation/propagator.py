"""The contract of all ways through free space."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.accuracy import CandidateMethod, ErrorEstimate, MachineSpeed
from optics.propagation.precision import tolerance_below_error_floor
from optics.propagation.span import FreeSpaceSpan


class Propagator(CandidateMethod):
    """Base class of all methods of free-space propagation: a linear map from source to target.

    It maps samples on a span's source to the field on its target. Before `prepare`, a propagator
    knows its bytes, its processor time and its error from sampling, without having made anything
    large; its constructor raises ToleranceError where the method isn't valid. `prepare` makes what
    is kept. Then `forward` and `adjoint` may be called any number of times, with batches
    (..., rows, columns). `forward` is differentiable in the field and in the span's lengths.

    Parameters
    ----------
    span : FreeSpaceSpan
        The propagation as data.

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
        """Raise ValueError for planes that aren't parallel."""
        if any(self.span.tilt):
            raise ValueError(
                f"tilt is {self.span.tilt} rad; {self.name} needs parallel planes, a target that "
                "faces the source: use the tilted angular spectrum or direct quadrature"
            )

    def _set_error_bound(self, error: float, share: float, model: float) -> None:
        """Set the error, or raise ToleranceError with the least tolerance that can be kept.

        share: of the tolerance, whatever it is, that sampling may use; model: what a paraxial
        method leaves out, which doesn't become less with it.
        """
        self.error, tol = ErrorEstimate(error, "bound"), self.span.tol
        if not error + self.arithmetic <= tol:
            raise tolerance_below_error_floor(tol, share, self.arithmetic + model)

    def _slowness(self, speed: MachineSpeed) -> float:
        """How much longer than in single precision an operation takes."""
        return speed.double if self.dtype == torch.complex128 else 1.0

    @property
    def precision(self) -> str:
        """The name of the dtype."""
        return "float64" if self.dtype == torch.complex128 else "float32"

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Compute the field on the target, (..., *target.shape), of a field on the source."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose of `forward`, from the target's samples to the source's."""
