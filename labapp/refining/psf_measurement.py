"""Measure the PSF of the shown frames with the bench's camera, on the design grid.

A picture is an ordinary run: its plan and patterns are written, and its frames are a record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labapp.bench.opening import Bench
from labapp.common.errors import UserError
from labapp.files.grey_table import ImagePattern
from labapp.files.plan_file import PlanFile
from labapp.files.plan_folder import PATTERN_FOLDER, write_plan
from labapp.files.sensor_file import require_monochrome_sensor
from labapp.pictures.analysis.brackets import Bracket, find_bracket, merge_all
from labapp.refining.refinement_request import RefinementRequest
from labapp.refining.sensor_view import SensorView
from labapp.refining.start import RefinementStart
from labapp.runs.acquisition.attendance import AskOperator, Attendance
from labapp.runs.acquisition.runner import run_plan
from labapp.runs.record.reader import Record
from labapp.runs.run_commands import require_complete
from optics.metrics import scaled_nrmse, speckle_contrast
from optics.progress import Progress
from optics.retrieval.camera_feedback import JUDGED_TARGET_SHARE

_NOISE_VARIANCE_SHARE = 0.764
"""Share of the variance of white noise that remains after cubic spline interpolation between
pixels, averaged over all positions: the squared integral of the squared cardinal cubic spline."""


@dataclass(frozen=True, eq=False)
class MeasuredPSF:
    """A PSF that was photographed and resampled to the design grid.

    record: of the picture's frames.
    light: (rows, columns) float64, electrons per second and sensor pixel, at least 0.
    nrmse: error of its shape, where the target exceeds 2 % of its peak.
    noise: approximate error that the noise of the picture alone would make.
    contrast: speckle contrast, where the target exceeds half its peak, without the camera's noise.
    central: share of the squared error in the zeroth order, where unmodulated light falls.
    scale: factor by which the target fits the picture best.
    """

    record: Path
    light: torch.Tensor
    nrmse: float
    noise: float
    contrast: float
    central: float
    scale: float


@dataclass(frozen=True, eq=False)
class PSFMeasurer:
    """The camera that optics.retrieval.refine() measures PSFs with; it keeps all measurements.

    `folder` holds the records. With `force`, existing records may be replaced.
    """

    bench: Bench
    request: RefinementRequest
    start: RefinementStart
    view: SensorView
    folder: Path
    force: bool
    ask: AskOperator | None
    measurements: list[MeasuredPSF] = field(default_factory=list)

    def __call__(self, phases: torch.Tensor, progress: Progress) -> torch.Tensor:
        """Show phases (frames, rows, columns); return the measured PSF on the goal's plane.

        Plan and patterns are written to `folder`/picture-N/, and the frames to
        `folder`/picture-N.h5. Raises UserError if the bench or the run fails, and Cancelled if the
        progress was cancelled.
        """
        number = len(self.measurements) + 1
        name, path = picture_name(number), record_path(self.folder, number)
        greys = self.start.grey_levels(self.start.phases_on_panel(phases))
        wavelength_nm, frame_time = self.start.spec.wavelength_nm, self.bench.slm.frame_time
        plan = build_plan(self.request, wavelength_nm, number, len(greys), frame_time)
        stills = [one for one, spec in plan.patterns.items() if isinstance(spec, ImagePattern)]
        source = write_plan(self.folder / name, plan, dict(zip(stills, greys, strict=True)))
        # The run has most of the picture's progress; merging has the rest.
        running, merging = progress.part(0, 0.9), progress.part(0.9, 1)
        outcome = run_plan(
            self.bench,
            plan,
            path,
            Attendance(progress=running, ask=self.ask),
            source=str(source),
            folder=source.parent,
            force=self.force,
        )
        require_complete(outcome)
        with Record(path) as record:
            require_monochrome_sensor(record.camera.sensor, "labapp refine")
            brackets = merge_all(record, merging)
        bracket = find_bracket(brackets, "star", name, None, path)
        self.measurements.append(self._evaluate_bracket(bracket, path))
        return self.measurements[-1].light

    def _evaluate_bracket(self, bracket: Bracket, record: Path) -> MeasuredPSF:
        view, target = self.view, self.view.target
        bright = target > JUDGED_TARGET_SHARE * target.max()
        variance = view.resample_nearest(bracket.variance)
        self._require_unclipped(variance[bright], bracket, record)
        light = view.resample_picture(bracket.rate)
        wanted = target[bright]
        scale = float((light[bright] * wanted).sum() / wanted.square().sum())
        noise = float(
            (_NOISE_VARIANCE_SHARE * variance[bright].mean()).sqrt() / wanted.square().mean().sqrt()
        )
        if scale <= noise:
            raise UserError(
                f"{record}: the PSF can't be told from noise. Expose longer with --exposures-ms, "
                "and look whether the star is lit and lies where the calibration found it."
            )
        # Samples beside the sensor get the target's value, so that nothing is corrected there.
        light = torch.where(torch.from_numpy(view.on_sensor), light, scale * target).clamp(min=0)
        return MeasuredPSF(
            record,
            light,
            scaled_nrmse(light[bright], wanted),
            noise / scale,
            speckle_contrast(light, target, _NOISE_VARIANCE_SHARE * variance),
            self._central_error_share(light / scale - target, bright),
            scale,
        )

    def _central_error_share(self, error: torch.Tensor, bright: torch.Tensor) -> float:
        away = np.linalg.norm(
            self.view.sensor_positions - np.array(self.view.registration.centre), axis=-1
        )
        # Unmodulated light falls within 3 sensor pixels of the axis, beside the star's image.
        middle = torch.from_numpy(away < 3 + self.view.star_diameter / 2)
        squared = error.square()
        return float(squared[bright & middle].sum() / squared[bright].sum())

    def _require_unclipped(self, variance: torch.Tensor, bracket: Bracket, record: Path) -> None:
        """Raise UserError if PSF pixels are clipped in every exposure.

        The merged bracket gives such pixels an infinite variance.
        """
        clipped = int(np.isinf(variance.numpy()).sum())
        if not clipped:
            return
        shortest = min(bracket.exposures) * 1e3
        remedy = "Shorten it with --exposures-ms, or dim the lamp."
        if self.start.frames > 1:
            period = self.start.frames * self.bench.slm.frame_time * 1e3
            remedy = (
                f"A video's exposures are whole periods of {period:g} ms: dim the lamp, or make "
                "it of fewer frames."
            )
        raise UserError(
            f"{record}: {clipped / len(variance):.1%} of the PSF is clipped in every exposure; the "
            f"shortest is {shortest:g} ms. {remedy}"
        )


def picture_name(number: int) -> str:
    """Return the name of a picture, from 1, for its record, folder and pattern."""
    return f"picture-{number}"


def record_path(folder: Path, number: int) -> Path:
    return folder / f"{picture_name(number)}.h5"


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
    """Convert exposures to whole video periods of so many seconds, rounded up, each once."""
    return sorted({max(1, math.ceil(ms * 1e-3 / period - 1e-6)) for ms in request.exposures_ms})
