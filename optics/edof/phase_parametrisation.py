"""Describe a phase pattern by numbers: what all ways of doing it have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import torch

from optics.plane import Plane
from optics.quarter_symmetry import crop_quarter, mirror_quarter
from optics.validation import accepts_numpy, as_floating_point, require_finite, require_tensor


class PhaseParametrisation(ABC):
    """Describe how parameters, which an optimiser moves, make a phase pattern on a panel.

    The phase is linear in the parameters and differentiable by torch. It has the parameters' type,
    float32 or float64, and device, and it isn't wrapped.

    Attributes
    ----------
    shape : tuple of (int, int)
        (rows, columns) of the panel.
    count : int
        Number of parameters.
    symmetry : {"none", "quarter", "separable"}
        What the phase's short form is: the whole phase; a quarter of it, which the other quarters
        mirror about the centre of the pixels; or the phases of all rows and then of all columns,
        whose sums are the phase.
    mirrored : bool
        Whether the phase equals its mirror images in both axes, bit for bit.
    """

    name: ClassVar[str]
    symmetry: str
    shape: tuple[int, int]

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of parameters of the phase pattern."""

    @property
    def mirrored(self) -> bool:
        """Whether the phase pattern equals its mirror images in both axes, bit for bit."""
        return self.symmetry == "quarter"

    @accepts_numpy
    def phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the phase pattern on the whole panel.

        Parameters
        ----------
        parameters : torch.Tensor or numpy.ndarray, (count,)
            float32 or float64.

        Returns
        -------
        torch.Tensor or numpy.ndarray, (rows, columns)
            Phase in radians.

        Raises
        ------
        ValueError
            If there is another number of parameters.
        """
        short = self.symmetric_phase(parameters)
        if self.symmetry == "quarter":
            return mirror_quarter(short, self.shape)
        if self.symmetry == "separable":
            y, x = short[: self.shape[0]], short[self.shape[0] :]
            return y[:, None] + x[None, :]
        return short

    @accepts_numpy
    def symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the short form of the phase pattern that its symmetry allows.

        Parameters
        ----------
        parameters : torch.Tensor or numpy.ndarray, (count,)
            float32 or float64.

        Returns
        -------
        torch.Tensor or numpy.ndarray
            Phase in radians: (rows, columns) for the symmetry "none", (ceil(rows / 2),
            ceil(columns / 2)) for "quarter", with the pixel nearest to the centre first, and
            (rows + columns,) for "separable".

        Raises
        ------
        ValueError
            If there is another number of parameters.
        """
        require_tensor("parameters", parameters)
        if tuple(parameters.shape) != (self.count,):
            raise ValueError(
                f"parameters is {tuple(parameters.shape)}; {self.name} has ({self.count},) for a "
                f"panel of {self.shape[1]} x {self.shape[0]} pixels"
            )
        return self._symmetric_phase(as_floating_point(parameters))

    @accepts_numpy
    def quarter_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute a quarter of a mirrored phase pattern, which the others mirror.

        Parameters
        ----------
        parameters : torch.Tensor or numpy.ndarray, (count,)
            float32 or float64.

        Returns
        -------
        torch.Tensor or numpy.ndarray, (ceil(rows / 2), ceil(columns / 2))
            Phase in radians, the pixel nearest to the centre first.

        Raises
        ------
        ValueError
            If the pattern isn't mirrored, or there is another number of parameters.
        """
        if not self.mirrored:
            raise ValueError(
                f"{self.name} doesn't mirror its phase in both axes, so that a quarter isn't all "
                "of it; take phase() or symmetric_phase()"
            )
        short = self.symmetric_phase(parameters)
        return short if self.symmetry == "quarter" else crop_quarter(self.phase(parameters))

    @accepts_numpy
    def fit(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the parameters whose phase pattern is nearest to a given one.

        Nearest means the least sum of squared differences over the panel's pixels. The phase must
        not be wrapped: a jump of a whole wave is a difference too.

        Parameters
        ----------
        phase : torch.Tensor or numpy.ndarray, (rows, columns)
            Radians, unwrapped.

        Returns
        -------
        torch.Tensor or numpy.ndarray, (count,)
            Of the phase's type, float32 or float64; computed in float64.

        Raises
        ------
        ValueError
            If the phase has another shape, or isn't finite.
        """
        require_tensor("phase", phase)
        if tuple(phase.shape) != self.shape:
            raise ValueError(f"phase is {tuple(phase.shape)} pixels; the panel has {self.shape}")
        require_finite("phase", phase)
        given = as_floating_point(phase.detach())
        return self._fit(given.to(torch.float64)).to(given.dtype)

    @abstractmethod
    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        """Compute the short form of the phase pattern from parameters of the right number."""

    @abstractmethod
    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        """Compute the parameters nearest to a finite float64 phase of the panel's shape."""


def require_shape(shape: tuple[int, int]) -> None:
    """Raise ValueError unless a shape is the (rows, columns) of a panel."""
    if len(shape) != 2:
        raise ValueError(f"shape is {shape}; give (rows, columns)")
    Plane(shape, (1.0, 1.0))


def mean_of_images(phase: torch.Tensor, axes: tuple[int, ...] = (0, 1)) -> torch.Tensor:
    """Compute the mean of a phase pattern and its mirror images in axes.

    Among the patterns that are mirrored in these axes it is the nearest.
    """
    for axis in axes:
        phase = (phase + phase.flip(axis)) / 2
    return phase
