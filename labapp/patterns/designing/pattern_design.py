"""A pattern computed, and the PSF that it will give."""

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
from labapp.light.pattern_psf import predicted_psf
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
from optics.camera import Camera
from optics.plane import centred_pad

_SIDE = 256
"""Sensor pixels across the predicted PSF, where no target says more."""

_SHARE = 0.8
"""Of the time that computing the pattern takes; the prediction takes the rest."""


@dataclass(frozen=True, eq=False)
class PatternDesign:
    """What a pattern came to.

    greys: (frames, rows, columns). phases: the same, radians, or None for grey levels; shown in
    `orders` whole waves. moments: of a retrieval. psf: share of the light on each sensor pixel,
    (moments, y, x).
    """

    greys: NDArray[np.uint8]
    phases: NDArray[np.float32] | None
    orders: int
    moments: Sequence[RetrievedMoment]
    psf: Grid

    @property
    def target(self) -> Grid | None:
        """(moments, y, x), each with sum one."""
        if not self.moments:
            return None
        largest = max(self.moments, key=lambda moment: moment.plane.shape).plane
        pictures = [centred_pad(moment.target, largest.shape) for moment in self.moments]
        return Grid.from_tensor(torch.stack(pictures), largest)

    @cached_property
    def figures_of_merit(self) -> dict[str, Any]:
        """How good it is, for programs; lists have a value for each moment."""
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
    """Compute so many frames of a pattern, and predict their PSF at a wavelength in metres.

    side: sensor pixels across it; None for what the target needs. keep_phases: whether the
    phases are wanted besides the grey levels. ValueError or UserError say what can't be shown.
    """
    computing = replace(work, progress=work.progress.part(0, _SHARE))
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
        work.progress.part(_SHARE, 1),
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
    """Grey levels, phases if they are wanted and known, and the waves that they are shown in."""
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
    """A phase in single precision, which doesn't hold thousands of radians to a grey level."""
    phase = frame.phase
    if phase.dtype == torch.float64:
        phase = torch.remainder(phase, 2 * math.pi * frame.orders)
    return phase.to(torch.float32).numpy()


def _window_side(moments: Sequence[RetrievedMoment], camera: Camera) -> int:
    """Sensor pixels that hold the windows in which targets were designed; an even number."""
    if not moments:
        return _SIDE
    widest = max(n * p for m in moments for n, p in zip(m.plane.shape, m.plane.pitch, strict=True))
    return 2 * math.ceil(widest / camera.sensor.pitch / 2)
