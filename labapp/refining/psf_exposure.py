"""One picture of what the panel shows: an ordinary plan, run into a record, and merged."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labapp.bench.opening import Bench
from labapp.files.grey_table import ImagePattern
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PATTERN_FOLDER, write_plan
from labapp.pictures.analysis.brackets import Bracket, find_bracket, merge_all
from labapp.refining.refinement_request import RefinementRequest
from labapp.runs.acquisition.frame_taker import AskOperator
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete
from optics.progress import Progress

_DARKS = 2
"""Dark frames of each exposure."""

_RUN_SHARE = 0.9
"""Of a picture's progress; merging has the rest."""


def picture_name(number: int) -> str:
    """Of a picture, from 1: its record, its folder, and its pattern in them."""
    return f"picture-{number}"


def record_path(folder: Path, number: int) -> Path:
    return folder / f"{picture_name(number)}.h5"


def take_picture(
    bench: Bench,
    request: RefinementRequest,
    wavelength_nm: float,
    greys: NDArray[np.uint8],
    number: int,
    folder: Path,
    *,
    force: bool,
    progress: Progress,
    ask: AskOperator | None,
) -> Bracket:
    """The merged picture of frames, (frames, rows, columns) grey levels, by electrons per second.

    The folder gets picture-N/ with plan and patterns, and picture-N.h5 with the frames. UserError
    says what is wrong at the bench; Cancelled if the progress was cancelled.
    """
    name, path = picture_name(number), record_path(folder, number)
    plan = build_plan(request, wavelength_nm, number, len(greys), bench.slm.frame_time)
    pictures = [one for one, pattern in plan.patterns.items() if isinstance(pattern, ImagePattern)]
    source = write_plan(folder / name, plan, dict(zip(pictures, greys, strict=True)))
    outcome = run_plan(
        bench,
        plan,
        path,
        source=str(source),
        folder=source.parent,
        force=force,
        progress=progress.part(0, _RUN_SHARE),
        ask=ask,
    )
    require_complete(outcome)
    with Record(path) as record:
        brackets = merge_all(record, progress.part(_RUN_SHARE, 1))
    return find_bracket(brackets, "star", name, None, path)


def build_plan(
    request: RefinementRequest, wavelength_nm: float, number: int, frames: int, frame_time: float
) -> PlanFile:
    """The star behind a still or a video, and darks of the same exposures before it.

    frame_time: seconds that a frame of a video stands.
    """
    name = picture_name(number)
    stills = [name] if frames == 1 else [f"{name}-{frame:04}" for frame in range(frames)]
    patterns: dict[str, Any] = {
        one: {"kind": "image", "file": f"{PATTERN_FOLDER}/{one}.png"} for one in stills
    }
    exposing: dict[str, Any] = {"exposures_ms": request.exposures_ms}
    if frames > 1:
        patterns |= {name: {"kind": "video", "frames": stills}}
        exposing = {"periods": whole_periods(request, frames * frame_time)}
    block = {"patterns": [name], "wavelengths_nm": [wavelength_nm], **exposing}
    blocks = [block | {"targets": ["star"]}]
    targets = {"star": {"place": request.star}}
    if request.dark:
        blocks.insert(0, block | {"targets": ["dark"], "role": "dark", "repeats": _DARKS})
        targets |= {"dark": {"place": request.dark}}
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": f"Refinement, picture {number}",
            # Two pictures shall not have the same noise.
            "seed": number,
            "targets": targets,
            "patterns": patterns,
            "acquire": blocks,
        }
    )


def whole_periods(request: RefinementRequest, period: float) -> list[int]:
    """The exposures as whole periods of a video in seconds, rounded up, each once."""
    return sorted({max(1, math.ceil(ms * 1e-3 / period - 1e-6)) for ms in request.exposures_ms})
