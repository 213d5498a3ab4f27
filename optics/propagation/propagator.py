"""The interface of all methods of free space, their precision and their shares of the tolerance."""

from __future__ import annotations

import math
from abc import abstractmethod

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    CandidateMethod,
    ErrorEstimate,
    unreachable_tolerance_error,
)
from optics.propagation.span import FreeSpaceSpan


class Share:
    """Shares of the tolerance that each source of error may use, all chosen.

    No method uses all of them at once.
    """

    BAND = 0.4  # for the light that a spectral method cuts off, and the light of replicas
    TRANSFORM = 0.05  # for each of the two Fourier transforms of a method
    SPECTRAL = BAND + 2 * TRANSFORM  # for all sampling errors of a spectral method
    # For the samples of a Fresnel method: replicas that pass close to the target, or a cell's
    # envelope between its interpolation nodes.
    SAMPLING = 0.2
    REPLICA = 0.05  # for each of the four nearest replicas of a smooth field in a Fresnel method
    MODEL = 0.3  # for what a paraxial method leaves out of a scalar wave
    CHIRP_ROUNDING = 0.2  # for the rounding of the long chirps of the two-step Fresnel method
    SINGLE_PRECISION = 0.5  # for the rounding of a computation in complex64
    # For one axis of the direct quadrature: the nearest replica of a smooth field, or the
    # Gauss-Legendre rule inside a cell.
    DIRECT = 0.05
    # For the light of a smooth field outside its declared band or at the edges of the source.
    SMOOTH_FIELD = 0.5


FIELD32_ARITHMETIC = 1e-6
"""Relative L2 error of a field after two complex64 transforms, with phases computed in float64.

It was measured against complex128 and multiplied by a margin of two.
"""


def phase_rounding(turns: float) -> float:
    """Return the rounding error in radians of a float64 phase of `turns` turns."""
    # The relative error of such a phase is half a unit in the last place, twice.
    return 2 * math.pi * turns * 2.3e-16


def working_precision(
    tol: float, turns: float, share: float = 0.0, *, double: bool = False
) -> tuple[torch.dtype, float]:
    """Return the dtype of a field, and its relative L2 error from rounding.

    turns: the largest phase in turns, computed in float64. share: the share of the tolerance that
    sampling may use. double: whether complex64 is excluded. Raises ToleranceError if neither
    precision keeps the tolerance.
    """
    phase, most = phase_rounding(turns), min(Share.SINGLE_PRECISION, 1 - share)
    if not double and most * tol > FIELD32_ARITHMETIC:
        dtype, error = torch.complex64, max(FIELD32_ARITHMETIC, phase)
    else:
        dtype, error = torch.complex128, max(FLOAT64_ARITHMETIC, phase)
    if not error < tol * (1 - share):
        raise unreachable_tolerance_error(tol, error / (1 - share))
    return dtype, error


class Propagator(CandidateMethod):
    """Base class of all methods of free space: a linear map from source to target.

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
    search_calls : int
        Total processor time, in function calls, below which another method isn't compared with
        this one, because comparing takes time as well. The search for a two-step plane takes as
        long as ten calls, and the tilted angular spectrum is hardly ever the fastest between
        parallel planes.
    rounding_share : float
        Largest share of the rounding errors' power that is on the target. They are uncorrelated
        between samples, so that they spread over all of the light's range, and a small or dim
        target gets few of them.

    Raises
    ------
    ToleranceError
        Where the method isn't valid for the span.
    """

    sampling: str
    dtype: torch.dtype
    error: ErrorEstimate
    arithmetic: float
    search_calls: int = 0
    rounding_share: float = 1.0

    def __init__(self, span: FreeSpaceSpan) -> None:
        self.span = span

    def _require_parallel(self) -> None:
        """Raise ValueError if source and target plane aren't parallel."""
        if any(self.span.tilt):
            raise ValueError(
                f"tilt is {self.span.tilt} rad; {self.name} needs parallel planes, a target that "
                "faces the source: use the tilted angular spectrum or direct quadrature"
            )

    def _set_error_bound(self, error: float, share: float, model: float) -> None:
        """Set the bound of the error, or raise ToleranceError if it exceeds the tolerance.

        share: the share of any tolerance that sampling may use. model: the error of the paraxial
        model, which doesn't decrease with the tolerance.
        """
        self.error, tol = ErrorEstimate(error, "bound"), self.span.tol
        if not error + self.arithmetic <= tol:
            raise unreachable_tolerance_error(tol, (self.arithmetic + model) / (1 - share))

    @property
    def precision(self) -> str:
        """The name of the floating-point precision."""
        return "float64" if self.dtype == torch.complex128 else "float32"

    @abstractmethod
    def forward(self, field: torch.Tensor) -> torch.Tensor:
        """Compute the field on the target, ``(..., *target.shape)``, from the source's samples."""

    @abstractmethod
    def adjoint(self, field: torch.Tensor) -> torch.Tensor:
        """Apply the conjugate transpose, from target to source samples."""
