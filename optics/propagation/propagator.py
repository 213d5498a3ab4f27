"""The interface of all methods of free space, their precision and their shares of the tolerance."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import torch

from optics.accuracy import (
    FLOAT64_ARITHMETIC,
    CandidateMethod,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    unreachable_tolerance_error,
)
from optics.propagation.span import FreeSpaceSpan


@dataclass(frozen=True)
class PropagationToleranceShares:
    """Set which share of the tolerance each source of error may use.

    All fields are shares of `tol`, between 0 and 1, and all values are chosen. No method uses all
    of them at once.

    band: for the light that a spectral method cuts off, and the light of replicas.
    transform: for each of the two Fourier transforms of a method.
    sampling: for the samples of a Fresnel method: replicas that pass close to the target, or a
        cell's envelope between its interpolation nodes.
    replica: for each of the four nearest replicas of a smooth field in a Fresnel method.
    model: for what a paraxial method leaves out of a scalar wave.
    chirp_rounding: for the rounding of the long chirps of the two-step Fresnel method.
    single_precision: for the rounding of a computation in complex64.
    direct: for one axis of the direct quadrature: the nearest replica of a smooth field, or the
        Gauss-Legendre rule inside a cell.
    smooth_field: for the light of a smooth field that lies outside its declared band or at the
        edges of the source.
    """

    band: float = 0.4
    transform: float = 0.05
    sampling: float = 0.2
    replica: float = 0.05
    model: float = 0.3
    chirp_rounding: float = 0.2
    single_precision: float = 0.5
    direct: float = 0.05
    smooth_field: float = 0.5

    @property
    def spectral(self) -> float:
        """The share of all sampling errors of a spectral method."""
        return self.band + 2 * self.transform


TOLERANCE_SHARES = PropagationToleranceShares()


FIELD32_ARITHMETIC = 1e-6
"""Relative L2 error of a field after two complex64 transforms, with phases computed in float64.

It was measured against complex128 and multiplied by a margin of two.
"""


def phase_rounding(turns: float) -> float:
    """Return the rounding error in radians of a float64 phase of `turns` turns."""
    # The relative error of such a phase is half a unit in the last place, twice.
    return 2 * math.pi * turns * 2.3e-16


def tolerance_below_error_floor(tol: float, share: float, fixed: float) -> ToleranceError:
    """Return the ToleranceError that names the least tolerance that can be kept.

    share: the share of any tolerance that sampling may use. fixed: the error that doesn't decrease
    with the tolerance, which is that of rounding and of the paraxial model.
    """
    return unreachable_tolerance_error(tol, fixed / (1 - share))


def working_precision(
    tol: float, turns: float, share: float = 0.0, *, double: bool = False
) -> tuple[torch.dtype, float]:
    """Return the dtype of a field, and its relative L2 error from rounding.

    turns: the largest phase in turns; computed in float64, its error is `phase_rounding(turns)`.
    share: the share of the tolerance that sampling may use. double: whether complex64 is excluded.
    Raises ToleranceError if neither precision keeps the tolerance.
    """
    phase, most = phase_rounding(turns), min(TOLERANCE_SHARES.single_precision, 1 - share)
    if not double and most * tol > FIELD32_ARITHMETIC:
        dtype, error = torch.complex64, max(FIELD32_ARITHMETIC, phase)
    else:
        dtype, error = torch.complex128, max(FLOAT64_ARITHMETIC, phase)
    if not error < tol * (1 - share):
        raise tolerance_below_error_floor(tol, share, error)
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
        """Raise ValueError if source and target plane aren't parallel."""
        if any(self.span.tilt):
            raise ValueError(
                f"tilt is {self.span.tilt} rad; {self.name} needs parallel planes, a target that "
                "faces the source: use the tilted angular spectrum or direct quadrature"
            )

    def _set_error_bound(self, error: float, share: float, model: float) -> None:
        """Set the bound of the error, or raise ToleranceError if it exceeds the tolerance.

        The exception names the least tolerance that can be kept. share: the share of any tolerance
        that sampling may use. model: the error of the paraxial model, which doesn't decrease with
        the tolerance.
        """
        self.error, tol = ErrorEstimate(error, "bound"), self.span.tol
        if not error + self.arithmetic <= tol:
            raise tolerance_below_error_floor(tol, share, self.arithmetic + model)

    def _slowness(self, speed: MachineSpeed) -> float:
        """Return the time of an operation in this dtype over that in complex64."""
        return speed.double if self.dtype == torch.complex128 else 1.0

    @property
    def rounding_share(self) -> float:
        """The largest share of the rounding errors that are on the target.

        The share is of their power. Rounding errors are uncorrelated between samples, so that they
        spread over all of the light's range, and a small or dim target gets few of them.
        """
        return 1.0

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
