"""Refine the calibration of a snapshot camera from the photograph alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch

from optics.inverse.band_coupling import BandCoupling
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.restored_image import RestoredImage
from optics.multispectral.photograph_fit import (
    PhotographFit,
    busiest_window,
    observe_by_model,
    validate_on_held_out_pixels,
)
from optics.multispectral.restoration import restore_spectra
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_unmasked

_STEPS = 4
"""Steps of Gauss-Newton's method. More change the estimates by less than their deviations."""

_DAMPING = 0.7
"""Share of each step that is taken. Whole steps swing to and fro along some directions, along which
the score changes up to twice as fast as simulated photographs let expect."""

_CORRECTION_ERROR = 0.1
"""Relative error of the expected score, which is that of the restored picture, not of the scene's:
see _STATISTICAL_FACTOR."""

_STATISTICAL_FACTOR = 20.0
"""Variance of the score over that of an exactly known expected score, which the noise of both and
errors of the model enlarge. This and the number above are chosen so that 90 % intervals hold at
least as often as they say: measured with 36 cameras, on photographs with measured reflectances and
on scenes of 24 and 11 measured bands."""

_CENTRE_CAUTION = 1.35
"""Factor on the deviations of the PSFs' centres, which the score follows less well the farther they
are from the start. Chosen with the same cameras: without it, the intervals of single centres held
75 to 97 % of them, with it 89 to 100 %."""

_DIFFERENCE = 0.3
"""Step of each parameter for the score's derivatives, in its prior standard deviations."""

_RESPONSE_ITERATIONS = 30
"""Iterations of the restorations that give the score's derivatives. With 30 instead of 120, they
change by 8 % at most."""

_LARGEST_STEP = 1.0
"""Largest step of a parameter, in its prior standard deviations."""


def solve_corrected_score(
    fit: PhotographFit,
    prior: SnapshotCalibration,
    start: torch.Tensor,
    response_side: int,
    progress: Progress,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Estimate all parameters of a camera's model, where the corrected score is 0.

    Returns deviations from nominal, (parameters,), and their covariance, (parameters, parameters).

    prior: what is known before; the estimates are drawn to it by its covariance.
    start: first deviations from nominal, (parameters,), float64.
    response_side: sides in pixels of the part that shows how the score changes with the parameters.
    """
    precision = torch.linalg.inv(prior.covariance)
    spread = prior.covariance.diagonal().sqrt()
    _, weight = fit.restore(fit.observe(start))
    information = _score_information(
        fit, start, spread, weight, response_side, progress.part(0, 0.5)
    )
    deviation = start
    for number in range(_STEPS):
        progress.report(0.5 + 0.5 * number / _STEPS, f"all parameters {number + 1}/{_STEPS}")
        score, expected = _scores(fit, deviation, weight)
        error = (_CORRECTION_ERROR * expected).square()
        trust = torch.linalg.inv(_STATISTICAL_FACTOR * information + torch.diag(error))
        total = information @ trust @ information + precision
        pull = information @ trust @ (score - expected)
        step = torch.linalg.solve(total, pull - precision @ (deviation - prior.deviation))
        longest = float((step.abs() / spread).max())
        deviation = deviation + step * min(_DAMPING, _LARGEST_STEP / max(longest, 1e-12))
    caution = torch.ones_like(deviation)
    caution[fit.model.layout.centres] = _CENTRE_CAUTION
    return deviation, torch.linalg.inv(total) * caution[:, None] * caution


def _scores(
    fit: PhotographFit, deviation: torch.Tensor, weight: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the photograph's score, and the one that is expected if the model is right.

    The expected one is the mean of two simulated photographs with opposite noise.
    """
    seen = fit.observe(deviation)
    picture, _ = fit.restore(seen, weight)
    score = fit.score(seen, picture, deviation)
    clean = fit.predict(seen, picture.clamp(min=0))
    noise = _draw_noise(fit, 0)
    expected = [_score_of(fit, clean + one, deviation, weight) for one in (noise, -noise)]
    return score, torch.stack(expected).mean(0)


def _score_of(
    fit: PhotographFit, image: torch.Tensor, deviation: torch.Tensor, weight: float
) -> torch.Tensor:
    """Restore another photograph by the model, and return its score."""
    seen = fit.observe(deviation, image)
    picture, _ = fit.restore(seen, weight)
    return fit.score(seen, picture, deviation)


def _score_information(
    fit: PhotographFit,
    deviation: torch.Tensor,
    spread: torch.Tensor,
    weight: float,
    side: int,
    progress: Progress,
) -> torch.Tensor:
    """Return how fast the score changes with the parameters: a symmetric matrix, not negative.

    It is (parameters, parameters), computed by differences: photographs are simulated for each
    changed parameter, and restored by the unchanged model. They show a part of the photograph, and
    the result is scaled to the whole.
    """
    part = replace(
        fit, observation=busiest_window(fit.observation, side), iterations=_RESPONSE_ITERATIONS
    )
    seen = part.observe(deviation)
    scene = part.restore(seen, weight)[0].clamp(min=0)
    noise = _draw_noise(part, 1)
    clean = part.predict(seen, scene)
    base = _score_of(part, clean + noise, deviation, weight)
    columns, count = [], len(deviation)
    for number in range(count):
        progress.report(number / count, f"influence of parameter {number + 1}/{count}")
        step = _DIFFERENCE * float(spread[number])
        other = deviation.clone()
        other[number] += step
        changed = part.predict(part.observe(other), scene)
        columns.append((_score_of(part, changed + noise, deviation, weight) - base) / step)
    slopes = torch.stack(columns, 1) * (fit.weights.numel() / part.weights.numel())
    sizes, axes = torch.linalg.eigh((slopes + slopes.mT) / 2)
    return (axes * sizes.clamp(min=0)) @ axes.mT


def _draw_noise(fit: PhotographFit, seed: int) -> torch.Tensor:
    """Draw the noise of a simulated photograph, 0 where pixels have no weight."""
    generator = torch.Generator().manual_seed(seed)
    standard = torch.randn(tuple(fit.weights.shape), generator=generator).to(fit.weights)
    inverse = torch.where(fit.weights > 0, fit.weights, 1.0).rsqrt()
    return fit.noise * standard * inverse * (fit.weights > 0)


_SIDE, _RESPONSE_SIDE = 192, 128
"""Least sides in pixels of the part of the photograph that is used, and of its part for
derivatives; chosen for the time that they take."""

_PSF_SIDES, _RESPONSE_PSF_SIDES = 2.5, 2.0
"""Least sides of these parts over those of the PSFs, which mustn't blur all that they show; chosen
for the time as well."""

_ITERATIONS = 60
"""Iterations of each restoration on the way. With 30, held-out pixels are predicted worse."""


@single_threaded
def refine_from_photograph(
    observation: MosaicObservation,
    spectra: Any,
    prior: SnapshotCalibration,
    *,
    progress: Progress | None = None,
) -> tuple[SnapshotCalibration, RestoredImage]:
    """Refine a snapshot camera's calibration from one photograph, and restore its bands.

    Cross-validation finds zeroth order and scale, which matter most. From there all parameters
    follow from the score of the likelihood, corrected by simulated photographs. Both use the part
    of the photograph with the most contrast.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture: see `build_mosaic_observation`. Its PSFs and filters are replaced by those
        of the calibration.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        Typical spectra on the scale of the scene's bands; as many as bands or more.
    prior : SnapshotCalibration
        What is known before: `SnapshotCalibration.nominal`, or a calibration from frames.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    tuple of SnapshotCalibration and RestoredImage
        The calibration with its uncertainty and what remains indeterminate, and the bands as
        restored with it.

    Raises
    ------
    ValueError
        For another number of bands or another filter pattern than the calibration's, or for
        unusable spectra.
    """
    model, progress = prior.model, progress or Progress()
    period = (len(model.pattern), len(model.pattern[0]))
    if observation.bands != model.bands or observation.filter_period != period:
        raise ValueError(
            f"observation has {observation.bands} bands and a filter pattern of "
            f"{observation.filter_period}; the calibration is of {model.bands} bands and {period}"
        )
    require_unmasked(spectra)
    samples = torch.as_tensor(spectra)
    gains = torch.ones(model.bands, dtype=torch.float64)
    if prior.transmission is not None:
        gains = prior.transmission.values
    wide = max(model.coded.shape[1:])
    response_side = max(_RESPONSE_SIDE, round(_RESPONSE_PSF_SIDES * wide))
    part = busiest_window(observation, max(_SIDE, round(_PSF_SIDES * wide)))
    fit = PhotographFit(part, model, gains, BandCoupling.spectral(samples), _ITERATIONS)
    start = validate_on_held_out_pixels(fit, prior, progress.part(0, 0.25))
    deviation, covariance = solve_corrected_score(
        fit, prior, start, response_side, progress.part(0.25, 0.75)
    )
    refined = prior.with_estimates(deviation, covariance, f"{prior.source} and photograph")
    seen = observe_by_model(observation, model, refined.relative_deviation, gains)
    return refined, restore_spectra(seen, samples, progress=progress.part(0.75, 1))
