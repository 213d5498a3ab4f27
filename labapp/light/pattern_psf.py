"""The PSF that frames on a panel will give, as the camera's description has it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import torch

from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.psf import PSFOperator
from optics.psf.behind_modulator import modulated_psf
from optics.slm import Modulator
from optics.stop_shadow import panel_to_focus_distance

Exposure = tuple[int, float, torch.Tensor]
"""The frame, its share of the whole time, and what the panel does to the light meanwhile."""


def predicted_psf(
    camera: Camera,
    greys: torch.Tensor,
    wavelength: float,
    pixels: Plane,
    progress: Progress | None = None,
    moments: int = 1,
) -> torch.Tensor:
    """The share of an in-focus point's light on each pixel, (moments, rows, columns).

    greys: (frames, rows, columns) of the panel; several are a video that is played again and
    again, and seen for whole periods. moments: into which the frames are grouped evenly.
    """
    operator = PSFOperator(
        camera, panel_to_focus_distance(camera), wavelength, pixels, unmodulated=0.0
    )
    return mean_psf(operator, Modulator(camera.panel, wavelength), greys, progress, moments)


def mean_psf(
    operator: PSFOperator,
    modulator: Modulator,
    greys: torch.Tensor,
    progress: Progress | None = None,
    moments: int = 1,
) -> torch.Tensor:
    """The same by an operator of one's own, planned with unmodulated=0."""
    each = len(greys) // moments
    exposures = _report_progress(_exposures(modulator, greys), len(greys), progress or Progress())
    parts = []
    for _, group in itertools.groupby(exposures, lambda exposure: exposure[0] // each):
        seen = ((weight * moments, modulation) for _, weight, modulation in group)
        parts.append(modulated_psf(operator, modulator, seen))
    return torch.stack(parts)


def _exposures(modulator: Modulator, greys: torch.Tensor) -> Iterator[Exposure]:
    """Of a still pattern, or of one period of a video."""
    if len(greys) == 1:
        for weight, modulation in modulator.still_fields(greys[0]):
            yield 0, weight, modulation
        return
    yield from modulator.video_cycle_fields(modulator.phase(greys), 1 / modulator.panel.frame_rate)


def _report_progress(
    exposures: Iterator[Exposure], frames: int, progress: Progress
) -> Iterator[Exposure]:
    for exposure in exposures:
        progress.report(exposure[0] / frames, f"predicting the PSF, frame {exposure[0] + 1}")
        yield exposure
