"""From a plan's pattern to grey levels on a panel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.errors import UserError
from labapp.files.pattern_table import (
    AxiconPattern,
    ConstantPattern,
    GratingPattern,
    ImagePattern,
    LensPattern,
    Pattern,
    RingPattern,
    Still,
    VideoPattern,
)
from labapp.files.reading import read_grey
from optics import patterns, targets
from optics.camera import Camera
from optics.plane import Plane
from optics.progress import Progress
from optics.retrieval.gerchberg_saxton import design_plane, gerchberg_saxton
from optics.slm import phase_to_grey, require_grey

_SMALLEST_WINDOW = 128


@dataclass(frozen=True)
class Design:
    """A target PSF on the plane in which it was designed."""

    target: torch.Tensor
    plane: Plane


def ring_design(spec: RingPattern, camera: Camera) -> Design:
    """The ring on a window that holds it and as much dark around it."""
    wavelength = spec.wavelength_nm * 1e-9
    pitch = design_plane(camera, wavelength, (1, 1)).pitch[0]
    reach = 2 * (spec.radius_um + 3 * spec.width_um) * 1e-6
    side = max(_SMALLEST_WINDOW, 2 * round(reach / pitch))
    plane = design_plane(camera, wavelength, (side, side))
    return Design(targets.ring(plane, spec.radius_um * 1e-6, spec.width_um * 1e-6), plane)


def compute_pattern(
    spec: Still, camera: Camera, seed: int, progress: Progress, folder: Path
) -> NDArray[np.uint8]:
    """Grey levels of one pattern, (rows, columns) of the panel.

    folder: where picture files are looked for. Chance comes from `seed` alone.
    UserError or ValueError name what can't be shown and what can.
    """
    panel = camera.panel
    if isinstance(spec, ConstantPattern):
        return np.full(panel.shape, spec.grey, dtype=np.uint8)
    if isinstance(spec, GratingPattern):
        return _grating(spec, panel.shape)
    if isinstance(spec, ImagePattern):
        return _from_file(folder / spec.file, camera)
    wavelength = spec.wavelength_nm * 1e-9
    if isinstance(spec, RingPattern):
        design = ring_design(spec, camera)
        phase = gerchberg_saxton(
            camera,
            design.target,
            design.plane,
            wavelength,
            iterations=spec.iterations,
            generator=torch.Generator().manual_seed(seed),
            start=spec.start,
            progress=progress,
        )
    elif isinstance(spec, LensPattern):
        phase = patterns.fresnel_lens(panel, spec.focal_length_m, wavelength)
    else:
        assert isinstance(spec, AxiconPattern)
        distance = camera.lens.image_distance
        phase = patterns.axicon(panel, spec.radius_um * 1e-6, distance, wavelength)
    return phase_to_grey(panel, phase, wavelength).numpy()


def compute_patterns(
    specs: Mapping[str, Pattern], camera: Camera, seed: int, progress: Progress, folder: Path
) -> dict[str, NDArray[np.uint8]]:
    """Grey levels of every pattern of a plan; of a video, (frames, rows, columns).

    UserError names the one that can't be shown.
    """
    shown: dict[str, NDArray[np.uint8]] = {}
    # Videos last: they may be made of the others.
    ordered = sorted(specs, key=lambda name: isinstance(specs[name], VideoPattern))
    for number, name in enumerate(ordered):
        spec = specs[name]
        part = progress.part(number / len(specs), (number + 1) / len(specs))
        try:
            if isinstance(spec, VideoPattern):
                shown[name] = _video(spec, shown, camera, seed, part, folder)
            else:
                shown[name] = compute_pattern(spec, camera, seed, part, folder)
        except ValueError as error:
            raise UserError(f"pattern {name!r}: {error}.") from error
        part.report(1.0, f"pattern {name}")
    return {name: shown[name] for name in specs}


def _video(
    spec: VideoPattern,
    stills: Mapping[str, NDArray[np.uint8]],
    camera: Camera,
    seed: int,
    progress: Progress,
    folder: Path,
) -> NDArray[np.uint8]:
    if spec.pattern is None:
        return np.stack([stills[name] for name in spec.frames])
    frames = []
    for number in range(spec.length):
        part = progress.part(number / spec.length, (number + 1) / spec.length)
        frames.append(compute_pattern(spec.pattern, camera, seed + number, part, folder))
    return np.stack(frames)


def _grating(spec: GratingPattern, shape: tuple[int, int]) -> NDArray[np.uint8]:
    rows, columns = np.indices(shape)
    stripes = (columns if spec.axis == "x" else rows) // (spec.period_px // 2)
    return np.where(stripes % 2, spec.high, spec.low).astype(np.uint8)


def _from_file(path: Path, camera: Camera) -> NDArray[np.uint8]:
    grey = read_grey(path)
    try:
        require_grey(camera.panel, grey)
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: {error}.") from error
    return grey
