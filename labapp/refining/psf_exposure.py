"""Take one picture of a PSF: run a plan into a record, and merge its bracket."""

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
from labapp.files.sensor_file import require_monochrome_sensor
from labapp.pictures.analysis.brackets import Bracket, find_bracket, merge_all
from labapp.refining.refinement_request import RefinementRequest
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete
from optics.progress import Progress


def picture_name(number: int) -> str:
    """Return the name of a picture, from 1, for its record, folder and pattern."""
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
    """Take a picture with these grey levels on the SLM, and return the merged bracket.

    The grey levels are (frames, rows, columns). The bracket is in electrons per second. Plan and
    patterns are written to `folder`/picture-N/, and the frames to `folder`/picture-N.h5. Raises
    UserError if the bench or the run fails, and Cancelled if the progress was cancelled.
    """
    name, path = picture_name(number), record_path(folder, number)
    plan = build_plan(request, wavelength_nm, number, len(greys), bench.slm.frame_time)
    pictures = [one for one, pattern in plan.patterns.items() if isinstance(pattern, ImagePattern)]
    source = write_plan(folder / name, plan, dict(zip(pictures, greys, strict=True)))
    # The run has most of the picture's progress; merging has the rest.
    running, merging = progress.part(0, 0.9), progress.part(0.9, 1)
    outcome = run_plan(
        bench,
        plan,
        path,
        Attendance(progress=running, ask=ask),
        source=str(source),
        folder=source.parent,
        force=force,
    )
    require_complete(outcome)
    with Record(path) as record:
        require_monochrome_sensor(record.camera.sensor, "labapp refine")
        brackets = merge_all(record, merging)
    return find_bracket(brackets, "star", name, None, path)


def build_plan(
    request: RefinementRequest, wavelength_nm: float, number: int, frames: int, frame_time: float
) -> PlanFile:
    """Plan a picture of the star with a still or video, after dark frames.

    Each exposure has two dark frames. `frame_time` is the time in seconds for which a frame of a
    video is shown.
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
        blocks.insert(0, block | {"targets": ["dark"], "role": "dark", "repeats": 2})
        targets |= {"dark": {"place": request.dark}}
    return PlanFile.model_validate(
        {
            "version": 1,
            "title": f"Refinement, picture {number}",
            # A seed of its own gives each picture of a virtual bench its own noise.
            "seed": number,
            "targets": targets,
            "patterns": patterns,
            "acquire": blocks,
        }
    )


def whole_periods(request: RefinementRequest, period: float) -> list[int]:
    """Convert exposures to whole video periods, rounded up, without duplicates.

    `period` is in seconds.
    """
    return sorted({max(1, math.ceil(ms * 1e-3 / period - 1e-6)) for ms in request.exposures_ms})
