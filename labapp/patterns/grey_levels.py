"""From a plan's pattern to grey levels on a panel."""

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
from labapp.files.pattern_table import Pattern, PSFPattern, Still, SumPattern, VideoPattern
from labapp.files.phase_table import FormulaPattern, PhasePattern, RingPattern
from optics.camera import Camera
from optics.patterns import superposed
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval import Retrieved, design_plane, retrieve, window_for
from optics.slm import phase_to_grey
from optics.targets.drawing import Drawn


@dataclass(frozen=True)
class Work:
    """What patterns are computed with. Chance comes from `seed` alone.

    folder: where picture files are looked for.
    """

    camera: Camera
    seed: int
    progress: Progress
    folder: Path

    def part(self, number: int, count: int) -> Work:
        """For one of several pieces of the work, which take the same time."""
        return replace(self, progress=self.progress.part(number / count, (number + 1) / count))

    def generator(self, number: int = 0) -> torch.Generator:
        return torch.Generator().manual_seed(self.seed + number)


@dataclass(frozen=True)
class Moment:
    """A target on the plane in which it was designed, and the frames that show it."""

    target: torch.Tensor
    plane: Plane
    result: Retrieved


@dataclass(frozen=True)
class Frame:
    """Radians on the panel, (rows, columns), and the whole waves that they are to be shown in."""

    phase: torch.Tensor
    orders: int


def compute_pattern(
    spec: Still, camera: Camera, seed: int, progress: Progress, folder: Path
) -> NDArray[np.uint8]:
    """Grey levels of one pattern, (rows, columns) of the panel.

    folder: where picture files are looked for. Chance comes from `seed` alone.
    UserError or ValueError name what can't be shown and what can.
    """
    (grey,) = grey_frames(spec, 1, Work(camera, seed, progress, folder))
    return grey


def compute_patterns(
    specs: Mapping[str, Pattern], camera: Camera, seed: int, progress: Progress, folder: Path
) -> dict[str, NDArray[np.uint8]]:
    """Grey levels of every pattern of a plan; of a video, (frames, rows, columns).

    UserError names the one that can't be shown.
    """
    shown: dict[str, NDArray[np.uint8]] = {}
    # Videos last: they may be made of the others.
    ordered = sorted(specs, key=lambda name: isinstance(specs[name], VideoPattern))
    whole = Work(camera, seed, progress, folder)
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


def grey_frames(spec: Still, count: int, work: Work) -> Iterator[NDArray[np.uint8]]:
    """Grey levels of a pattern's frames, (rows, columns) each; errors as compute_pattern's."""
    if isinstance(spec, GreyPattern):
        for _ in range(count):
            yield spec.levels(work.camera, work.folder)
        return
    for frame in phase_frames(spec, count, work):
        yield shown_grey(frame, work.camera, spec.wavelength)


def shown_grey(frame: Frame, camera: Camera, wavelength: float) -> NDArray[np.uint8]:
    """The grey levels that show a phase at a wavelength in metres."""
    return phase_to_grey(camera.panel, frame.phase, wavelength, frame.orders).numpy()


def phase_frames(spec: PhasePattern, count: int, work: Work) -> Iterator[Frame]:
    """The phases of a pattern's frames, one after the other: frame k from the seed + k."""
    if isinstance(spec, PSFPattern):
        yield from frames_of(retrieve_psf(spec, count, work), spec)
    elif isinstance(spec, SumPattern):
        yield from _summed(spec, count, work)
    else:
        for number in range(count):
            work.progress.report(number / count)
            if isinstance(spec, RingPattern):
                phase = _ring(spec, number, work.part(number, count))
            else:
                phase = cast(FormulaPattern, spec).phase(work.camera, work.generator(number))
            yield Frame(phase, spec.orders)


def retrieve_psf(spec: PSFPattern, count: int, work: Work) -> list[Moment]:
    """The frames of a psf, moment by moment; those of a moment know of each other."""
    moments = spec.target.at(count, work.folder)
    speed = None if spec.budget_s is None else machine_speed(work.progress.part(0, 0))
    found = []
    for number, drawing in enumerate(moments):
        target, plane = designed(drawing, work.camera, spec.wavelength)
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
        found.append(Moment(target, plane, result))
    return found


def frames_of(moments: list[Moment], spec: PSFPattern) -> Iterator[Frame]:
    """All frames of a retrieved video in turn."""
    for moment in moments:
        orders = max(spec.orders, moment.result.orders)
        for phase in moment.result.phases:
            yield Frame(phase, orders)


def designed(drawing: Drawn, camera: Camera, wavelength: float) -> tuple[torch.Tensor, Plane]:
    """A target on a window of the design grid that holds it, with dark around it."""
    window = window_for(camera, wavelength, drawing.reach)
    plane = design_plane(camera, wavelength, window)
    return drawing.on(plane), plane


def _ring(spec: RingPattern, number: int, work: Work) -> torch.Tensor:
    target, plane = designed(spec.target.draw(work.folder), work.camera, spec.wavelength)
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


def _summed(spec: SumPattern, count: int, work: Work) -> Iterator[Frame]:
    """Parts that jump are added to the others' sum, whose slope is judged."""
    parts = [
        phase_frames(part, count, replace(work.part(i, len(spec.parts)), seed=_seed(work, i)))
        for i, part in enumerate(spec.parts)
    ]
    for frames in zip(*parts, strict=True):
        both = list(zip(spec.parts, frames, strict=True))
        total = superposed(work.camera.panel, *(one.phase for part, one in both if part.smooth))
        for part, one in both:
            total = total if part.smooth else total + one.phase
        yield Frame(total, max([spec.orders, *(one.orders for one in frames)]))


def _seed(work: Work, number: int) -> int:
    """Of a sum's part: two parts of one kind shall not be alike."""
    return int(np.random.SeedSequence([work.seed, number]).generate_state(1)[0])
