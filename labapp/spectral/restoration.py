"""Restore the spectral cube of a coded snapshot, and score it against the true one."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.files.cubes import SpectralCube
from labapp.files.wavelengths import format_nanometres
from labapp.spectral.lights import ViewingLight
from labapp.spectral.problem import SpectralProblem
from labapp.spectral.refinement import refine_problem
from labapp.spectral.scores import CubeScores, require_same_kind, score_cube
from optics.inverse.restored_image import RestoredImage, residual_map
from optics.inverse.verdict import Verdict, judge_restoration
from optics.multispectral import SnapshotCalibration, estimate_error_map, restore_spectra
from optics.progress import Progress
from optics.threads import single_threaded

_RESTORING_SHARE = 0.85  # of the progress; scores and colours take the rest


@dataclass(frozen=True, eq=False)
class RestoredCube:
    """A spectral cube that was restored from a coded snapshot.

    Attributes
    ----------
    problem : SpectralProblem
        What was restored, with PSFs and response as refined if the photograph refined them.
    cube : SpectralCube
        The restored cube, in shares of white.
    truth : SpectralCube or None
        The true cube, if it is known.
    scores : CubeScores or None
        How far the cube is from the true one.
    image : RestoredImage
        Result of the method, with residual, weight and convergence.
    residual_map : NDArray, (rows, columns)
        The snapshot less the blurred cube, over the noise; NaN where it isn't known.
    verdict : Verdict
        Whether snapshot, PSFs and noise fit together.
    doubts : str
        Which bands the filters hardly tell apart, in words; empty if there are none.
    white : float
        Electrons per second that count as 1.
    cpu_seconds : float
        Processor time in seconds.
    calibration : SnapshotCalibration or None
        The camera's model as the photograph refined it; None if it didn't.
    """

    problem: SpectralProblem
    cube: SpectralCube
    truth: SpectralCube | None
    scores: CubeScores | None
    image: RestoredImage
    residual_map: NDArray[np.floating]
    verdict: Verdict
    doubts: str
    white: float
    cpu_seconds: float
    calibration: SnapshotCalibration | None = None


@single_threaded
def restore_snapshot(
    problem: SpectralProblem,
    light: ViewingLight,
    *,
    weight: float | None = None,
    progress: Progress | None = None,
) -> RestoredCube:
    """Restore the spectral cube of a coded snapshot.

    It runs in one thread, so that the same problem always gives the same bits.

    Parameters
    ----------
    problem : SpectralProblem
        Snapshot, PSFs, response and, if it is known, the truth. Its prior, if it has one, is
        refined from the photograph first.
    light : ViewingLight
        Light in which colours are compared with the truth.
    weight : float, optional
        Regularisation weight; chosen from the snapshot if None. A refinement always chooses it.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredCube
        The cube with its scores, residual and verdict.

    Raises
    ------
    ValueError
        If the snapshot can't be restored.
    UserError
        If the true cube has other bands or pixels, or the bands lie beyond what typical spectra
        cover.
    """
    progress, started = progress or Progress(), time.process_time()
    if problem.given_truth is not None:
        empty = np.zeros((len(problem.wavelengths), *problem.rate.shape))
        require_same_kind(problem.as_cube(empty, 1.0, ""), problem.given_truth)
    part, refined = progress.part(0, _RESTORING_SHARE), None
    if problem.prior is not None:
        problem, refined, found = refine_problem(problem, part)
    else:
        spectra = torch.from_numpy(problem.spectra)
        found = restore_spectra(problem.observation, spectra, weight=weight, progress=part)
    bands = torch.as_tensor(found.image).numpy()
    white = problem.white_level(bands)
    half_width, doubts = None, ""
    if bands.max() > 0:
        labels = [format_nanometres(one) for one in problem.wavelengths]
        errors = estimate_error_map(problem.observation, found, problem.spectra, labels=labels)
        half_width, doubts = torch.as_tensor(errors.half_width).numpy(), errors.message
    words = f"Restored from {problem.source}, by {found.method}"
    cube = problem.as_cube(bands, white, words, half_width)
    progress.report(_RESTORING_SHARE, "scores")
    truth, known = problem.given_truth, problem.equalised_truth
    if truth is None and known is not None:
        truth = problem.as_cube(known, white, problem.truth_source)
    return RestoredCube(
        problem,
        cube,
        truth,
        None if truth is None else score_cube(cube, truth, light),
        found,
        residual_map(problem.observation, found).numpy(),
        judge_restoration(problem.observation, found, None),
        doubts,
        white,
        time.process_time() - started,
        refined,
    )
