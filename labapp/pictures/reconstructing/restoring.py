"""A problem restored, band by band, and how far to trust it in words."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch

from labapp.files.photograph_file import Light
from labapp.pictures.analysis.score import Score
from labapp.pictures.reconstructing.methods import Wish
from labapp.pictures.reconstructing.problem import Problem
from optics.deconvolution.blurred import Blurred
from optics.deconvolution.restored import Restored
from optics.fourier import irfft2, rfft2
from optics.progress import Progress
from optics.threads import single_threaded

_LEAST, _MOST = 0.8, 1.2
"""Residuals between which what is left of the photograph looks like its noise."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """A restored picture, (bands, rows, columns).

    left: what its blur leaves of the photograph, over the noise; NaN where that isn't known.
    bands: what each method said. residual: of all bands, rms. cpu_seconds: of the process. scores:
    before and after, where the problem has a reference.
    """

    light: Light
    left: Light
    bands: tuple[Restored, ...]
    residual: float
    cpu_seconds: float
    scores: tuple[Score, Score] | None = None

    @property
    def method(self) -> str:
        return " / ".join(dict.fromkeys(band.method for band in self.bands))

    @property
    def verdict(self) -> str:
        """What the residual means."""
        return verdict(self.residual)


@single_threaded
def restore_picture(problem: Problem, wish: Wish, progress: Progress) -> Outcome:
    """Each band by itself; ValueError for a problem that can't be restored.

    One thread, so that the same problem gives the same bits wherever it is restored.
    """
    seen, started = problem.bands(), time.process_time()
    share = 1 / len(seen)
    found = tuple(
        wish.restore(
            band, share, progress.part(number * share, (number + 1) * share), problem.counts
        )
        for number, band in enumerate(seen)
    )
    residual = float(np.sqrt(np.mean([band.residual**2 for band in found])))
    spent = time.process_time() - started
    progress.report(1, "restored")
    light = np.stack([band.image.numpy().astype(np.float32) for band in found])
    left = np.stack([_left(one, band) for one, band in zip(seen, found, strict=True)])
    known = problem.reference
    scores = None if known is None else (known.score(problem.light), known.score(light))
    return Outcome(light, left, found, residual, spent, scores)


def verdict(residual: float) -> str:
    """What a residual, rms over the noise, says to a person."""
    if residual > _MOST:
        return "above 1.2: model, PSF or noise doesn't fit"
    if residual < _LEAST:
        return "below 0.8: the noise is less than it was taken for, or some was made detail"
    return "good: what is left looks like noise"


@torch.no_grad()
def _left(seen: Blurred, restored: Restored) -> Light:
    """The photograph less the blurred restoration, over the noise."""
    whole = seen.continued * 0 if restored.whole is None else restored.whole
    if restored.whole is None:
        seen.frame(whole).copy_(restored.image)
    light = irfft2(rfft2(whole) * seen.transfer, seen.whole)
    left = ((seen.data - seen.frame(light)) / seen.deviation).numpy().astype(np.float32)
    if seen.trust is not None:
        left[(seen.trust <= 0).numpy()] = np.nan
    if restored.whole is None and not seen.complete:
        # What came into the frame from around it isn't known: only the inside is.
        top, side = (n // 2 for n in seen.psf.shape)
        inside = np.zeros(left.shape, dtype=bool)
        inside[top : left.shape[0] - top, side : left.shape[1] - side] = True
        left[~inside] = np.nan
    return left
