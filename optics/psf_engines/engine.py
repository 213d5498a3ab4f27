"""Define PSFEngine, the interface of all methods that compute a PSF."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from optics.accuracy import FLOAT32_ARITHMETIC, FLOAT64_ARITHMETIC, CandidateMethod, ErrorEstimate
from optics.psf_engines.request import PSFRequest
from optics.validation import require_finite, rounded_up


@dataclass(frozen=True)
class PhaseSlopeSettings:
    """Tune the check that a phase isn't too steep for a PSF engine's quadrature nodes.

    Attributes
    ----------
    margin : float
        Factor by which a phase may be steeper than planned. Chosen.
    samples : int
        Points at which the slope is evaluated. Chosen.
    neighbours : int
        Nearest points to each of them, itself included, to which slopes are measured. Chosen.
    """

    margin: float = 1.05
    samples: int = 3000
    neighbours: int = 7


_SLOPE_SETTINGS = PhaseSlopeSettings()


class PSFEngine(CandidateMethod):
    """Computes the light of a point on the sensor; the base class of all PSF methods.

    An engine states its memory and processor time before it allocates anything large. `prepare()`
    allocates it, measures the error, and raises ToleranceError if the error is too large. Then
    `intensity()` returns the share of the light on every sample, (..., rows, columns).

    name, sampling, precision: descriptions in words. error: of the sampling; known after
    `prepare()`. arithmetic: relative L2 error from rounding.
    """

    sampling: str
    precision: str
    error: ErrorEstimate
    arithmetic: float
    _dtype: torch.dtype
    _request: PSFRequest
    _neighbour_pairs: NeighbourPairs | None = None

    @property
    def sample_count(self) -> int:
        """The number of samples at the sensor that the PSF engine computes."""
        rows, columns = self._request.samples.shape
        return rows * columns

    def _set_precision(self, double: bool) -> None:
        """Set the PSF engine's complex type to double or single, and its rounding error."""
        self._dtype = torch.complex128 if double else torch.complex64
        self.precision = "float64" if double else "float32"
        self.arithmetic = FLOAT64_ARITHMETIC if double else FLOAT32_ARITHMETIC

    @abstractmethod
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the pupil points (y, x), in metres, where the PSF engine samples a pattern."""

    @abstractmethod
    def intensity(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor: ...

    def modulation_factor(
        self,
        phase: torch.Tensor | None,
        amplitude: torch.Tensor | None,
        samples: Sequence[int],
        dtype: torch.dtype = torch.complex128,
    ) -> torch.Tensor | None:
        """Return a pattern as one complex factor for the PSF engine, or None without a pattern.

        The factor is the amplitude times exp(i phase), with the phase in radians.
        """
        if phase is None and amplitude is None:
            return None
        factor: torch.Tensor | None = None
        if phase is not None:
            _require_sample_shape("phase", phase, samples)
            if phase.is_complex():
                raise ValueError(
                    f"phase is {phase.dtype}; it is real, in radians; amplitude may absorb"
                )
            # Wrapping in float64 keeps the fraction of a wave of a phase of 1e5 waves.
            angle = wrap_phase(phase.to(torch.float64)).to(dtype.to_real())
            factor = torch.polar(torch.ones_like(angle), angle)
        if amplitude is not None:
            _require_sample_shape("amplitude", amplitude, samples)
            strength = amplitude.to(dtype)
            factor = strength if factor is None else factor * strength
        return factor

    def require_phase_slope(self, phase: torch.Tensor | None) -> None:
        """Raise ValueError for a phase too steep for the PSF engine's planned quadrature nodes."""
        if phase is None or not phase.numel():
            return
        q = self._request.numeric
        if self._neighbour_pairs is None:
            self._neighbour_pairs = NeighbourPairs(*(p / q.radius for p in self.points()))
        slope = self._neighbour_pairs.steepest_slope(phase.detach())
        if slope > _SLOPE_SETTINGS.margin * q.phase_slope:
            raise ValueError(
                f"phase turns by {slope:.3g} radians per stop radius, and {q.phase_slope:g} were "
                f"planned for; plan a PSFOperator with phase_slope={rounded_up(slope)}"
            )


class CachedPupilWave(ABC):
    """Computes a point's wave in the pupil at the first call and caches it.

    With derivatives the wave is computed at every call, because a cached tensor would belong to the
    graph of an earlier call.
    """

    _request: PSFRequest
    _cached_wave: torch.Tensor | None = None

    @abstractmethod
    def _compute_pupil_wave(self) -> torch.Tensor:
        """Compute the object point's wave in the pupil, behind the stop, for the PSF engine."""

    def _pupil_wave(self) -> torch.Tensor:
        if self._request.differentiable:
            return self._compute_pupil_wave()
        if self._cached_wave is None:
            self._cached_wave = self._compute_pupil_wave()
        return self._cached_wave


def wrap_phase(angle: torch.Tensor) -> torch.Tensor:
    """Wrap a PSF engine's phase to -pi to pi radians without changing its derivative."""
    return angle - 2 * math.pi * torch.round(angle.detach() / (2 * math.pi))


class NeighbourPairs:
    """Finds pairs of neighbouring points in the pupil, to measure how steep a phase is.

    y, x: in stop radii, one-dimensional, or a column and a row. A random sample of points is used.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor) -> None:
        shape = (y + x).shape
        self._point_count = math.prod(shape)
        places = torch.stack([p.expand(shape).ravel() for p in (y, x)], dim=1).numpy()
        rng = np.random.default_rng(0)
        count = min(_SLOPE_SETTINGS.samples, self._point_count)
        some = rng.choice(self._point_count, count, replace=False)
        neighbours = min(_SLOPE_SETTINGS.neighbours, self._point_count)
        found = cKDTree(places).query(places[some], k=neighbours)
        away, near = (np.reshape(part, (some.size, -1))[:, 1:].copy() for part in found)
        self._distances, self._neighbour_indices = torch.from_numpy(away), torch.from_numpy(near)
        self._sampled_indices = torch.from_numpy(some)

    def steepest_slope(self, phase: torch.Tensor) -> float:
        """Return a phase's steepest slope between the PSF engine's nodes, rad per stop radius.

        phase: (..., points).
        """
        flat = phase.cpu().to(torch.float64).reshape(-1, self._point_count)
        turn = wrap_phase(flat[:, self._neighbour_indices] - flat[:, self._sampled_indices, None])
        far = self._distances > 0
        return float((turn.abs() / self._distances)[:, far].max()) if far.any() else 0.0


def double_precision_error(request: PSFRequest) -> float:
    """Return the relative L2 rounding error of a PSF engine in double precision.

    The larger the phase in radians, the fewer digits of its fraction double precision holds.
    """
    slope = request.numeric.phase_slope_bound.largest_slope(1.0)
    return 10 * FLOAT64_ARITHMETIC + 4e-16 * slope


def _require_sample_shape(name: str, value: torch.Tensor, samples: Sequence[int]) -> None:
    if tuple(value.shape[-len(samples) :]) != tuple(samples):
        raise ValueError(
            f"{name} is {tuple(value.shape)}; the pupil has {tuple(samples)} "
            f"{'pixels' if len(samples) == 2 else 'points'}"
        )
    require_finite(name, value)
