"""Restoration of a record's photograph by a chosen method, to be shown and saved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from labapp.common.errors import UserError
from labapp.common.speed import machine_speed
from labapp.files.output_paths import require_photograph_ending
from labapp.files.picture.photograph_writing import encode_srgb
from labapp.files.writing import write_atomically
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.recorded_photograph import RecordSelection
from labapp.pictures.reconstructing.restoration import RestoredPicture, restore_picture
from labapp.pictures.reconstructing.restoration_request import RestorationRequest
from labapp.window.commands import ReconstructRun
from labapp.window.messages import ReconstructionResult
from optics.progress import Progress


@dataclass(frozen=True, eq=False)
class Restoration:
    """A restored photograph, kept until another one replaces it."""

    path: Path
    problem: RestorationProblem
    outcome: RestoredPicture

    @property
    def result_message(self) -> ReconstructionResult:
        """Return the restored photograph as a message to the window."""
        problem, outcome = self.problem, self.outcome
        band, known = outcome.bands[0], problem.reference
        scores = None
        if outcome.scores is not None:
            was, now = outcome.scores
            scores = (was.psnr, was.ssim), (now.psnr, now.ssim)
        return ReconstructionResult(
            path=self.path,
            source=problem.source.removeprefix(f"{self.path}, "),
            before=encode_srgb(problem.screen_picture(problem.blurred_bands)),
            after=encode_srgb(problem.screen_picture(outcome.light)),
            neutral=None if known is None else encode_srgb(problem.screen_picture(known.light)),
            psf=problem.psf.mean(0),
            scores=scores,
            method=outcome.method,
            noise=band.noise,
            noise_source=_noise_words(problem, outcome),
            unit=problem.unit,
            weight=band.weight,
            iterations=band.iterations,
            residual=outcome.residual,
            verdict=outcome.verdict,
            cpu_seconds=outcome.cpu_seconds,
        )

    def save(self, path: Path) -> None:
        """Save the picture in the format of the file's ending; UserError if that isn't known."""
        require_photograph_ending(path)
        if not path.parent.is_dir():
            raise UserError(f"{path.parent}: is not a folder. Choose another place.")
        write_atomically(path, self.problem.encode_file(path, self.outcome.light))


def reconstruct_record(command: ReconstructRun, progress: Progress) -> Restoration:
    """Restore the photograph of a record.

    Raises UserError if the record has no photograph or no star, or if no method fits the time.
    """
    choice = RecordSelection(grey=command.grey)
    request = RestorationRequest(command.path, choice=choice)
    try:
        problem = request.read_problem(progress.part(0, 0.4))
    except UserError as error:
        raise UserError(f"{error}{_bands_hint(error)}") from error
    wish = MethodChoice(command.method, command.budget)
    if command.budget is not None:
        wish = MethodChoice(command.method, command.budget, speed=machine_speed(progress))
    try:
        outcome = restore_picture(problem, wish, progress.part(0.4, 1))
    except ValueError as error:
        raise UserError(f"{command.path}: {error}.") from error
    return Restoration(command.path, problem, outcome)


def _noise_words(problem: RestorationProblem, outcome: RestoredPicture) -> str:
    """Say how the noise is known, and what a variance map gained."""
    told = outcome.noise_source(problem)
    return f"{told}; variance map {outcome.variance_words}" if outcome.variance_uses else told


def _bands_hint(error: UserError) -> str:
    """Return what to do if a photograph has several wavelengths; else nothing."""
    if "--wavelength-nm" not in str(error):
        return ""
    return " Or tick Bands, to restore a spectral cube from all of them."
