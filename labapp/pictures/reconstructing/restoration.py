"""Restore a picture band by band, and judge by its residual how far to trust it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light
from labapp.pictures.analysis.score import Score
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from labapp.pictures.reconstructing.variance_use import (
    VarianceUse,
    choose_variance,
    why_without_map,
)
from optics.inverse.observation import Observation
from optics.inverse.restored_image import RestoredImage, residual_map
from optics.inverse.verdict import PSFScale, Verdict, judge_restoration, refine_psf_scale
from optics.progress import Progress
from optics.threads import single_threaded

_TRIAL_BUDGET, _RESTORING_SHARE = 2.0, 0.8
"""Seconds of a band's budget from which the scale of its PSF and the gain of its variance map are
looked for, and the share of the budget that is then left for the restoration."""


@dataclass(frozen=True, eq=False)
class RestoredPicture:
    """The result of a restoration, with its residual.

    light: (bands, rows, columns).
    residual_map: the photograph less the blurred restoration, over the noise; NaN where it isn't
        known.
    bands: result of the method for each band; with colour filters, one result for all bands.
    residual: of all bands, rms over the noise.
    cpu_seconds: processor time of the process in seconds.
    verdicts: what was found in each band.
    psf_scales: scale of the PSF that each band shows; empty where there was no time to look for it.
    variance_uses: whether the variance map of each band was used, and why; empty without a map.
    refined: whether PSFs of a wrong scale were replaced by scaled ones.
    scores: before and after; None without a reference.
    """

    light: Light
    residual_map: Light
    bands: tuple[RestoredImage, ...]
    residual: float
    cpu_seconds: float
    verdicts: tuple[Verdict, ...]
    psf_scales: tuple[PSFScale, ...] = ()
    refined: bool = False
    variance_uses: tuple[VarianceUse, ...] = ()
    scores: tuple[Score, Score] | None = None

    @property
    def method(self) -> str:
        """Return the names of the methods that restored the bands."""
        return " / ".join(dict.fromkeys(band.method for band in self.bands))

    @property
    def verdict(self) -> str:
        """Say in words what was found, each cause once."""
        found = {one.cause: one for verdict in self.verdicts for one in verdict.findings}
        judged = all(verdict.judges_psf for verdict in self.verdicts)
        return str(Verdict(tuple(found.values()), judged))

    def noise_source(self, problem: RestorationProblem) -> str:
        """Say how the noise is known."""
        if any(one.is_used for one in self.variance_uses):
            return "root mean square of its variance map"
        return problem.noise_source(self.bands[0].noise)

    @property
    def variance_words(self) -> str:
        """Say in words whether the variance map was used, and what it gained."""
        return " / ".join(dict.fromkeys(str(one) for one in self.variance_uses))

    @property
    def causes(self) -> list[str]:
        """Return the causes of what was found, each once."""
        return list(
            dict.fromkeys(one.cause for verdict in self.verdicts for one in verdict.findings)
        )


@single_threaded
def restore_picture(
    problem: RestorationProblem, wish: MethodChoice, progress: Progress
) -> RestoredPicture:
    """Restore each band of a picture; ValueError for one that can't be restored.

    Unless the budget is small, the scale of the PSF is looked for first. The restoration runs in
    one thread, so that the same problem always gives the same bits.
    """
    if wish.refine_psf and problem.filters is not None:
        raise UserError("--refine-psf: needs a picture without colour filters. Leave it out.")
    started, seen = time.process_time(), problem.observations()
    share = 1 / len(seen)
    looks = wish.refine_psf or wish.budget is None or wish.budget * share >= _TRIAL_BUDGET
    progress.report(0, "scale of the PSF")
    scales = problem.psf_scales if looks else ()
    refined = wish.refine_psf and any(one.is_wrong for one in scales)
    if refined:
        pairs = zip(seen, scales, strict=True)
        seen = [refine_psf_scale(band, one) if one.is_wrong else band for band, one in pairs]
    share_left = share * (_RESTORING_SHARE if looks else 1)
    seen, uses = _with_variance(problem, seen, wish, share_left, looks, progress)
    rest = progress.part(0.2, 1)
    found = tuple(
        wish.restore(
            band,
            share_left,
            rest.part(number * share, (number + 1) * share),
            problem.planned_iterations,
        )
        for number, band in enumerate(seen)
    )
    residual = float(np.sqrt(np.mean([band.residual**2 for band in found])))
    told = () if refined else scales
    verdicts = tuple(
        judge_restoration(band, one, told[number] if told else None)
        for number, (band, one) in enumerate(zip(seen, found, strict=True))
    )
    spent = time.process_time() - started
    progress.report(1, "restored")
    shape = problem.light.shape[1:]
    light = np.concatenate([band.image.numpy().reshape(-1, *shape) for band in found])
    light = light.astype(np.float32)
    left = np.stack(
        [
            residual_map(one, band).numpy().astype(np.float32)
            for one, band in zip(seen, found, strict=True)
        ]
    )
    known = problem.reference
    scores = None if known is None else (known.score(problem.blurred_bands), known.score(light))
    return RestoredPicture(
        light, left, found, residual, spent, verdicts, scales, refined, uses, scores
    )


def _with_variance(
    problem: RestorationProblem,
    seen: list[Observation],
    wish: MethodChoice,
    share: float,
    has_time: bool,
    progress: Progress,
) -> tuple[list[Observation], tuple[VarianceUse, ...]]:
    """Return the bands as they are to be restored, with variance maps where they gain."""
    if problem.variance is None:
        return seen, ()
    if (reason := why_without_map(problem)) is not None:
        return seen, (reason,)
    progress.report(0.1, "gain of the variance map")
    chosen = [
        choose_variance(band, one, wish, share, has_time=has_time)
        for band, one in zip(seen, problem.variance, strict=True)
    ]
    return [band for band, _ in chosen], tuple(use for _, use in chosen)
