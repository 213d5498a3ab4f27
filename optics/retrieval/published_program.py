"""Gerchberg-Saxton as the thesis' authors published it, for comparison.

github.com/cgtuebingen/computational_camera_phase_retrieval, MIT licence: the method of thesis
§3.3.2, with what their program did besides. Written anew from its description.
"""

from __future__ import annotations

import math

import torch

from optics.progress import Progress
from optics.retrieval.far_field import FarField, unit_modulus
from optics.retrieval.goal import RetrievalGoal

_PITCH, _WAVELENGTH, _FOCAL_LENGTH = 8e-6, 550e-9, 0.15
"""The numbers in their program, whatever the camera."""


def published_program_pattern(
    goal: RetrievalGoal, iterations: int, generator: torch.Generator, progress: Progress
) -> torch.Tensor:
    """A phase pattern (rows, columns), by the published program's steps.

    Its far field has as many samples as the panel's longer side: speckle between them isn't
    seen. The lens' quadratic phase is put on the image as exp(i k r² / 2f) and taken off as
    exp(i k r²), with the pupil's pitch for the image's; what is left over is added to the
    image's phase in every iteration. Harmless for a ring around the axis, not for a spiral.
    Raises ValueError for a target that is dark on its grid.
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
    rows, columns = (max(1, n * side // goal.far_field_samples) for n in goal.plane.shape)
    return rows, columns


def _subsampled_target(goal: RetrievalGoal, window: tuple[int, int]) -> torch.Tensor:
    """The target at the samples of the coarser grid, nearest by nearest."""
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
    """exp(i k r² (1 / 2f - 1)), in double precision until it is within a wave."""
    y, x = ((torch.arange(n, dtype=torch.float64) - n // 2) * _PITCH for n in window)
    r2 = y[:, None] ** 2 + x**2
    turns = r2 / _WAVELENGTH * (1 / (2 * _FOCAL_LENGTH) - 1)
    angle = 2 * math.pi * (turns - torch.round(turns))
    return torch.polar(torch.ones_like(angle), angle).to(torch.complex64)
