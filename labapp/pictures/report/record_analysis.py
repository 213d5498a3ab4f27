"""Analyse a record for its report: merge frames, measure the PSF, restore the photograph."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.stopwatch import Stopwatch
from labapp.files.plan_file import Reconstruction
from labapp.files.scene_file import PhotographTable
from labapp.pictures.analysis.brackets import Bracket, Picture, find_bracket, merge_all
from labapp.pictures.analysis.score import Score
from labapp.pictures.analysis.star_psf import PSFReport, measure_psf
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.recorded_photograph import find_photograph
from labapp.pictures.reconstructing.restoration import RestoredPicture, restore_picture
from labapp.runs.record.reader import Record
from labapp.runs.recorded_calibrations import calibrations_in_force, stale_calibrations
from labapp.runs.state import State
from optics.inverse.choice import METHODS
from optics.inverse.method_names import RESTORATIONS
from optics.progress import Progress

__all__ = ["RecordAnalysis", "analyse_record"]


@dataclass
class RecordAnalysis:
    """Results of a record that its report shows.

    Without a [reconstruct] table in the plan there are no restored pictures, images and scores.

    Parameters
    ----------
    title : str
        Title of the plan.
    simulated : list of str
        Names of simulated devices.
    credit : str
        Who made the photograph of a simulated scene.
    brackets : list of Bracket
        Merged exposures.
    roles : Reconstruction or None
        The [reconstruct] table of the plan.
    pattern : NDArray or None
        Grey levels of the coded pattern, (rows, columns).
    psf : PSFReport or None
        Measured PSF.
    restored_pictures : dict
        Results of the reported restorations, by method, as `labapp reconstruct` gives them.
    images : dict
        Neutral, coded and restored photographs on one scale, with white at about 1: (rows,
        columns), or (rows, columns, 3) in linear sRGB.
    scores : dict
        Scores of the coded and restored photographs against the neutral one.
    seconds : dict
        Wall-clock time of each stage in seconds.
    calibrations : list of str
        Calibrations that were in force, a line each.
    doubts : list of str
        Why these calibrations may not have held.
    """

    title: str
    simulated: list[str]
    credit: str
    brackets: list[Bracket]
    roles: Reconstruction | None = None
    pattern: NDArray[np.uint8] | None = None
    psf: PSFReport | None = None
    restored_pictures: dict[str, RestoredPicture] = field(default_factory=dict)
    images: dict[str, Picture] = field(default_factory=dict)
    scores: dict[str, Score] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    calibrations: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    @property
    def variance_words(self) -> dict[str, str]:
        """Say in words how each restoration of the report used the variance map, by method."""
        return {
            name: one.variance_words
            for name, one in self.restored_pictures.items()
            if one.variance_uses
        }

    @property
    def best_method(self) -> str | None:
        """Return the name of the method whose restored picture has the highest PSNR."""
        undone = {name: s.psnr for name, s in self.scores.items() if name != "coded"}
        return max(undone, key=lambda name: undone[name]) if undone else None


def analyse_record(
    path: Path, progress: Progress | None = None, *, readout: int | None = None
) -> RecordAnalysis:
    """Analyse recorded pictures: merge brackets, measure the PSF, and restore the photograph.

    The last two need a [reconstruct] table in the record's plan.

    Parameters
    ----------
    path : Path
        Record of a run.
    progress : Progress or None
        Receives the progress, and may cancel.
    readout : int, optional
        Number of the way in which the sensor was read, where the run had several.

    Returns
    -------
    RecordAnalysis
        Merged pictures, PSF, restored photographs and scores.

    Raises
    ------
    UserError
        If frames that the reconstruction needs are missing.
    """
    progress, watch = progress or Progress(), Stopwatch()
    with Record(path, readout=readout) as record:
        plan = record.plan
        with watch.stage("merge exposures"):
            brackets = merge_all(record, progress.part(0, 0.3))
        analysis = RecordAnalysis(
            plan.title, record.simulated_devices, _credit(record), brackets, seconds=watch.seconds,
            calibrations=calibrations_in_force(record), doubts=stale_calibrations(record),
        )  # fmt: skip
        roles = plan.reconstruct
        if roles is None:
            return analysis
        if record.state is not State.COMPLETE:
            raise UserError(
                f"{path}: the run is {record.state}, and a reconstruction needs all of its "
                "frames. Run the plan again."
            )
        shown = record.pattern(roles.coded)
        # The report shows the first frame of a video.
        analysis.roles, analysis.pattern = roles, shown if shown.ndim == 2 else shown[0]
        with watch.stage("measure PSF"):
            analysis.psf = measure_psf(record, brackets, roles)
        # This raises UserError if the neutral photograph, which scores restorations, is missing.
        find_bracket(brackets, roles.photograph, roles.neutral, roles.wavelength, path)
        problem = find_photograph(record, brackets, roles).build_problem()
    _restore(analysis, problem, watch, progress.part(0.4, 0.95))
    progress.report(1.0, "reconstructed")
    return analysis


def _restore(
    analysis: RecordAnalysis, problem: RestorationProblem, watch: Stopwatch, progress: Progress
) -> None:
    known = problem.reference
    if known is None:
        raise UserError(
            f"{problem.source}: the neutral photograph is dark, or is the coded one itself, so "
            "that nothing can be judged by it. Expose it longer, or name another 'neutral'."
        )
    light = {"neutral": known.light, "coded": problem.blurred_bands}
    analysis.images = {
        name: problem.screen_picture(one).astype(np.float64) for name, one in light.items()
    }
    names = [name for name, one in RESTORATIONS.items() if one.reported]
    if problem.filters is not None:
        names = [name for name, method in METHODS.items() if method.restores_bands]
    for number, name in enumerate(names):
        part = progress.part(number / len(names), (number + 1) / len(names))
        with watch.stage(RESTORATIONS[name].title):
            outcome = restore_picture(problem, MethodChoice(name), part)
        analysis.restored_pictures[name] = outcome
        analysis.images[name] = problem.screen_picture(outcome.light).astype(np.float64)
        assert outcome.scores is not None
        analysis.scores["coded"], analysis.scores[name] = outcome.scores


def _credit(record: Record) -> str:
    """Return who made the photographs in the simulated scene of the recorded pictures."""
    tables = record.scene.targets.values() if record.scene else ()
    return ", ".join(t.credit for t in tables if isinstance(t, PhotographTable) and t.credit)
