"""The result of a refinement: its pictures, the design that the best showed, and the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from labapp.common.console import out, print_json, print_message, print_table
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
                {"record": str(seen.record)}
                | {name: getattr(seen, name) for name in ("nrmse", "noise", "contrast", "central")}
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
    account = {
        "from": str(design.resolve()),
        "request": result.request.model_dump(mode="json"),
        **result.refinement_record,
    }
    target = goal.target / goal.target.sum()
    return replace(
        before,
        # This refinement is added to earlier ones.
        settings={**before.settings, "refined": [*before.settings.get("refined", []), account]},
        bench=bench.model_dump(mode="json"),
        grey=greys,
        phase=phases.numpy(),
        frame_time=1 / camera.panel.frame_rate if start.frames > 1 else 0.0,
        psf=Grid.from_tensor(psf, pixels),
        target=Grid.from_tensor(target[None], goal.plane),
        quality={**before.quality, **figures},
    )


def print_report(result: RefinementResult, files: list[Path], *, as_json: bool) -> None:
    """Print the errors of all pictures, advice, and the files written."""
    label = result.start.spec.label
    if as_json:
        print_json(
            {
                "pattern": label,
                "files": [str(file) for file in files],
                **result.refinement_record,
                "advice": advice(result),
            }
        )
        return
    columns = ["picture", "error of the shape ", "noise alone ", "speckle contrast ", "record"]
    rows = [
        [
            f"{number + 1}{' (best)' if number == result.best else ''}",
            *(f"{value:.4f}" for value in (seen.nrmse, seen.noise, seen.contrast)),
            seen.record.name,
        ]
        for number, seen in enumerate(result.pictures)
    ]
    print_table(label, columns, rows)
    for line in advice(result):
        print_message(line)
    wrote = [f"wrote {file}" for file in files]
    wrote.append(f"records in {result.pictures[0].record.parent}")
    out.print("\n".join(wrote), soft_wrap=True)


def advice(result: RefinementResult) -> list[str]:
    """Say what would give a better result; empty if nothing."""
    said, best = [], result.pictures[result.best]
    if result.best == 0:
        said.append(
            "no picture was better than the first: the design is as good as it was. Calibrate the "
            "wavefront, check the registration, or take more pictures (--pictures)."
        )
    # The zeroth order makes more than half of the squared error.
    if best.central > 0.5:
        said.append(
            f"{best.central:.0%} of the error that is left is light in the middle: what the panel "
            "doesn't modulate stays there, whatever is shown. Design a shape beside the axis."
        )
    # Noise makes more than half of the error.
    if best.noise > 0.5 * best.nrmse:
        said.append(
            "much of the error that is left is noise of the pictures: expose longer "
            "(--exposures-ms)."
        )
    if result.best == len(result.pictures) - 1 and result.best > 0:
        said.append("the last picture was the best one: more of them may gain more (--pictures).")
    return said
