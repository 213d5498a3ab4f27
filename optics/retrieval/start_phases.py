"""Compute the phases that retrieval iterations start from."""

from __future__ import annotations

import math

import torch

from optics.retrieval.goal import RetrievalGoal
from optics.retrieval.superpixel import Superpixels

STARTS = ("smooth", "quadratic", "random")
"""Names of the phases that a retrieval can start from."""


def quadratic_start(goal: RetrievalGoal, pixels: Superpixels) -> torch.Tensor:
    """Return a quadratic start phase for phase retrieval, which spreads light over the target.

    The phase is (rows, columns) of the superpixels. Fewer vortices, and so fewer speckles, develop
    from it than from a random phase (a spherical start: Appl. Phys. Lett. 120, 061103, 2022).
    """
    support = goal.target > 0.5 * goal.target.max()
    phase = torch.zeros(pixels.shape, dtype=torch.float64)
    for axis, side in enumerate(goal.camera.panel.shape):
        n = goal.plane.shape[axis]
        index = torch.arange(n) - n // 2
        lit = support.any(dim=1 - axis)
        extent = float(index[lit].abs().max())
        # At the panel's edge, the slope of the phase steers light to `extent` samples.
        x = pixels.positions(axis)
        bend = math.pi * extent / (goal.far_field_samples * side / 2) * x**2
        phase = phase + (bend[:, None] if axis == 0 else bend[None, :])
    return phase


def random_start(pixels: Superpixels, generator: torch.Generator) -> torch.Tensor:
    """Return a random start phase for phase retrieval, as in the thesis.

    The phase is uniform over one wave in every superpixel.
    """
    return torch.rand(pixels.shape, generator=generator, dtype=torch.float64) * 2 * math.pi


def smooth_start(
    goal: RetrievalGoal, pixels: Superpixels, generator: torch.Generator
) -> torch.Tensor:
    """Return a start phase for phase retrieval: the quadratic one plus a smooth random phase.

    Each call returns a different phase. A start without symmetry leads to less speckle. Frames that
    start from it have different speckle but similar phases, which a slow liquid crystal can follow.
    """
    noise = torch.randn(pixels.shape, generator=generator, dtype=torch.float64)
    # The correlation length of the random phase is a twelfth of the panel's height, and its rms is
    # half a radian.
    smooth = _gaussian_blur(noise, goal.camera.panel.shape[0] / 12 / pixels.side)
    return quadratic_start(goal, pixels) + 0.5 * smooth / smooth.std(correction=0).clamp(min=1e-12)


def _gaussian_blur(noise: torch.Tensor, sigma: float) -> torch.Tensor:
    """Smooth a phase retrieval's random start phase by a Gaussian of `sigma` samples.

    The borders are periodic.
    """
    spectrum = torch.fft.rfft2(noise)
    y = torch.fft.fftfreq(noise.shape[0], dtype=torch.float64)
    x = torch.fft.rfftfreq(noise.shape[1], dtype=torch.float64)
    low = torch.exp(-2 * (math.pi * sigma) ** 2 * (y[:, None] ** 2 + x**2))
    return torch.fft.irfft2(spectrum * low, s=noise.shape)


def require_start(start: str) -> None:
    """Raise ValueError for a start of a phase retrieval that isn't one of STARTS."""
    if start not in STARTS:
        raise ValueError(f"start is {start!r}; choose one of {', '.join(STARTS)}")


def starting_field(
    goal: RetrievalGoal, pixels: Superpixels, start: str, generator: torch.Generator
) -> torch.Tensor:
    """Return the field on the superpixels from which a frame's phase retrieval starts, complex64.

    start: one of STARTS.
    """
    require_start(start)
    if start == "random":
        return pixels.panel_field(random_start(pixels, generator))
    if start == "smooth":
        return pixels.panel_field(smooth_start(goal, pixels, generator))
    return pixels.panel_field(quadratic_start(goal, pixels))
