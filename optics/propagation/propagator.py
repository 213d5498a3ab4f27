"""The contract of all ways through free space."""

from __future__ import annotations

from abc import abstractmethod

import torch

from optics.accuracy import CandidateMethod, ErrorEstimate, MachineSpeed
from optics.propagation.precision import tolerance_below_error_floor
from optics.propagation.span import FreeSpaceSpan


class Propagator(CandidateMethod):
    """A linear map from samples on a span's source to the field on its target.

    An offer knows its bytes, its processor time and its error from sampling without having
    made anything large; it raises ToleranceError where it isn't valid, and `prepare()` makes
    what is kept. Then `forward()` and `adjoint()` may be called any number of times, with
    batches (..., rows, columns); forward is differentiable in the field and in the span's
    lengths.

    name, sampling, precision: in words. dtype: complex64 or complex128. error: L2 norm of the
    error from sampling on the target over the L2 norm of the field on the source, each weighed
    by its samples' area, at most: light that misses the target has its error as well.
    arithmetic: the same, from rounding.
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
        return "float64" if self.dtype == torch.complex128 else "float32"

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """The field on the target, (..., *target.shape), of one on the source."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """The conjugate transpose of forward(): from the target's samples to the source's."""
