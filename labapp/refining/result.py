"""What a refinement came to: its pictures, and the design that the best of them showed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from labapp.files.bench_file import BenchFile
from labapp.files.design_file import DesignContents, Grid
from labapp.light.predicted import predicted_psf
from labapp.refining.request import Request
from labapp.refining.start import Start
from labapp.refining.view import View
from labapp.refining.watching import Seen
from optics.progress import Progress
from optics.retrieval.judging import judge
from optics.retrieval.slow_crystal import shown_light


@dataclass(frozen=True, eq=False)
class Result:
    """pictures: in the order in which they were taken. phases: of the best one."""

    start: Start
    request: Request
    view: View
    pictures: Sequence[Seen]
    phases: torch.Tensor

    @cached_property
    def best(self) -> int:
        """Which picture was the best one; 0 is the start."""
        errors = [seen.nrmse for seen in self.pictures]
        return errors.index(min(errors))

    @property
    def account(self) -> dict[str, Any]:
        """How it was refined, for programs; pictures count from 1, as their records do."""
        return {
            "registration": "calibrated" if self.view.calibrated else "described",
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


def contents_of(
    result: Result, design: Path, before: DesignContents, bench: BenchFile, progress: Progress
) -> DesignContents:
    """The refined design's file; `before` is what `design` holds."""
    start, goal = result.start, result.start.goal
    camera, phases = goal.camera, result.phases
    greys = start.greys(phases)
    rows, columns = before.psf.images.shape[1:]
    pixels = camera.sensor.window((rows, columns))
    psf = predicted_psf(camera, torch.from_numpy(greys), goal.wavelength, pixels, progress)
    quality = judge(goal, shown_light(goal, phases, start.orders))
    figures = {
        "efficiency": [quality.efficiency],
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
        psf=Grid.of(psf, pixels),
        target=Grid.of(target[None], goal.plane),
        quality={**before.quality, **figures},
    )


def _settings(result: Result, design: Path, before: Mapping[str, Any]) -> dict[str, Any]:
    """The design's own, and how it was refined, each time that it was."""
    account = {
        "from": str(design.resolve()),
        "request": result.request.model_dump(mode="json"),
        **result.account,
    }
    return {**before, "refined": [*before.get("refined", []), account]}
