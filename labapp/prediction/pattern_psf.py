"""The PSF of grey levels on the panel, by the camera's description."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import torch

from optics.camera import Camera
from optics.camera.pupil import panel_to_focus_distance
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import PSFOperator
from optics.psf.behind_modulator import modulated_psf
from optics.slm import Modulator

USUAL_TOLERANCE = 1e-3
"""Relative L2 error of a PSF for which no other one is asked."""


def predicted_psf(
    camera: Camera,
    greys: torch.Tensor,
    wavelength: float,
    pixels: Plane,
    progress: Progress | None = None,
    moments: int = 1,
    tol: float = USUAL_TOLERANCE,
) -> torch.Tensor:
    """Return the PSF of an in-focus point with grey levels on the panel.

    It is the share of the point's light on each pixel, (moments, rows, columns).
    greys: (frames, rows, columns). Several frames are a video that is repeated and exposed for
    whole periods.
    moments: even groups of the frames, each with its own PSF.
    tol: relative L2 error that is accepted.
    """
    operator = PSFOperator(
        camera, panel_to_focus_distance(camera), wavelength, pixels, unmodulated=0.0, tol=tol
    )
    return mean_psf(operator, Modulator(camera.panel, wavelength), greys, progress, moments)


def mean_psf(
    operator: PSFOperator,
    modulator: Modulator,
    greys: torch.Tensor,
    progress: Progress | None = None,
    moments: int = 1,
) -> torch.Tensor:
    """Return what predicted_psf() does, with an operator that was planned with unmodulated=0."""
    each = len(greys) // moments
    exposures = _exposures(modulator, greys, progress or Progress())
    parts = []
    for _, group in itertools.groupby(exposures, lambda exposure: exposure[0] // each):
        seen = ((weight * moments, modulation) for _, weight, modulation in group)
        parts.append(modulated_psf(operator, modulator, seen))
    return torch.stack(parts)


def _exposures(
    modulator: Modulator, greys: torch.Tensor, progress: Progress
) -> Iterator[tuple[int, float, torch.Tensor]]:
    """Yield the exposures to average: a still pattern's own, or those of a video's period.

    Each is a frame's index, its share of the exposure, and the panel's modulation during it.
    """
    shown: Iterator[tuple[int, float, torch.Tensor]]
    if len(greys) == 1:
        shown = ((0, *field) for field in modulator.still_fields(greys[0]))
    else:
        frame_time = 1 / modulator.panel.frame_rate
        shown = modulator.video_cycle_fields(modulator.phase(greys), frame_time)
    for exposure in shown:
        progress.report(exposure[0] / len(greys), f"predicting the PSF, frame {exposure[0] + 1}")
        yield exposure
