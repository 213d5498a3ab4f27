"""Restore a picture band by band, and judge by its residual how far to trust it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from labapp.common.errors import UserError
from labapp.files.picture.photograph import Light
from labapp.pictures.analysis.score import Score
from labapp.pictures.reconstructing.method_choice import MethodChoice
from labapp.pictures.reconstructing.problem import RestorationProblem
from optics.inverse.observation import Observation
from optics.inverse.observation_builder import with_doubted_variance
from optics.inverse.restored_image import RestoredImage, residual_map
from optics.inverse.variance_gain import VarianceGain, estimate_variance_gain
from optics.inverse.verdict import Finding, PSFScale, Verdict, judge_restoration, refine_psf_scale
from optics.progress import Progress
from optics.threads import single_threaded

_TRIAL_BUDGET, _RESTORING_SHARE = 2.0, 0.8
"""Seconds of a band's budget from which the scale of its PSF and the gain of its variance map are
looked for, and the share of the budget that is then left for the restoration."""

_LEAST_GAIN = 0.1
"""Expected gain of the light in dB from which the map is used. Chosen: nobody sees less."""

_UNEXPLAINED = "the photograph shows far more noise than the map has"

_SEED = 0
"""Seed of the trial's noise: the same picture always gives the same restoration."""


@dataclass(frozen=True)
class VarianceUse:
    """Whether a band was restored with its variance map, and why.

    gain: expected gain over one noise for all pixels; None where it wasn't estimated.
    reason: in words.
    """

    is_used: bool
    gain: VarianceGain | None
    reason: str

    def __str__(self) -> str:
        return f"{'used' if self.is_used else 'not used'}: {self.reason}"


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
        judged = all(verdict.judges_psf for verdict in self.verdicts)
        return str(Verdict(tuple(self._findings.values()), judged))

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
        return list(self._findings)

    @property
    def _findings(self) -> dict[str, Finding]:
        """Return what was found, by its cause."""
        return {one.cause: one for verdict in self.verdicts for one in verdict.findings}


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
    told = scales if scales and not refined else [None] * len(seen)
    verdicts = tuple(map(judge_restoration, seen, found, told))
    spent = time.process_time() - started
    progress.report(1, "restored")
    shape = problem.light.shape[1:]
    light = np.concatenate([band.image.numpy().reshape(-1, *shape) for band in found])
    light = light.astype(np.float32)
    left = [residual_map(one, band).numpy() for one, band in zip(seen, found, strict=True)]
    known = problem.reference
    scores = None if known is None else (known.score(problem.blurred_bands), known.score(light))
    return RestoredPicture(
        light,
        np.stack(left).astype(np.float32),
        found,
        residual,
        spent,
        verdicts,
        scales,
        refined,
        uses,
        scores,
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
    if problem.noise is not None:
        return seen, (VarianceUse(False, None, "one noise was told for all pixels"),)
    if problem.filters is not None:
        reason = "light behind colour filters is restored with one noise"
        return seen, (VarianceUse(False, None, reason),)
    progress.report(0.1, "gain of the variance map")
    chosen = [
        _choose_variance(band, one, wish, share, has_time=has_time)
        for band, one in zip(seen, problem.variance, strict=True)
    ]
    return [band for band, _ in chosen], tuple(use for _, use in chosen)


def _choose_variance(
    observation: Observation,
    variance: NDArray[np.floating],
    wish: MethodChoice,
    share: float,
    *,
    has_time: bool,
) -> tuple[Observation, VarianceUse]:
    """Choose whether a band is restored with its variance map; return it as it is to be, and why.

    observation: the band with one noise for all pixels.
    variance: (rows, columns), of each pixel; infinite where nothing was measured.
    share: share of the budget that the band may take.
    has_time: whether there is time for estimating the gain.
    """
    given = torch.from_numpy(variance).to(torch.float64)
    varied = with_doubted_variance(observation, given)
    if varied.variance is None:
        stated = float(given[torch.isfinite(given)].mean()) ** 0.5
        even = "the noise is even" if varied.noise < 1.01 * stated else _UNEXPLAINED
        return observation, VarianceUse(False, None, f"{even}, so that it gains nothing")
    name, solve = wish.variance_solver(varied, share)
    if solve is None:
        return observation, VarianceUse(False, None, f"{name} takes one noise for all pixels")
    if not has_time:
        return varied, VarianceUse(True, None, "its gain wasn't estimated, for want of time")
    try:
        gain = estimate_variance_gain(varied, solve, torch.Generator().manual_seed(_SEED))
    except ValueError as error:
        # The middle may be clipped or dark, though the rest of the photograph isn't.
        return varied, VarianceUse(True, None, f"its gain can't be estimated, because {error}")
    told = (
        f"{gain.light:+.1f} dB expected against one noise for all pixels ({gain.logarithm:+.1f} dB "
        "in the logarithm of the light), by a simulated photograph"
    )
    if not torch.equal(varied.variance, given):
        told += f"; {_UNEXPLAINED}, and the rest was added to it"
    if gain.light < _LEAST_GAIN:
        return observation, VarianceUse(False, gain, f"it gains nothing, {told}")
    return varied, VarianceUse(True, gain, told)
