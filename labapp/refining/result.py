"""The result of a refinement: its pictures, and the design that the best of them showed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from labapp.files.bench_file import BenchFile
from labapp.files.design_file import DesignContents, Grid
from labapp.prediction.pattern_psf import predicted_psf
from labapp.refining.psf_measurement import MeasuredPSF
from labapp.refining.refinement_request import RefinementRequest
from labapp.refining.sensor_view import SensorView
from labapp.refining.start import RefinementStart
from optics.progress import Progress
from optics.retrieval.phase_retrieval import measure_quality
from optics.retrieval.slow_crystal import displayed_psf


@dataclass(frozen=True, eq=False)
class RefinementResult:
    """All measured PSFs, and the phases of the best one.

    pictures are in the order in which they were taken. phases are (frames, rows, columns), rad.
    """

    start: RefinementStart
    request: RefinementRequest
    view: SensorView
    pictures: Sequence[MeasuredPSF]
    phases: torch.Tensor

    @cached_property
    def best(self) -> int:
        """Index of the picture with the least error; 0 is the start."""
        errors = [seen.nrmse for seen in self.pictures]
        return errors.index(min(errors))

    @property
    def refinement_record(self) -> dict[str, Any]:
        """Account of all pictures as plain data; they count from 1, as their records do."""
        return {
            "registration": "calibrated" if self.view.is_calibrated else "described",
            "best": self.best + 1,
            "pictures": [
                {
                    "record": str(seen.record),
                    "nrmse": seen.nrmse,
                    "noise": seen.noise,
                    "contrast": seen.contrast,
                    "central": seen.central,
                }
                for seen in self.pictures
            ],
        }


def refined_design_contents(
    result: RefinementResult,
    design: Path,
    before: DesignContents,
    bench: BenchFile,
    progress: Progress,
) -> DesignContents:
    """Return the contents of the new design file; `before` holds those of the file `design`."""
    start, goal = result.start, result.start.goal
    camera, phases = goal.camera, result.phases
    greys = start.grey_levels(phases)
    rows, columns = before.psf.images.shape[1:]
    pixels = camera.sensor.window_plane((rows, columns))
    psf = predicted_psf(camera, torch.from_numpy(greys), goal.wavelength, pixels, progress)
    quality = measure_quality(goal, displayed_psf(goal, phases, start.orders))
    figures = {
        "efficiency": [quality.efficiency],
        "steered_share": [quality.steered_share],
        "contrast": [quality.contrast],
        "nrmse": [quality.nrmse],
        "seen_nrmse": [seen.nrmse for seen in result.pictures],
    }
    target = goal.target / goal.target.sum()
    return replace(
        before,
        settings=_settings(result, design, before.settings),
        bench=bench.model_dump(mode="json"),
        grey=greys,
        phase=phases.numpy(),
        frame_time=1 / camera.panel.frame_rate if start.frames > 1 else 0.0,
        psf=Grid.from_tensor(psf, pixels),
        target=Grid.from_tensor(target[None], goal.plane),
        quality={**before.quality, **figures},
    )


def _settings(result: RefinementResult, design: Path, before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the new design, with this refinement added to earlier ones."""
    account = {
        "from": str(design.resolve()),
        "request": result.request.model_dump(mode="json"),
        **result.refinement_record,
    }
    return {**before, "refined": [*before.get("refined", []), account]}
