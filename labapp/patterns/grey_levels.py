"""Computes a plan's patterns as grey levels on the SLM's panel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.grey_table import GreyPattern
from labapp.files.pattern_table import Pattern, PSFPattern, StillPattern, SumPattern, VideoPattern
from labapp.files.phase_table import FormulaPattern, PhasePattern, RingPattern
from optics.camera import Camera
from optics.patterns import superpose
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval import RetrievalResult, design_plane, retrieve, window_for_reach
from optics.slm import phase_to_grey
from optics.targets.target import Renderable


@dataclass(frozen=True)
class PatternContext:
    """What patterns are computed with: the seed alone determines all random numbers.

    Picture files are read from `folder`.
    """

    camera: Camera
    seed: int
    progress: Progress
    folder: Path

    def part(self, number: int, count: int) -> PatternContext:
        """Return the context for one of `count` equally long parts of a computation."""
        return replace(self, progress=self.progress.part(number / count, (number + 1) / count))

    def generator(self, number: int = 0) -> torch.Generator:
        return torch.Generator().manual_seed(self.seed + number)


@dataclass(frozen=True)
class RetrievedMoment:
    """The result of phase retrieval for one moment of a target, and the target on its plane."""

    target: torch.Tensor
    plane: Plane
    result: RetrievalResult


@dataclass(frozen=True)
class PhaseFrame:
    """A phase on the panel, (rows, columns), radians, and the whole waves that it uses."""

    phase: torch.Tensor
    orders: int


def compute_pattern(
    spec: StillPattern, camera: Camera, seed: int, progress: Progress, folder: Path
) -> NDArray[np.uint8]:
    """Compute the grey levels of a still pattern on the camera's panel, (rows, columns).

    Raises UserError or ValueError if the panel can't show the pattern.
    """
    (grey,) = grey_frames(spec, 1, PatternContext(camera, seed, progress, folder))
    return grey


def compute_patterns(
    specs: Mapping[str, Pattern], camera: Camera, seed: int, progress: Progress, folder: Path
) -> dict[str, NDArray[np.uint8]]:
    """Compute the grey levels of all patterns of a plan; those of a video have a frame axis first.

    Raises UserError with the name of a pattern that can't be shown.
    """
    shown: dict[str, NDArray[np.uint8]] = {}
    # Videos come last, because they may consist of other patterns of the plan.
    ordered = sorted(specs, key=lambda name: isinstance(specs[name], VideoPattern))
    whole = PatternContext(camera, seed, progress, folder)
    for number, name in enumerate(ordered):
        spec, work = specs[name], whole.part(number, len(specs))
        try:
            if not isinstance(spec, VideoPattern):
                (shown[name],) = grey_frames(spec, 1, work)
            elif spec.pattern is None:
                shown[name] = np.stack([shown[frame] for frame in spec.frames])
            else:
                shown[name] = np.stack(list(grey_frames(spec.pattern, spec.length, work)))
        except ValueError as error:
            raise UserError(f"pattern {name!r}: {error}.") from error
        work.progress.report(1.0, f"pattern {name}")
    return {name: shown[name] for name in specs}


def grey_frames(
    spec: StillPattern, count: int, work: PatternContext
) -> Iterator[NDArray[np.uint8]]:
    """Yield the grey levels of `count` frames, (rows, columns) each.

    Raises the errors of compute_pattern().
    """
    if isinstance(spec, GreyPattern):
        for _ in range(count):
            yield spec.grey_levels(work.camera, work.folder)
        return
    for frame in phase_frames(spec, count, work):
        yield frame_to_grey(frame, work.camera, spec.wavelength)


def frame_to_grey(frame: PhaseFrame, camera: Camera, wavelength: float) -> NDArray[np.uint8]:
    """Return the grey levels that show a frame's phase at a wavelength in metres."""
    return phase_to_grey(camera.panel, frame.phase, wavelength, frame.orders).numpy()


def phase_frames(spec: PhasePattern, count: int, work: PatternContext) -> Iterator[PhaseFrame]:
    """Yield the phases of `count` frames; frame k is computed with the seed + k."""
    if isinstance(spec, PSFPattern):
        yield from retrieved_frames(retrieve_psf(spec, count, work), spec)
    elif isinstance(spec, SumPattern):
        yield from _sum_frames(spec, count, work)
    else:
        for number in range(count):
            work.progress.report(number / count)
            if isinstance(spec, RingPattern):
                phase = _ring(spec, number, work.part(number, count))
            else:
                phase = cast(FormulaPattern, spec).phase(work.camera, work.generator(number))
            yield PhaseFrame(phase, spec.orders)


def retrieve_psf(spec: PSFPattern, count: int, work: PatternContext) -> list[RetrievedMoment]:
    """Design the frames of a PSF; the frames of a moment are retrieved jointly."""
    moments = spec.target.video_drawings(count, work.folder)
    speed = None if spec.budget_s is None else machine_speed(work.progress.part(0, 0))
    found = []
    for number, drawing in enumerate(moments):
        target, plane = target_on_design_grid(drawing, work.camera, spec.wavelength)
        result = retrieve(
            work.camera,
            target,
            plane,
            spec.wavelength,
            frames=count // len(moments),
            budget=None if spec.budget_s is None else spec.budget_s / len(moments),
            iterations=spec.iterations,
            method=spec.method,
            generator=work.generator(number),
            progress=work.part(number, len(moments)).progress,
            speed=speed,
        )
        found.append(RetrievedMoment(target, plane, result))
    return found


def retrieved_frames(moments: list[RetrievedMoment], spec: PSFPattern) -> Iterator[PhaseFrame]:
    """Yield the phases of all retrieved frames in turn, moment by moment."""
    for moment in moments:
        orders = max(spec.orders, moment.result.orders)
        for phase in moment.result.phases:
            yield PhaseFrame(phase, orders)


def target_on_design_grid(
    drawing: Renderable, camera: Camera, wavelength: float
) -> tuple[torch.Tensor, Plane]:
    """Draw a target on a window of the design grid, with a dark border."""
    window = window_for_reach(camera, wavelength, drawing.reach)
    plane = design_plane(camera, wavelength, window)
    return drawing.render(plane), plane


def _ring(spec: RingPattern, number: int, work: PatternContext) -> torch.Tensor:
    """Compute the phase of one frame whose PSF is a ring."""
    drawing = spec.target.draw(work.folder)
    target, plane = target_on_design_grid(drawing, work.camera, spec.wavelength)
    result = retrieve(
        work.camera,
        target,
        plane,
        spec.wavelength,
        iterations=spec.iterations,
        method="gerchberg-saxton",
        start=spec.start,
        generator=work.generator(number),
        progress=work.progress,
    )
    return result.phases[0]


def _sum_frames(spec: SumPattern, count: int, work: PatternContext) -> Iterator[PhaseFrame]:
    """Yield the phases of the frames of a sum of patterns.

    Smooth parts are superposed first, because the slope of their sum is checked. Parts with jumps
    are added to that sum.
    """
    parts = []
    for i, part in enumerate(spec.parts):
        # Parts of the same kind differ by their seeds.
        seed = int(np.random.SeedSequence([work.seed, i]).generate_state(1)[0])
        parts.append(phase_frames(part, count, replace(work.part(i, len(spec.parts)), seed=seed)))
    for frames in zip(*parts, strict=True):
        both = list(zip(spec.parts, frames, strict=True))
        total = superpose(work.camera.panel, *(one.phase for part, one in both if part.smooth))
        for part, one in both:
            total = total if part.smooth else total + one.phase
        yield PhaseFrame(total, max([spec.orders, *(one.orders for one in frames)]))
