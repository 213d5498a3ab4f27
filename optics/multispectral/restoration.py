"""Restoration of spectral bands from one photograph, by gradients and typical spectra."""

from __future__ import annotations

import math
from typing import Any

import torch

from optics.inverse.band_coupling import BandCoupling
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.multispectral.scene_covariance import adapt_covariance
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_unmasked

_POWER = 0.8
"""Power of the gradients' joint length. Of 0.6 to 1 on six scenes, 0.7 and 0.8 are 0.2 dB better
than 1, with noise of 1 % of white and without."""

_WEIGHT_FACTOR = 1.5
"""Factor on the weight by the evidence, for errors of PSFs and filters, which aren't noise. On
three records of a simulated bench with measured PSFs, 2 is 0.4 to 3.1 dB better than 1 for a power
of 1; with exact PSFs it is 0.1 dB worse with noise of 1 % of white, and 0.4 dB with 5 %."""

_SECOND_ITERATIONS = 1.5
"""Iterations of the second restoration over those of the first, which only the covariance needs. Of
1, 1.5 and 2 on the same scenes without noise, 1.5 is 0.6 dB better than 1, and 2 another 0.1 dB."""


@single_threaded
@torch.no_grad()
@in_own_unit(weight=2 - _POWER)
def restore_spectra(
    observation: MosaicObservation,
    spectra: Any,
    *,
    weight: float | None = None,
    iterations: int = 100,
    adapts: bool = True,
    progress: Progress | None = None,
) -> RestoredImage:
    """Restore the spectral bands of a scene from one coded photograph.

    A power of the joint length of all bands' gradients is penalised, along the principal axes of
    typical spectra: what is rarer among them costs more. From the first restoration the covariance
    of the scene's own spectra is estimated, and takes the place of the typical one in a second.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters and PSFs: see `build_mosaic_observation`.
    spectra : torch.Tensor or numpy.ndarray, (samples, bands)
        Typical spectra on the scale of the scene's bands, of materials that differ from each other;
        as many as bands or more.
    weight : float, optional
        Regularisation weight. Chosen from noise and picture if None.
    iterations : int, default 100
        Number of iterations of the first restoration, 1 or more; the second has 1.5 times as many.
    adapts : bool, default True
        Whether the scene's own spectra are estimated, which takes 2.5 times as long.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The bands, (bands, rows, columns), never negative.

    Raises
    ------
    ValueError
        For spectra that aren't finite, too few, or of another number of bands; for a weight that
        isn't positive, or no iteration.

    References
    ----------
    Thesis Eq. 4.2; Blomgren and Chan 1998, doi 10.1109/83.661180 (vector total variation).
    """
    require_unmasked(spectra)
    samples = torch.as_tensor(spectra)
    if samples.ndim == 2 and samples.shape[1] != observation.bands:
        raise ValueError(
            f"spectra have {samples.shape[1]} bands; the observation has {observation.bands}"
        )
    coupling = BandCoupling.spectral(samples)
    progress = progress or Progress()

    def restore(coupling: BandCoupling, count: int, part: Progress) -> RestoredImage:
        return total_variation(
            observation,
            weight,
            bands=coupling,
            iterations=count,
            power=_POWER,
            weight_factor=_WEIGHT_FACTOR,
            progress=part,
        )

    found = restore(coupling, iterations, progress.part(0, 0.4) if adapts else progress)
    if adapts:
        samples = samples.to(torch.float64)
        covariance = adapt_covariance(observation, found.image, samples.mT @ samples)
        coupling = BandCoupling.of_covariance(covariance)
        count = math.ceil(_SECOND_ITERATIONS * iterations)
        found = restore(coupling, count, progress.part(0.4, 1))
    return found.to_numpy() if observation.is_numpy else found
