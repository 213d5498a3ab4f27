"""Refinement of a snapshot spectral camera's calibration from the photograph alone."""

from __future__ import annotations

from typing import Any

import torch

from optics.inverse.band_coupling import BandCoupling
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.restored_image import RestoredImage
from optics.multispectral.corrected_score import solve_corrected_score
from optics.multispectral.photograph_fit import PhotographFit, busiest_window, observe_by_model
from optics.multispectral.photograph_validation import validate_on_held_out_pixels
from optics.multispectral.restoration import restore_spectra
from optics.multispectral.snapshot_calibration import SnapshotCalibration
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_unmasked

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
