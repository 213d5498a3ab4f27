"""Restoring the photograph of a record by a chosen method, and saving it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.photograph_file import coded, written
from labapp.files.places import require_photograph
from labapp.files.writing import write_whole
from labapp.pictures.reconstructing.asked import AskedProblem
from labapp.pictures.reconstructing.methods import Wish
from labapp.pictures.reconstructing.problem import Problem
from labapp.pictures.reconstructing.restoring import Outcome, restore_picture
from labapp.window.messages import Reconstruct, Reconstructed
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class Restoration:
    """A restored photograph, kept until it is saved or another one comes."""

    path: Path
    problem: Problem
    outcome: Outcome

    @property
    def report(self) -> Reconstructed:
        """As the window shows it."""
        problem, outcome = self.problem, self.outcome
        band, known = outcome.bands[0], problem.reference
        scores = None
        if outcome.scores is not None:
            was, now = outcome.scores
            scores = (was.psnr, was.ssim), (now.psnr, now.ssim)
        return Reconstructed(
            path=self.path,
            source=problem.source.removeprefix(f"{self.path}, "),
            before=_shown(problem.light, problem.white),
            after=_shown(outcome.light, problem.white),
            neutral=None if known is None else _shown(known.light, problem.white),
            psf=problem.psf[0],
            scores=scores,
            method=outcome.method,
            noise=band.noise,
            noise_source=problem.noise_source(band.noise),
            unit=problem.unit,
            weight=band.weight,
            iterations=band.iterations,
            residual=outcome.residual,
            verdict=outcome.verdict,
            cpu_seconds=outcome.cpu_seconds,
        )

    def save(self, path: Path) -> None:
        """By the file's ending; UserError for one that isn't known."""
        require_photograph(path)
        if not path.parent.is_dir():
            raise UserError(f"{path.parent}: is not a folder. Choose another place.")
        problem = self.problem
        write_whole(path, written(path, self.outcome.light, problem.coded, problem.white))


def reconstruct(command: Reconstruct, progress: Progress) -> Restoration:
    """UserError for a record without photograph or star, or a time in which nothing fits."""
    problem = AskedProblem(command.path).problem(progress.part(0, 0.4))
    wish = Wish(command.method, command.budget)
    if command.budget is not None:
        wish = Wish(command.method, command.budget, speed=machine_speed(progress))
    try:
        outcome = restore_picture(problem, wish, progress.part(0.4, 1))
    except ValueError as error:
        raise UserError(f"{command.path}: {error}.") from error
    return Restoration(command.path, problem, outcome)


def _shown(light: NDArray[np.floating], white: float) -> NDArray[np.uint8]:
    return coded(light[0] / white)
