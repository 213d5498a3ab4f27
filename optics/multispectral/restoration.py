"""Restore the bands of a scene from one photograph, by gradients and typical spectra.

The covariance of the scene's spectra is estimated from its first restoration.
"""

from __future__ import annotations

import math
from typing import Any

import torch

from optics.inverse.band_coupling import BandCoupling
from optics.inverse.mosaics import MosaicObservation
from optics.inverse.own_terms import in_own_unit
from optics.inverse.restored_image import RestoredImage
from optics.inverse.total_variation import total_variation
from optics.multispectral.predicted_error import (
    forward_matrices,
    group_frequencies,
    squared_frequencies,
)
from optics.progress import Progress
from optics.threads import single_threaded
from optics.validation import require_unmasked

_SLOPE = 2.2  # power by which the scene's power falls, so that gradients are nearly white
_PERIOD = 128  # least rows and columns of the Gaussian scene: enough frequencies

# Steps of expectation maximisation. Of 1, 4 and 15, the best for six scenes, of which three are
# measured and three have measured reflectances in the place of a photograph's colours.
_STEPS = 15

# Share of the typical covariance in the result, so that spectra which the scene doesn't show stay
# possible. Measured on the same scenes: 0.1 and 0.3 hardly differ.
_TYPICAL_SHARE = 0.1

_LEAST_NOISE = 3e-4  # over the scale of the light; without any, matrices can't be inverted


@torch.no_grad()
def adapt_covariance(
    observation: MosaicObservation, bands: torch.Tensor, typical: torch.Tensor
) -> torch.Tensor:
    """Estimate the covariance over bands of a scene's gradients from its restored bands.

    The result is (bands, bands), float64, with a trace of 1. The estimate starts from the `typical`
    covariance, of any scale, which is the answer for a picture without gradients.
    """
    start = typical.to(torch.float64) / typical.to(torch.float64).trace()
    # Second moments over bands of the picture's gradients, those of a pixel.
    restored = torch.zeros(len(bands), len(bands), dtype=torch.float64)
    for axis in (1, 2):
        step = bands.diff(dim=axis).flatten(1).to(torch.float64)
        if step.numel():
            restored += step @ step.mT / step.shape[1]
    if not float(restored.trace()) > 0:
        return start
    errors = _GradientErrors(observation)
    found = start * restored.trace()
    for _ in range(_STEPS):
        found = restored + errors.posterior_covariance(found)
    return (1 - _TYPICAL_SHARE) * found / found.trace() + _TYPICAL_SHARE * start


class _GradientErrors:
    """The posterior covariance of a Gaussian scene's gradients, given its raw picture."""

    def __init__(self, observation: MosaicObservation) -> None:
        rows, columns = observation.filter_period
        period = -(-_PERIOD // (rows * columns)) * rows * columns
        filters = observation.filters[:, :rows, :columns].to(torch.float64)
        psfs = observation.psfs.to(torch.float64).expand(len(filters), -1, -1)
        self._forward = forward_matrices(psfs, filters, period)
        squares = squared_frequencies(period)
        # The power levels off at one cycle per period, where the mean light would be infinite.
        power = (squares + 1 / period**2) ** (-_SLOPE / 2)
        slope = torch.fft.fftfreq(period, dtype=torch.float64).mul(torch.pi).sin().square() * 4
        gradient = slope[:, None] + slope
        power /= (power * gradient).mean()
        self._power, self._gradient = (
            group_frequencies(one[None], (rows, columns))[..., 0] for one in (power, gradient)
        )
        least = _LEAST_NOISE * observation.scale * observation.psf_sum
        self._noise_variance = max(observation.noise, least) ** 2

    def posterior_covariance(self, covariance: torch.Tensor) -> torch.Tensor:
        """Compute the covariance of the errors of gradients from the scene's own, (bands, bands).

        At each group of frequencies it is C - C Aᴴ (A C Aᴴ + noise²)⁻¹ A C, with the model A.
        """
        crossed = self._forward @ covariance.to(self._forward)
        measured = torch.einsum(
            "gafn,gcfn,gf->gac", crossed, self._forward.conj(), self._power.to(crossed)
        )
        measured.diagonal(dim1=-2, dim2=-1).add_(self._noise_variance)
        factor = torch.linalg.cholesky(measured)
        groups, count, frequencies, bands = crossed.shape
        known = torch.linalg.solve_triangular(
            factor, crossed.reshape(groups, count, -1), upper=False
        ).reshape(groups * count, frequencies, bands)
        weight = (self._power.square() * self._gradient).repeat_interleave(count, 0).sqrt()
        known = (known * weight[..., None]).reshape(-1, bands)
        explained = (known.mH @ known).real / self._power.numel()
        left = covariance - explained
        # Rounding may leave an axis that is known exactly with a negative variance.
        sizes, axes = torch.linalg.eigh((left + left.mT) / 2)
        return (axes * sizes.clamp(min=0)) @ axes.mT


# Power of the gradients' joint length. Of 0.6 to 1 on six scenes, 0.7 and 0.8 are 0.2 dB better
# than 1, with noise of 1 % of white and without.
_POWER = 0.8

# Factor on the weight by the evidence, for errors of PSFs and filters, which aren't noise. On three
# records of a simulated bench with measured PSFs, 2 is 0.4 to 3.1 dB better than 1 for a power of
# 1; with exact PSFs it is 0.1 dB worse with noise of 1 % of white, and 0.4 dB with 5 %.
_WEIGHT_FACTOR = 1.5

# Iterations of the second restoration over those of the first, which only the covariance needs. Of
# 1, 1.5 and 2 on the same scenes without noise, 1.5 is 0.6 dB better than 1, and 2 another 0.1 dB.
_SECOND_ITERATIONS = 1.5


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
        Regularisation weight, above 0. Chosen from noise and picture if None.
    iterations, adapts : int, default 100, bool, default True
        Iterations of the first restoration; whether the scene's own spectra are estimated for a
        second one, which takes 1.5 times as many.
    progress : Progress, optional
        Receives reports, and can cancel the work.

    Returns
    -------
    RestoredImage
        The bands, (bands, rows, columns), never negative.

    Raises
    ------
    ValueError
        For spectra that aren't finite, too few, or of another number of bands, or another number.

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
