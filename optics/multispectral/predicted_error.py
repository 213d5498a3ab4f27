"""Predict the error of restored bands from PSFs, filters and noise alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from optics.inverse.pixel_operators import filter_weights
from optics.threads import single_threaded
from optics.validation import as_finite_array, require_count, require_positive


def forward_matrices(psfs: torch.Tensor, filters: torch.Tensor, period: int) -> torch.Tensor:
    """Compute the matrices from a scene's bands to the raw picture, on frequencies.

    The result is (groups, measured frequencies, scene's frequencies, bands), complex: the matrices
    of each group of frequencies that the mosaic mixes. `filters` is one period of the mosaic's
    pattern, and PSFs are wrapped around the rows and columns of the repeated scene, a multiple of
    the pattern's.
    """
    wrapped = psfs.new_zeros(len(psfs), period, period)
    rows, columns = ((torch.arange(n) - n // 2) % period for n in psfs.shape[-2:])
    place = (torch.arange(len(psfs))[:, None, None], rows[:, None], columns)
    wrapped.index_put_(place, psfs, accumulate=True)
    transfer = group_frequencies(torch.fft.fft2(wrapped), filters.shape[1:])
    return _mixing(filters)[None] * transfer[:, None]


def group_frequencies(values: torch.Tensor, pattern: Sequence[int]) -> torch.Tensor:
    """Group the frequencies, (bands, period, period), that a mosaic mixes.

    The result is (groups, frequencies, bands), where the frequency (i, j) is i times period / rows
    and j times period / columns above the group's first.
    """
    down, along = pattern
    bands, rows, columns = values.shape
    split = values.reshape(bands, down, rows // down, along, columns // along)
    return split.permute(2, 4, 1, 3, 0).reshape(-1, down * along, bands)


def squared_frequencies(period: int) -> torch.Tensor:
    """Return the squared frequency in (cycles/pixel)² on a square period."""
    squares = torch.fft.fftfreq(period, dtype=torch.float64).square()
    return squares[:, None] + squares


def _mixing(filters: torch.Tensor) -> torch.Tensor:
    """Compute how one period of filters, (bands, rows, columns), mixes a group's frequencies.

    The result is (measured frequencies, the scene's frequencies, bands).
    """
    down, along = filters.shape[1:]
    series = torch.fft.fft2(filters) / (down * along)
    row, column = torch.arange(down * along) // along, torch.arange(down * along) % along
    rows = (row[:, None] - row) % down
    columns = (column[:, None] - column) % along
    return series[:, rows, columns].permute(1, 2, 0)


# Default model of scenes and of restoration. Measured with 38 designs and six scenes, which served
# no other purpose: of slopes from 2 to 4 and ratios of excess and contrast from 1 to 12, one of the
# best. The predicted mean PSNR of a design differs from that of `restore_spectra` by 0.13 dB in the
# mean, besides a constant, and the contrast makes that constant 0.4 dB. Photographs' own power
# falls with a slope of 2 (Field 1987, doi 10.1364/JOSAA.4.002379). That ranks designs badly: total
# variation restores edges better than a Gaussian model of the same power expects.
_SLOPE, _CONTRAST, _NOISE_EXCESS = 3.0, 0.5, 2.0

_PERIOD = 128


@dataclass(frozen=True)
class SceneSpectrum:
    """The power spectrum of scenes over spatial frequencies, 1 / f^slope.

    The mean light of the picture counts as known.

    Parameters
    ----------
    slope, contrast : float
        Power of the frequency by which the scene's power falls, above 0; standard deviation of the
        light over the picture, relative to its root mean square, above 0 and at most 1.
    """

    slope: float = _SLOPE
    contrast: float = _CONTRAST

    def __post_init__(self) -> None:
        require_positive("slope", self.slope, "")
        if not 0 < self.contrast <= 1:
            raise ValueError(f"contrast is {self.contrast:g}; it must be above 0, and at most 1")

    def on_period(self, period: int) -> torch.Tensor:
        """Compute the power on a square period of frequencies; its mean is the squared contrast."""
        squares = squared_frequencies(period)
        squares[0, 0] = torch.inf
        power = squares ** (-self.slope / 2)
        return power * (self.contrast**2 / power.mean())


@dataclass(frozen=True, eq=False)
class PredictedErrors:
    """Errors that are predicted of restored bands.

    Parameters
    ----------
    rms, filters_rms, prior_rms : torch.Tensor, (bands,), float64
        Root mean square error of each band, in the unit of the spectra; the same for PSFs without
        any extent, which is what filters and typical spectra alone determine; and the band's
        standard deviation over the scene, its error if nothing were measured.
    """

    rms: torch.Tensor
    filters_rms: torch.Tensor
    prior_rms: torch.Tensor

    @property
    def psnr(self) -> torch.Tensor:
        """PSNR of each band in dB, for a peak of 1."""
        return -20 * self.rms.log10()

    @property
    def mean_psnr(self) -> float:
        return float(self.psnr.mean())

    @property
    def separated_share(self) -> torch.Tensor:
        """Share of each band's variance that only the PSFs separate from other bands.

        It is negative where blur costs more than the dispersion separates.
        """
        return (self.filters_rms.square() - self.rms.square()) / self.prior_rms.square()


@single_threaded
@torch.no_grad()
def predict_errors(
    psfs: Any,
    response: Any,
    pattern: Sequence[str],
    spectra: Any,
    noise: float,
    *,
    channels: str = "RGB",
    scene: SceneSpectrum | None = None,
    noise_excess: float = _NOISE_EXCESS,
    period: int = _PERIOD,
) -> PredictedErrors:
    """Predict the errors of bands that are restored from one photograph.

    The prediction is the posterior covariance of a Gaussian scene that repeats, given the raw
    picture with white noise. With a `noise_excess` of 1 it is the error of the best possible linear
    restoration; the default predicts that of `restore_spectra`. It is meant to compare PSFs: a
    given scene may be several decibels off, but alike for all PSFs. What sharp edges add to the
    separation of bands isn't in it: see `PsfMerit`. The covariance is the power spectrum of `scene`
    times the second moments of `spectra`. The mosaic couples as many frequencies as its pattern has
    pixels, so that the matrices are small.

    Parameters
    ----------
    psfs : torch.Tensor or numpy.ndarray, (bands, rows, columns)
        PSF of each band, with its origin at n // 2.
    response, channels : torch.Tensor or numpy.ndarray, (channels, bands), str, default "RGB"
        Share of each band that the filter of each letter transmits, and the letters in its order.
    pattern : sequence of str
        Rows of one letter per pixel that repeat, as ``("RG", "GB")``.
    spectra, noise : torch.Tensor or numpy.ndarray, (samples, bands), float
        Typical spectra of the scene, where 1 is the peak of the predicted PSNR; standard deviation
        of a pixel of the raw picture, above 0.
    scene, noise_excess : SceneSpectrum, optional, and float, default 2.0
        Power spectrum of the scene, and factor on the noise, above 0, by which a restoration that
        doesn't know it is worse than the best linear one.
    period : int, default 128
        Rows and columns of the repeated scene, a multiple of the pattern's. It should exceed the
        PSFs, which are wrapped around it.

    Returns
    -------
    PredictedErrors
        Errors of each band, with and without the PSFs.

    Raises
    ------
    ValueError
        For shapes that don't fit, values that aren't finite, or noise that isn't positive.

    References
    ----------
    Kay 1993, Fundamentals of Statistical Signal Processing: Estimation Theory, section 12.5.
    """
    stack = as_finite_array("psfs", psfs, "(bands, rows, columns)")
    shares = as_finite_array("response", response, "(channels, bands)")
    samples = as_finite_array("spectra", spectra, "(samples, bands)")
    counts = len(stack), shares.shape[1], samples.shape[1]
    if len(set(counts)) > 1:
        raise ValueError("psfs, response and spectra have {}, {} and {} bands".format(*counts))
    require_positive("noise", noise, "")
    require_positive("noise_excess", noise_excess, "")
    rows, columns = len(pattern), len(pattern[0])
    require_count("period", period)
    if period % rows or period % columns:
        raise ValueError(f"period is {period}; give a multiple of the pattern's {rows} x {columns}")
    covariance = samples.mT @ samples / len(samples)
    power = (scene or SceneSpectrum()).on_period(period)
    filters = filter_weights(pattern, shares, channels, (rows, columns))
    point = torch.ones(len(stack), 1, 1, dtype=torch.float64)
    variance, sharp_variance = (
        _posterior_variance(one, filters, covariance, power, noise * noise_excess)
        for one in (stack, point)
    )
    prior_variance = covariance.diagonal() * power.mean()
    return PredictedErrors(variance.sqrt(), sharp_variance.sqrt(), prior_variance.sqrt())


def _posterior_variance(
    psfs: torch.Tensor,
    filters: torch.Tensor,
    covariance: torch.Tensor,
    power: torch.Tensor,
    noise: float,
) -> torch.Tensor:
    """Compute the variance that is left of each band once the raw picture is known.

    For each group of frequencies that the mosaic mixes, the posterior covariance is
    C - C Aᴴ (A C Aᴴ + noise²)⁻¹ A C.
    """
    forward = forward_matrices(psfs, filters, len(power))
    strength = group_frequencies(power[None], filters.shape[1:])[..., 0]
    # A C, whose prior C is the scene's power at a frequency times the covariance of the bands.
    crossed = (forward @ covariance.to(forward)) * strength[:, None, :, None]
    measured = crossed.flatten(2) @ forward.conj().flatten(2).mT
    measured.diagonal(dim1=-2, dim2=-1).add_(noise**2)
    whitened = torch.linalg.solve_triangular(
        torch.linalg.cholesky(measured), crossed.flatten(2), upper=False
    )
    known = whitened.real.square() + whitened.imag.square()
    known_power = known.sum((0, 1)).reshape(strength.shape[1], -1).sum(0) / power.numel()
    # Rounding may leave a band that is known exactly with a negative variance.
    return (covariance.diagonal() * power.mean() - known_power).clamp(min=0)
