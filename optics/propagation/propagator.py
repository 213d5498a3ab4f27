"""The contract of all ways through free space."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from optics.accuracy import ErrorEstimate, MachineSpeed
from optics.propagation.span import Span


class Propagator(ABC):
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

    name: str
    sampling: str
    dtype: torch.dtype
    error: ErrorEstimate
    arithmetic: float

    def __init__(self, span: Span) -> None:
        self.span = span

    @property
    def precision(self) -> str:
        return "float64" if self.dtype == torch.complex128 else "float32"

    @property
    @abstractmethod
    def bytes(self) -> int: ...

    @abstractmethod
    def cpu_seconds(self, speed: MachineSpeed) -> float: ...

    @abstractmethod
    def prepare(self) -> None:
        """Make what is kept between calls."""

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """The field on the target, (..., *target.shape), of one on the source."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """The conjugate transpose of forward(): from the target's samples to the source's."""
