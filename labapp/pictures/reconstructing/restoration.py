"""A problem restored, band by band, and how far to trust it in words."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch

from labapp.files.photograph_file import Light
from labapp.pictures.analysis.score import Score
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from optics.deconvolution.observation import Observation
from optics.deconvolution.restored_image import RestoredImage
from optics.fourier import irfft2, rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_LEAST, _MOST = 0.8, 1.2
"""Residuals between which what is left of the photograph looks like its noise."""


@dataclass(frozen=True, eq=False)
class RestoredPicture:
    """A restored picture, (bands, rows, columns).

    residual_map: what its blur leaves of the photograph, over the noise; NaN where that isn't
    known. bands: what each method said. residual: of all bands, rms. cpu_seconds: of the process.
    scores: before and after, where the problem has a reference.
    """

    light: Light
    residual_map: Light
    bands: tuple[RestoredImage, ...]
    residual: float
    cpu_seconds: float
    scores: tuple[Score, Score] | None = None

    @property
    def method(self) -> str:
        return " / ".join(dict.fromkeys(band.method for band in self.bands))

    @property
    def verdict(self) -> str:
        """What the residual means."""
        return describe_residual(self.residual)


@single_threaded
def restore_picture(
    problem: RestorationProblem, wish: MethodChoice, progress: Progress
) -> RestoredPicture:
    """Each band by itself; ValueError for a problem that can't be restored.

    One thread, so that the same problem gives the same bits wherever it is restored.
    """
    seen, started = problem.observations(), time.process_time()
    share = 1 / len(seen)
    found = tuple(
        wish.restore(
            band,
            share,
            progress.part(number * share, (number + 1) * share),
            problem.planned_iterations,
        )
        for number, band in enumerate(seen)
    )
    residual = float(np.sqrt(np.mean([band.residual**2 for band in found])))
    spent = time.process_time() - started
    progress.report(1, "restored")
    light = np.stack([band.image.numpy().astype(np.float32) for band in found])
    left = np.stack(
        [_normalised_residual(one, band) for one, band in zip(seen, found, strict=True)]
    )
    known = problem.reference
    scores = None if known is None else (known.score(problem.light), known.score(light))
    return RestoredPicture(light, left, found, residual, spent, scores)


def describe_residual(residual: float) -> str:
    """What a residual, rms over the noise, says to a person."""
    if residual > _MOST:
        return "above 1.2: model, PSF or noise doesn't fit"
    if residual < _LEAST:
        return "below 0.8: the noise is less than it was taken for, or some was made detail"
    return "good: what is left looks like noise"


@torch.no_grad()
def _normalised_residual(observation: Observation, restored: RestoredImage) -> Light:
    """The photograph less the blurred restoration, over the noise."""
    whole = (
        observation.extended_image * 0 if restored.period_image is None else restored.period_image
    )
    if restored.period_image is None:
        observation.crop_to_frame(whole).copy_(restored.image)
    light = irfft2(rfft2(whole) * observation.otf, observation.period_shape)
    left = (
        (
            (observation.normalised_image - observation.crop_to_frame(light))
            / observation.scene_noise
        )
        .numpy()
        .astype(np.float32)
    )
    if observation.effective_weights is not None:
        left[(observation.effective_weights <= 0).numpy()] = np.nan
    if restored.period_image is None and not observation.is_fully_measured:
        # What came into the frame from around it isn't known: only the inside is.
        top, side = (n // 2 for n in observation.psf.shape)
        inside = np.zeros(left.shape, dtype=bool)
        inside[top : left.shape[0] - top, side : left.shape[1] - side] = True
        left[~inside] = np.nan
    return left
