"""Describe a phase pattern by numbers that an optimiser moves: of pixels, lines or a quarter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import torch

from optics.edof.phase_parametrisation import (
    PhaseParametrisation,
    RadialPhase,
    SumOfParts,
    depth_of_field_parts,
    mean_of_images,
    require_shape,
)
from optics.quarter_symmetry import crop_quarter, quarter_shape

__all__ = [
    "PARAMETRISATIONS",
    "FreePhase",
    "PhaseParametrisation",
    "QuarterPhase",
    "RadialPhase",
    "SeparablePhase",
    "SumOfParts",
    "depth_of_field_parts",
    "make_parametrisation",
]


@dataclass(frozen=True)
class FreePhase(PhaseParametrisation):
    """Describe a phase pattern by the phase of every pixel, row by row.

    Parameters
    ----------
    shape : tuple of (int, int)
        (rows, columns) of the panel.

    Raises
    ------
    ValueError
        If the shape isn't that of a panel.
    """

    shape: tuple[int, int]
    name: ClassVar[str] = "free"
    symmetry = "none"

    def __post_init__(self) -> None:
        require_shape(self.shape)

    @property
    def count(self) -> int:
        """Number of pixels of the phase pattern."""
        return self.shape[0] * self.shape[1]

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        return parameters.reshape(self.shape)

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        return phase.reshape(-1).clone()


@dataclass(frozen=True)
class QuarterPhase(PhaseParametrisation):
    """Describe a phase pattern by a quarter's pixels, which the other quarters mirror.

    The parameters are the phases of the quarter behind the centre of the pixels on both axes, row
    by row. The middle line of an odd number belongs to it.

    Parameters
    ----------
    shape : tuple of (int, int)
        (rows, columns) of the panel.

    Raises
    ------
    ValueError
        If the shape isn't that of a panel.
    """

    shape: tuple[int, int]
    name: ClassVar[str] = "quarter"
    symmetry = "quarter"

    def __post_init__(self) -> None:
        require_shape(self.shape)

    @property
    def count(self) -> int:
        """Number of pixels of a quarter of the phase pattern."""
        rows, columns = quarter_shape(self.shape)
        return rows * columns

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        return parameters.reshape(quarter_shape(self.shape))

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        return crop_quarter(mean_of_images(phase)).reshape(-1).clone()


@dataclass(frozen=True)
class SeparablePhase(PhaseParametrisation):
    """Describe a phase pattern as the sum of a phase of each row and one of each column.

    The parameters are the rows' phases and then the columns'; of a mirrored axis, those behind the
    centre, with the one nearest to it first. A constant may go from the rows' to the columns'
    without changing the pattern; `fit` gives both the same share of the mean.

    Parameters
    ----------
    shape : tuple of (int, int)
        (rows, columns) of the panel.
    mirrored_axes : tuple of (bool, bool), default (False, False)
        Whether the phases of the rows, and those of the columns, are mirrored about the centre.

    Raises
    ------
    ValueError
        If the shape isn't that of a panel.
    """

    shape: tuple[int, int]
    mirrored_axes: tuple[bool, bool] = (False, False)
    name: ClassVar[str] = "separable"
    symmetry = "separable"

    def __post_init__(self) -> None:
        require_shape(self.shape)

    @property
    def mirrored(self) -> bool:
        """Whether the separable phase pattern equals its mirror images in both axes."""
        return all(self.mirrored_axes)

    @property
    def count(self) -> int:
        """Number of phases of rows and columns that make the phase pattern."""
        return sum(self._counts)

    @property
    def _counts(self) -> list[int]:
        """Numbers of parameters of the phase pattern's rows and columns."""
        return [
            (pixels + 1) // 2 if mirrored else pixels
            for pixels, mirrored in zip(self.shape, self.mirrored_axes, strict=True)
        ]

    def _symmetric_phase(self, parameters: torch.Tensor) -> torch.Tensor:
        rows = self._counts[0]
        lines = [
            _mirror_line(line, pixels) if mirrored else line
            for line, pixels, mirrored in zip(
                (parameters[:rows], parameters[rows:]), self.shape, self.mirrored_axes, strict=True
            )
        ]
        return torch.cat(lines)

    def _fit(self, phase: torch.Tensor) -> torch.Tensor:
        axes = tuple(axis for axis in (0, 1) if self.mirrored_axes[axis])
        phase = mean_of_images(phase, axes)
        half_mean = phase.mean() / 2
        lines = (phase.mean(1) - half_mean, phase.mean(0) - half_mean)
        return torch.cat(
            [
                line[pixels // 2 :] if mirrored else line
                for line, pixels, mirrored in zip(
                    lines, self.shape, self.mirrored_axes, strict=True
                )
            ]
        )


def _mirror_line(half: torch.Tensor, pixels: int) -> torch.Tensor:
    """Mirror the second half of a line of a phase pattern's pixels about the line's centre."""
    return torch.cat([half[pixels % 2 :].flip(0), half])


PARAMETRISATIONS: Mapping[str, Callable[[tuple[int, int]], PhaseParametrisation]] = {
    "free": FreePhase,
    "quarter": QuarterPhase,
    "radial": RadialPhase,
    "separable": SeparablePhase,
    "separable-mirrored": lambda shape: SeparablePhase(shape, (True, True)),
}
"""The parametrisations that need no more than a panel's shape, by their names.

`SumOfParts` needs the parts.
"""


def make_parametrisation(name: str, shape: tuple[int, int]) -> PhaseParametrisation:
    """Return the parametrisation of a phase pattern by its name.

    Parameters
    ----------
    name : str
        One of PARAMETRISATIONS.
    shape : tuple of (int, int)
        (rows, columns) of the panel.

    Returns
    -------
    PhaseParametrisation
        The way to describe a pattern of that shape.

    Raises
    ------
    ValueError
        If there is no such name, or the shape isn't that of a panel.
    """
    if name not in PARAMETRISATIONS:
        raise ValueError(f"name is {name!r}; choose {', '.join(PARAMETRISATIONS)}")
    return PARAMETRISATIONS[name](shape)
