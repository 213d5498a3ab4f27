"""Compute the PSF of light of several wavelengths, as a weighted sum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch

from optics.camera import Camera, Lens
from optics.plane import Plane
from optics.psf.operator import PSFOperator
from optics.validation import accepts_numpy


class PolychromaticPSF:
    """Computes the incoherent PSF of light of several wavelengths, a weighted sum of intensities.

    Call it with phases (wavelengths, ..., rows, columns), because a panel's phase differs with the
    wavelength, or with nothing. Each wavelength keeps the tolerance of its PSFOperator, and so does
    their sum.

    Parameters
    ----------
    optics : Camera or Lens
        What forms the image.
    distance : float or 0-d torch.Tensor
        Metres from the object to the panel, or to a lens that stands alone; ``math.inf`` is
        allowed.
    wavelengths : sequence of float
        Metres, at least one.
    weights : sequence of float
        One for each wavelength, not negative. They are normalised to a sum of one.
    pixels : Plane
        The sensor pixels whose light is computed.
    **settings : Any
        Keyword arguments of every PSFOperator.

    Attributes
    ----------
    weights : tuple of float
        The normalised weights.
    operators : tuple of PSFOperator
        One for each wavelength.

    Raises
    ------
    ValueError
        Unless there is one weight for each wavelength, all finite and not negative and one of
        them positive. It also raises what PSFOperator raises.
    """

    def __init__(
        self,
        optics: Camera | Lens,
        distance: Any,
        wavelengths: Sequence[float],
        weights: Sequence[float],
        pixels: Plane,
        **settings: Any,
    ) -> None:
        _require_spectrum(wavelengths, weights)
        total = math.fsum(weights)
        self.weights = tuple(weight / total for weight in weights)
        self.operators = tuple(
            PSFOperator(optics, distance, wavelength, pixels, **settings)
            for wavelength in wavelengths
        )

    @accepts_numpy
    def __call__(self, phases: torch.Tensor | None = None) -> torch.Tensor:
        """Compute the PSF of a phase for each wavelength, or of no phase.

        The phases are (wavelengths, ..., rows, columns), the PSF is (..., *pixels.shape).
        """
        if phases is not None and phases.shape[0] != len(self.operators):
            raise ValueError(
                f"phases are {tuple(phases.shape)}; give one for each of the "
                f"{len(self.operators)} wavelengths"
            )
        parts = (
            weight * operator(None if phases is None else phases[number])
            for number, (weight, operator) in enumerate(
                zip(self.weights, self.operators, strict=True)
            )
        )
        return sum(parts, torch.zeros(()))


def _require_spectrum(wavelengths: Sequence[float], weights: Sequence[float]) -> None:
    if not len(wavelengths) == len(weights) >= 1:
        raise ValueError(
            f"there are {len(wavelengths)} wavelengths and {len(weights)} weights; "
            "give one weight for each, and one wavelength at least"
        )
    if not all(0 <= weight < math.inf for weight in weights) or not sum(weights) > 0:
        raise ValueError("weights must be finite and not negative, and one of them positive")
