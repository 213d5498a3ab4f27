"""From a record to pictures and figures: merge, measure the PSF, predict it, undo it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.plan_file import Reconstruction
from labapp.files.scene_file import PhotographTable
from labapp.pictures.analysis.brackets import Bracket, Picture, find, merge_all
from labapp.pictures.analysis.photograph import Score, reconstruct, score
from labapp.pictures.analysis.star import PSFReport, measure_psf
from labapp.runs.record.reader import Record
from labapp.runs.state import State
from optics.progress import Progress


@dataclass
class Analysis:
    """Everything that a report shows.

    images: neutral, coded and restored photographs on one scale, white about 1; empty
    without a [reconstruct] table. scores: of all but the neutral one, against it.
    seconds: wall-clock time of each stage. credit: who made the photograph.
    """

    title: str
    simulated: list[str]
    credit: str
    brackets: list[Bracket]
    roles: Reconstruction | None = None
    pattern: NDArray[np.uint8] | None = None
    psf: PSFReport | None = None
    images: dict[str, Picture] = field(default_factory=dict)
    scores: dict[str, Score] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def psf_measured(self) -> Picture | None:
        return self.psf.measured if self.psf else None

    @property
    def best(self) -> str | None:
        """The reconstruction with the highest PSNR."""
        undone = {name: s.psnr for name, s in self.scores.items() if name != "coded"}
        return max(undone, key=lambda name: undone[name]) if undone else None


def analyse(path: Path, progress: Progress | None = None) -> Analysis:
    """Merge every bracket of a record; with a [reconstruct] table, also undo the coding.

    UserError if frames that are needed are missing.
    """
    progress, watch = progress or Progress(), Stopwatch()
    with Record(path) as record:
        plan = record.plan
        with watch.stage("merge exposures"):
            brackets = merge_all(record, plan, progress.part(0, 0.3))
        analysis = Analysis(
            plan.title, record.simulated, _credit(record), brackets, seconds=watch.seconds
        )
        roles = plan.reconstruct
        if roles is None:
            return analysis
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{path}: the run is {record.state}, and a reconstruction needs all of its "
                "frames. Run the plan again."
            )
        shown = record.pattern(roles.coded)
        # Of a video the first frame stands for all.
        analysis.roles, analysis.pattern = roles, shown if shown.ndim == 2 else shown[0]
        with watch.stage("measure PSF"):
            analysis.psf = measure_psf(record, brackets, roles)
    neutral = find(brackets, roles.photograph, roles.neutral, roles.wavelength, path)
    coded = find(brackets, roles.photograph, roles.coded, roles.wavelength, path)
    analysis.images = reconstruct(
        neutral, coded, analysis.psf.measured, roles.iterations, watch, progress.part(0.4, 0.95)
    )
    with watch.stage("judge"):
        reference = analysis.images["neutral"]
        analysis.scores = {
            name: score(picture, reference)
            for name, picture in analysis.images.items()
            if name != "neutral"
        }
    progress.report(1.0, "reconstructed")
    return analysis


def _credit(record: Record) -> str:
    """Who made the photographs of a simulated scene."""
    tables = record.scene.targets.values() if record.scene else ()
    return ", ".join(t.credit for t in tables if isinstance(t, PhotographTable) and t.credit)
