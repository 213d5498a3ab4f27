"""Retrieve a phase by Gerchberg-Saxton as the thesis' authors published it, for comparison.

Their program is github.com/cgtuebingen/computational_camera_phase_retrieval, MIT licence. It is the
method of thesis §3.3.2 with additional steps. This module was written from its description.
"""

from __future__ import annotations

import math

import torch

from optics.progress import Progress
from optics.retrieval.far_field import FarField, unit_modulus
from optics.retrieval.goal import RetrievalGoal


def published_program_pattern(
    goal: RetrievalGoal, iterations: int, generator: torch.Generator, progress: Progress
) -> torch.Tensor:
    """Retrieve a phase pattern (rows, columns) by the steps of the published program.

    Its far field has as many samples as the panel's longer side, so it misses the speckle between
    them. The program multiplies the image by the lens' quadratic phase exp(i k r² / 2f), but
    divides it by exp(i k r²), and uses the pupil's pitch for the image's. The remaining phase is
    added to the image in every iteration. That is harmless for a ring around the axis, but not for
    a spiral. Raises ValueError for a target that is dark on the program's grid.
    """
    side = max(goal.camera.panel.shape)
    far_field = FarField(goal.camera.panel.shape, side, _window(goal, side))
    amplitude = torch.sqrt(_subsampled_target(goal, far_field.window))
    left_over = _residual_lens_phasor(far_field.window)
    phase = torch.rand(goal.camera.panel.shape, generator=generator) * 6 * math.pi
    field = torch.polar(torch.ones_like(phase), phase)
    for iteration in range(iterations):
        progress.report(iteration / iterations, f"as published {iteration + 1}/{iterations}")
        asked = unit_modulus(far_field.forward(field)) * amplitude * left_over
        field = unit_modulus(far_field.adjoint(asked))
    return torch.angle(field)


def _window(goal: RetrievalGoal, side: int) -> tuple[int, int]:
    """Return the (rows, columns) of the published retrieval program's window on its grid."""
    rows, columns = (max(1, n * side // goal.far_field_samples) for n in goal.plane.shape)
    return rows, columns


def _subsampled_target(goal: RetrievalGoal, window: tuple[int, int]) -> torch.Tensor:
    """Sample the retrieval's target on the published program's coarser grid.

    Each sample takes the value of the nearest sample of the target.
    """
    picked = []
    ratio = goal.far_field_samples / max(goal.camera.panel.shape)
    for n, m in zip(goal.plane.shape, window, strict=True):
        index = torch.round((torch.arange(m) - m // 2) * ratio).long() + n // 2
        picked.append(index.clamp(0, n - 1))
    target = goal.target.to(torch.float32)[picked[0][:, None], picked[1]]
    if not target.any():
        raise ValueError(
            "target is dark on every second sample, and the published program sees no others; "
            "draw it wider than a sample, or choose another method"
        )
    return target


def _residual_lens_phasor(window: tuple[int, int]) -> torch.Tensor:
    """Return the lens phasor that remains in the published program of phase retrieval.

    The phasor is exp(i k r² (1 / 2f - 1)). Its phase is computed in double precision and reduced to
    one wave.
    """
    # The published program uses these lengths in metres for every camera.
    pitch, wavelength, focal_length = 8e-6, 550e-9, 0.15
    y, x = ((torch.arange(n, dtype=torch.float64) - n // 2) * pitch for n in window)
    r2 = y[:, None] ** 2 + x**2
    turns = r2 / wavelength * (1 / (2 * focal_length) - 1)
    angle = 2 * math.pi * (turns - torch.round(turns))
    return torch.polar(torch.ones_like(angle), angle).to(torch.complex64)
