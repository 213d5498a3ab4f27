"""Computes the frames of a pattern, and predicts their PSF."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.files.design_file import Grid
from labapp.files.pattern_table import PSFPattern, StillPattern
from labapp.files.phase_table import PhasePattern
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


@dataclass(frozen=True, eq=False)
class PatternDesign:
    """A computed pattern with its predicted PSF.

    greys: grey levels, (frames, rows, columns).
    phases: (frames, rows, columns), radians; None if they weren't asked for or aren't known.
    orders: number of whole waves of the panel's range that the phases use.
    moments: results of a phase retrieval; empty for other patterns.
    psf: predicted PSF, (moments, y, x), as the share of the light on each sensor pixel.
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
        psf = self.psf.images
        return {
            "frames": len(self.greys),
            "light_in_window": psf.sum((1, 2)).tolist(),
            "brightest_pixel": psf.max((1, 2)).tolist(),
            "quality": self._quality,
        }

    @property
    def _quality(self) -> dict[str, Any]:
        results = [moment.result for moment in self.moments]
        if not results:
            return {}
        return {
            "method": results[0].method,
            "iterations": results[0].iterations,
            "cpu_seconds": math.fsum(result.cpu_seconds for result in results),
            "efficiency": [result.quality.efficiency for result in results],
            "steered_share": [result.quality.steered_share for result in results],
            "contrast": [result.quality.contrast for result in results],
            "nrmse": [result.quality.nrmse for result in results],
        }


def design_pattern(
    spec: StillPattern,
    count: int,
    wavelength: float,
    side: int | None,
    work: PatternContext,
    *,
    keep_phases: bool,
) -> PatternDesign:
    """Compute `count` frames as grey levels, and predict their PSF.

    wavelength: in metres.
    side: of the PSF in sensor pixels; None takes the size that the target needs.
    keep_phases: whether the design holds phases besides grey levels.
    Raises ValueError or UserError if the panel can't show the pattern.
    """
    # Computing the pattern has most of the progress; the prediction has the rest.
    computing = replace(work, progress=work.progress.part(0, 0.8))
    predicting = work.progress.part(0.8, 1)
    moments = retrieve_psf(spec, count, computing) if isinstance(spec, PSFPattern) else []
    greys, phases, orders = _compute_frames(spec, count, moments, computing, keep_phases)
    camera = work.camera
    side = side or _window_side(moments, camera)
    pixels = camera.sensor.window_plane((side, side))
    psf = predicted_psf(
        camera,
        torch.from_numpy(greys),
        wavelength,
        pixels,
        predicting,
        max(1, len(moments)),
    )
    return PatternDesign(greys, phases, orders, moments, Grid.from_tensor(psf, pixels))


def _compute_frames(
    spec: StillPattern,
    count: int,
    moments: list[RetrievedMoment],
    work: PatternContext,
    keep_phases: bool,
) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None, int]:
    """Return grey levels, phases if wanted and known, and orders.

    The orders are the whole waves of the panel's range that the phases use, 1 if they are unknown.
    """
    if not isinstance(spec, PhasePattern):
        return np.stack(list(grey_frames(spec, count, work))), None, 1
    frames: Iterable[PhaseFrame]
    if isinstance(spec, PSFPattern):
        frames = retrieved_frames(moments, spec)
    else:
        frames = phase_frames(spec, count, work)
    greys, phases, orders = list[NDArray[np.uint8]](), list[NDArray[np.float32]](), 1
    for frame in frames:
        greys.append(frame_to_grey(frame, work.camera, spec.wavelength))
        orders = max(orders, frame.orders)
        if keep_phases:
            phases.append(_single_precision_phase(frame))
    return np.stack(greys), np.stack(phases) if keep_phases else None, orders


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
