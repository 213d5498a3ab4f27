"""The contract of all ways to compute a PSF."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from scipy.spatial import cKDTree

from optics.accuracy import FLOAT32_ARITHMETIC, FLOAT64_ARITHMETIC, ErrorEstimate, Offer
from optics.edge import require_finite, rounded_up
from optics.point.question import Question

_EPSILON = 4e-16

_SLOPE_TO_SPARE = 1.05
_LOOKED_AT, _NEAREST = 3000, 7
"""Points at which a phase's slope is looked at, and how many of the nearest beside each."""


class Engine(Offer):
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
    _question: Question
    _neighbours: Neighbours | None = None

    @property
    def samples(self) -> int:
        """How many samples at the sensor it computes."""
        rows, columns = self._question.samples.shape
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

    def modulation(
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
            _require_samples("phase", phase, samples)
            if phase.is_complex():
                raise ValueError(
                    f"phase is {phase.dtype}; it is real, in radians; amplitude may absorb"
                )
            # A phase of 1e5 waves keeps its fraction.
            angle = within_a_turn(phase.to(torch.float64)).to(dtype.to_real())
            factor = torch.polar(torch.ones_like(angle), angle)
        if amplitude is not None:
            _require_samples("amplitude", amplitude, samples)
            strength = amplitude.to(dtype)
            factor = strength if factor is None else factor * strength
        return factor

    def require_slope(self, phase: torch.Tensor | None) -> None:
        """Raise ValueError for a phase too steep for the nodes, which were chosen before."""
        if phase is None or not phase.numel():
            return
        q = self._question.numeric
        if self._neighbours is None:
            self._neighbours = Neighbours(*(p / q.radius for p in self.points()))
        slope = self._neighbours.slope(phase.detach())
        if slope > _SLOPE_TO_SPARE * q.phase_slope:
            raise ValueError(
                f"phase turns by {slope:.3g} radians per stop radius, and {q.phase_slope:g} were "
                f"planned for; plan a PSFOperator with phase_slope={rounded_up(slope)}"
            )


class Lit(ABC):
    """What has a point's light in a pupil: made at the first call and kept, unless somebody
    asks for derivatives, which would be lost with the tensors that they came from."""

    _question: Question
    _kept: torch.Tensor | None = None

    @abstractmethod
    def _made_wave(self) -> torch.Tensor:
        """The stop and the wave in it."""

    def _wave(self) -> torch.Tensor:
        if self._question.differentiable:
            return self._made_wave()
        if self._kept is None:
            self._kept = self._made_wave()
        return self._kept


def within_a_turn(angle: torch.Tensor) -> torch.Tensor:
    """Radians from -pi to pi, with their derivative."""
    return angle - 2 * math.pi * torch.round(angle.detach() / (2 * math.pi))


class Neighbours:
    """Pairs of points that lie close together, to tell how steep a phase is.

    y, x: in stop radii, one-dimensional, or a column and a row. Some points are looked at.
    """

    def __init__(self, y: torch.Tensor, x: torch.Tensor) -> None:
        shape = (y + x).shape
        self._points = math.prod(shape)
        places = torch.stack([p.expand(shape).ravel() for p in (y, x)], dim=1).numpy()
        rng = np.random.default_rng(0)
        some = rng.choice(self._points, min(_LOOKED_AT, self._points), replace=False)
        found = cKDTree(places).query(places[some], k=min(_NEAREST, self._points))
        away, near = (np.reshape(part, (some.size, -1))[:, 1:].copy() for part in found)
        self._away, self._near = torch.from_numpy(away), torch.from_numpy(near)
        self._some = torch.from_numpy(some)

    def slope(self, phase: torch.Tensor) -> float:
        """The steepest that is seen, radians per stop radius, of phases (..., points)."""
        flat = phase.cpu().to(torch.float64).reshape(-1, self._points)
        turn = within_a_turn(flat[:, self._near] - flat[:, self._some, None])
        far = self._away > 0
        return float((turn.abs() / self._away)[:, far].max()) if far.any() else 0.0


def double_arithmetic(question: Question) -> float:
    """Relative L2 error of an intensity in double precision: a phase of so many radians keeps
    no more digits than double precision leaves it."""
    return 10 * FLOAT64_ARITHMETIC + _EPSILON * question.numeric.steepness.along(1.0)


def _require_samples(name: str, value: torch.Tensor, samples: Sequence[int]) -> None:
    if tuple(value.shape[-len(samples) :]) != tuple(samples):
        raise ValueError(
            f"{name} is {tuple(value.shape)}; the pupil has {tuple(samples)} "
            f"{'pixels' if len(samples) == 2 else 'points'}"
        )
    require_finite(name, value)
