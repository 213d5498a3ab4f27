"""The covariance of a scene's spectra, estimated from its first restoration.

A restoration alone doesn't show it: what the photograph determines badly, the prior has made small.
Expectation maximisation adds what is still unknown. The covariance that explains the scene is the
one of the restored gradients plus the posterior covariance of their errors (Dempster, Laird and
Rubin 1977). The errors are those of a Gaussian scene with the same covariance.
"""

from __future__ import annotations

import torch

from optics.inverse.mosaics import MosaicObservation
from optics.multispectral.mosaic_frequencies import (
    forward_matrices,
    group_frequencies,
    squared_frequencies,
)

_SLOPE = 2.2
"""Power of the frequency by which the scene's power falls, so that gradients are nearly white."""

_PERIOD = 128
"""Least rows and columns of the Gaussian scene: enough frequencies, whatever the picture's size."""

_STEPS = 15
"""Steps of expectation maximisation. Of 1, 4 and 15, the best for six scenes, of which three are
measured and three have measured reflectances in the place of a photograph's colours."""

_TYPICAL_SHARE = 0.1
"""Share of the typical covariance in the result, so that spectra which the scene doesn't show stay
possible. Measured on the same scenes: 0.1 and 0.3 hardly differ."""

_LEAST_NOISE = 3e-4
"""Least noise relative to the scale of the light; without any, the matrices can't be inverted."""


@torch.no_grad()
def adapt_covariance(
    observation: MosaicObservation, bands: torch.Tensor, typical: torch.Tensor
) -> torch.Tensor:
    """Estimate the covariance of a scene's spectral gradients from its restoration.

    Parameters
    ----------
    observation : MosaicObservation
        The raw picture with its filters and PSFs.
    bands : torch.Tensor, (bands, rows, columns)
        The restored picture.
    typical : torch.Tensor, (bands, bands)
        Covariance of typical spectra, of any scale, from which the estimate starts.

    Returns
    -------
    torch.Tensor, (bands, bands), float64
        The covariance, with a trace of 1. It is `typical` for a picture without gradients.
    """
    start = typical.to(torch.float64) / typical.to(torch.float64).trace()
    restored = _gradient_moments(bands)
    if not float(restored.trace()) > 0:
        return start
    errors = _GradientErrors(observation)
    found = start * restored.trace()
    for _ in range(_STEPS):
        found = restored + errors.posterior_covariance(found)
    return (1 - _TYPICAL_SHARE) * found / found.trace() + _TYPICAL_SHARE * start


def _gradient_moments(bands: torch.Tensor) -> torch.Tensor:
    """Return the second moments of a picture's spectral gradients, (bands, bands), a pixel's."""
    total = torch.zeros(len(bands), len(bands), dtype=torch.float64)
    for axis in (1, 2):
        step = bands.diff(dim=axis).flatten(1).to(torch.float64)
        if step.numel():
            total += step @ step.mT / step.shape[1]
    return total


class _GradientErrors:
    """The posterior covariance of a Gaussian scene's spectral gradients, given its raw picture."""

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
        """Compute the covariance of the errors of a scene's spectral gradients, (bands, bands).

        `covariance` is the scene's own. At each group of frequencies the errors have the covariance
        C - C Aᴴ (A C Aᴴ + noise²)⁻¹ A C, with the model A.
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
