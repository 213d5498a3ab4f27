"""The contract of all ways to compute a PSF."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from scipy.spatial import cKDTree

from optics.accuracy import FLOAT32_ARITHMETIC, FLOAT64_ARITHMETIC, CandidateMethod, ErrorEstimate
from optics.point.request import PSFRequest
from optics.validation import require_finite, rounded_up

_EPSILON = 4e-16

_SLOPE_MARGIN = 1.05
_SLOPE_SAMPLES, _NEIGHBOUR_COUNT = 3000, 7
"""Points at which a phase's slope is looked at, and how many of the nearest beside each."""


class PSFEngine(CandidateMethod):
    """A way to compute the light of a point, offered before it is prepared.

    An offer knows its bytes and its processor time without having made anything large;
    `prepare()` makes it, measures its error and raises ToleranceError if that is too much.
    `intensity()` then gives the share of the light on every sample, (..., rows, columns).

    name, sampling, precision: in words. error: of the sampling, once prepared.
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
        """How many samples at the sensor it computes."""
        rows, columns = self._request.samples.shape
        return rows * columns

    def _set_precision(self, double: bool) -> None:
        """Complex numbers in double or in single precision, and what that costs."""
        self._dtype = torch.complex128 if double else torch.complex64
        self.precision = "float64" if double else "float32"
        self.arithmetic = FLOAT64_ARITHMETIC if double else FLOAT32_ARITHMETIC

    @abstractmethod
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Metres (y, x) in the pupil where extra phases and amplitudes are wanted."""

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
        """Extra phase (radians) and amplitude as one complex factor; or None."""
        if phase is None and amplitude is None:
            return None
        factor: torch.Tensor | None = None
        if phase is not None:
            _require_sample_shape("phase", phase, samples)
            if phase.is_complex():
                raise ValueError(
                    f"phase is {phase.dtype}; it is real, in radians; amplitude may absorb"
                )
            # A phase of 1e5 waves keeps its fraction.
            angle = wrap_phase(phase.to(torch.float64)).to(dtype.to_real())
            factor = torch.polar(torch.ones_like(angle), angle)
        if amplitude is not None:
            _require_sample_shape("amplitude", amplitude, samples)
            strength = amplitude.to(dtype)
            factor = strength if factor is None else factor * strength
        return factor

    def require_phase_slope(self, phase: torch.Tensor | None) -> None:
        """Raise ValueError for a phase too steep for the nodes, which were chosen before."""
        if phase is None or not phase.numel():
            return
        q = self._request.numeric
        if self._neighbour_pairs is None:
            self._neighbour_pairs = NeighbourPairs(*(p / q.radius for p in self.points()))
        slope = self._neighbour_pairs.steepest_slope(phase.detach())
        if slope > _SLOPE_MARGIN * q.phase_slope:
            raise ValueError(
                f"phase turns by {slope:.3g} radians per stop radius, and {q.phase_slope:g} were "
                f"planned for; plan a PSFOperator with phase_slope={rounded_up(slope)}"
            )


class CachedPupilWave(ABC):
    """What has a point's light in a pupil: made at the first call and kept, unless somebody
    asks for derivatives, which would be lost with the tensors that they came from."""

    _request: PSFRequest
    _cached_wave: torch.Tensor | None = None

    @abstractmethod
    def _compute_pupil_wave(self) -> torch.Tensor:
        """The stop and the wave in it."""

    def _pupil_wave(self) -> torch.Tensor:
        if self._request.differentiable:
            return self._compute_pupil_wave()
        if self._cached_wave is None:
            self._cached_wave = self._compute_pupil_wave()
        return self._cached_wave


def wrap_phase(angle: torch.Tensor) -> torch.Tensor:
    """Radians from -pi to pi, with their derivative."""
    return angle - 2 * math.pi * torch.round(angle.detach() / (2 * math.pi))


class NeighbourPairs:
    """Pairs of points that lie close together, to tell how steep a phase is.

    y, x: in stop radii, one-dimensional, or a column and a row. Some points are looked at.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor) -> None:
        shape = (y + x).shape
        self._point_count = math.prod(shape)
        places = torch.stack([p.expand(shape).ravel() for p in (y, x)], dim=1).numpy()
        rng = np.random.default_rng(0)
        some = rng.choice(self._point_count, min(_SLOPE_SAMPLES, self._point_count), replace=False)
        found = cKDTree(places).query(places[some], k=min(_NEIGHBOUR_COUNT, self._point_count))
        away, near = (np.reshape(part, (some.size, -1))[:, 1:].copy() for part in found)
        self._distances, self._neighbour_indices = torch.from_numpy(away), torch.from_numpy(near)
        self._sampled_indices = torch.from_numpy(some)

    def steepest_slope(self, phase: torch.Tensor) -> float:
        """The steepest that is seen, radians per stop radius, of phases (..., points)."""
        flat = phase.cpu().to(torch.float64).reshape(-1, self._point_count)
        turn = wrap_phase(flat[:, self._neighbour_indices] - flat[:, self._sampled_indices, None])
        far = self._distances > 0
        return float((turn.abs() / self._distances)[:, far].max()) if far.any() else 0.0


def double_precision_error(request: PSFRequest) -> float:
    """Relative L2 error of an intensity in double precision: a phase of so many radians keeps
    no more digits than double precision leaves it."""
    return 10 * FLOAT64_ARITHMETIC + _EPSILON * request.numeric.phase_slope_bound.largest_slope(1.0)


def _require_sample_shape(name: str, value: torch.Tensor, samples: Sequence[int]) -> None:
    if tuple(value.shape[-len(samples) :]) != tuple(samples):
        raise ValueError(
            f"{name} is {tuple(value.shape)}; the pupil has {tuple(samples)} "
            f"{'pixels' if len(samples) == 2 else 'points'}"
        )
    require_finite(name, value)
