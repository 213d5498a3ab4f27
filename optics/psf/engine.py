"""The contract of all ways to compute a PSF."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch

from optics.accuracy import FLOAT64_ARITHMETIC, ErrorEstimate, MachineSpeed
from optics.edge import require_finite
from optics.psf.question import Question

_EPSILON = 4e-16


class Engine(ABC):
    """A way to compute the light of a point, offered before it is prepared.

    An offer knows its bytes and its processor time without having made anything large;
    `prepare()` makes it, measures its error and raises ToleranceError if that is too much.
    `intensity()` then gives the share of the light on every sample, (..., rows, columns).

    name, sampling, precision: in words. error: of the sampling, once prepared.
    """

    name: str
    sampling: str
    precision: str
    error: ErrorEstimate
    arithmetic: float

    @property
    @abstractmethod
    def bytes(self) -> int: ...

    @abstractmethod
    def cpu_seconds(self, speed: MachineSpeed) -> float: ...

    @abstractmethod
    def prepare(self) -> None: ...

    @abstractmethod
    def points(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Metres (y, x) in the pupil where extra phases and amplitudes are wanted."""

    @abstractmethod
    def intensity(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None
    ) -> torch.Tensor: ...

    def modulation(
        self, phase: torch.Tensor | None, amplitude: torch.Tensor | None, samples: Sequence[int]
    ) -> torch.Tensor | None:
        """Extra phase (radians) and amplitude as one complex factor, complex128; or None."""
        if phase is None and amplitude is None:
            return None
        factor: torch.Tensor | None = None
        if phase is not None:
            _require_samples("phase", phase, samples)
            angle = phase.to(torch.float64)
            # Reduced to half a turn, so that a phase of 1e5 waves keeps its fraction.
            angle = angle - (2 * math.pi) * torch.round(angle.detach() / (2 * math.pi))
            factor = torch.polar(torch.ones_like(angle), angle)
        if amplitude is not None:
            _require_samples("amplitude", amplitude, samples)
            strength = amplitude.to(torch.complex128)
            factor = strength if factor is None else factor * strength
        return factor


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
    require_finite(name, torch.view_as_real(value) if value.is_complex() else value)
