"""The phases that iterations start from."""

from __future__ import annotations

import math

import torch

from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels

STARTS = ("smooth", "quadratic", "random")

_BUMPS = 12
"""Correlation length of the bumps, as a share of the panel's height."""

_HEIGHT = 0.5
"""Root mean square of the bumps, radians."""


def quadratic_start(goal: RetrievalGoal, pixels: Superpixels) -> torch.Tensor:
    """The lens that spreads light over the target's extent, (rows, columns) of the superpixels.

    From it fewer vortices, and so fewer speckles, grow than from a random phase (a spherical
    start: Appl. Phys. Lett. 120, 061103, 2022).
    """
    support = goal.target > 0.5 * goal.target.max()
    phase = torch.zeros(pixels.shape, dtype=torch.float64)
    for axis, side in enumerate(goal.camera.panel.shape):
        n = goal.plane.shape[axis]
        index = torch.arange(n) - n // 2
        lit = support.any(dim=1 - axis)
        extent = float(index[lit].abs().max())
        # A slope of `extent` samples at the panel's edge.
        x = pixels.positions(axis)
        bend = math.pi * extent / (goal.far_field_samples * side / 2) * x**2
        phase = phase + (bend[:, None] if axis == 0 else bend[None, :])
    return phase


def random_start(pixels: Superpixels, generator: torch.Generator) -> torch.Tensor:
    """Uniform over one wave in every superpixel, as in the thesis."""
    return torch.rand(pixels.shape, generator=generator, dtype=torch.float64) * 2 * math.pi


def smooth_start(
    goal: RetrievalGoal, pixels: Superpixels, generator: torch.Generator
) -> torch.Tensor:
    """The quadratic start with smooth random bumps, different each time.

    A start without any symmetry ends with less speckle. Frames that start from it have
    different speckle, and yet most of each pixel's light path in common: a slow liquid crystal
    follows them well.
    """
    noise = torch.randn(pixels.shape, generator=generator, dtype=torch.float64)
    smooth = _gaussian_blur(noise, goal.camera.panel.shape[0] / _BUMPS / pixels.side)
    return quadratic_start(goal, pixels) + _HEIGHT * smooth / smooth.std(correction=0).clamp(
        min=1e-12
    )


def _gaussian_blur(noise: torch.Tensor, sigma: float) -> torch.Tensor:
    """Convolved with a Gaussian of so many samples, with periodic borders."""
    spectrum = torch.fft.rfft2(noise)
    y = torch.fft.fftfreq(noise.shape[0], dtype=torch.float64)
    x = torch.fft.rfftfreq(noise.shape[1], dtype=torch.float64)
    low = torch.exp(-2 * (math.pi * sigma) ** 2 * (y[:, None] ** 2 + x**2))
    return torch.fft.irfft2(spectrum * low, s=noise.shape)


def require_start(start: str) -> None:
    """Raise ValueError for a start that isn't one of STARTS."""
    if start not in STARTS:
        raise ValueError(f"start is {start!r}; choose one of {', '.join(STARTS)}")


def starting_field(
    goal: RetrievalGoal, pixels: Superpixels, start: str, generator: torch.Generator
) -> torch.Tensor:
    """One frame's field on the superpixels, complex64; start: one of STARTS."""
    require_start(start)
    if start == "random":
        return pixels.panel_field(random_start(pixels, generator))
    if start == "smooth":
        return pixels.panel_field(smooth_start(goal, pixels, generator))
    return pixels.panel_field(quadratic_start(goal, pixels))
