"""Computes the frames of a pattern, and predicts their PSF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.files.design_file import Grid
from labapp.files.pattern_table import PSFPattern
from labapp.files.phase_table import PhasePattern
from labapp.patterns.designing.kinds import DesignRequest
from labapp.patterns.grey_levels import (
    PatternContext,
    PhaseFrame,
    RetrievedMoment,
    frame_to_grey,
    grey_frames,
    phase_frames,
    retrieve_psf,
    retrieved_frames,
)
from labapp.prediction.pattern_psf import predicted_psf
from optics.camera import Camera
from optics.plane import centred_pad
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class PatternDesign:
    """A computed pattern with its predicted PSF.

    greys and phases (radians) are (frames, rows, columns); phases are None if they weren't asked
    for or aren't known. orders: whole waves of the panel's range that the phases use, 1 if they are
    unknown. moments: results of a phase retrieval; empty for other patterns. psf: (moments, y, x),
    as the share of the light on each sensor pixel.
    """

    greys: NDArray[np.uint8]
    phases: NDArray[np.float32] | None
    orders: int
    moments: Sequence[RetrievedMoment]
    psf: Grid

    @property
    def target(self) -> Grid | None:
        """The targets, (moments, y, x), each with sum 1; None without one."""
        if not self.moments:
            return None
        largest = max(self.moments, key=lambda moment: moment.plane.shape).plane
        pictures = [centred_pad(moment.target, largest.shape) for moment in self.moments]
        return Grid.from_tensor(torch.stack(pictures), largest)

    @cached_property
    def figures_of_merit(self) -> dict[str, Any]:
        """Quality as plain data; lists have a value for each moment."""
        psf, quality = self.psf.images, dict[str, Any]()
        if self.moments:
            results = [moment.result for moment in self.moments]
            quality = {
                "method": results[0].method,
                "iterations": results[0].iterations,
                "cpu_seconds": math.fsum(result.cpu_seconds for result in results),
            }
            for name in ("efficiency", "steered_share", "contrast", "nrmse"):
                quality[name] = [getattr(result.quality, name) for result in results]
        return {
            "frames": len(self.greys),
            "light_in_window": psf.sum((1, 2)).tolist(),
            "brightest_pixel": psf.max((1, 2)).tolist(),
            "quality": quality,
        }


def design_pattern(
    request: DesignRequest, camera: Camera, progress: Progress, *, keep_phases: bool
) -> PatternDesign:
    """Compute the frames as grey levels, and predict their PSF.

    keep_phases: whether the design holds phases besides grey levels.
    Raises ValueError or UserError if the panel can't show the pattern.
    """
    spec, count = request.pattern, request.frames
    # Computing the pattern has most of the progress; the prediction has the rest.
    work = PatternContext(camera, request.seed, progress.part(0, 0.8), Path())
    moments = retrieve_psf(spec, count, work) if isinstance(spec, PSFPattern) else []
    phases: list[NDArray[np.float32]] | None = None
    orders = 1
    if isinstance(spec, PhasePattern):
        if isinstance(spec, PSFPattern):
            frames = retrieved_frames(moments, spec)
        else:
            frames = phase_frames(spec, count, work)
        levels = []
        phases = [] if keep_phases else None
        for frame in frames:
            levels.append(frame_to_grey(frame, camera, spec.wavelength))
            orders = max(orders, frame.orders)
            if phases is not None:
                phases.append(_single_precision_phase(frame))
    else:
        levels = list(grey_frames(spec, count, work))
    greys = np.stack(levels)
    side = request.side or _window_side(moments, camera)
    pixels = camera.sensor.window_plane((side, side))
    psf = predicted_psf(
        camera,
        torch.from_numpy(greys),
        request.wavelength,
        pixels,
        progress.part(0.8, 1),
        max(1, len(moments)),
    )
    kept = None if phases is None else np.stack(phases)
    return PatternDesign(greys, kept, orders, moments, Grid.from_tensor(psf, pixels))


def _single_precision_phase(frame: PhaseFrame) -> NDArray[np.float32]:
    """Convert a phase to float32, and wrap it first if it is float64.

    Single precision can't hold thousands of radians with the accuracy of a grey level.
    """
    phase = frame.phase
    if phase.dtype == torch.float64:
        phase = torch.remainder(phase, 2 * math.pi * frame.orders)
    return phase.to(torch.float32).numpy()


def _window_side(moments: Sequence[RetrievedMoment], camera: Camera) -> int:
    """Return the side of the PSF's window, an even number of sensor pixels.

    The window holds those in which the targets were designed. Without a target, its side is 256.
    """
    if not moments:
        return 256
    widest = max(n * p for m in moments for n, p in zip(m.plane.shape, m.plane.pitch, strict=True))
    return 2 * math.ceil(widest / camera.sensor.pitch / 2)
