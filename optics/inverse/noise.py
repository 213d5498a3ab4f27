"""Estimate a blurred photograph's noise, its PSF's error, and its spectrum's power law.

The noise shows best at frequencies that the blur suppresses. What light is left there beyond white
noise is what the PSF's error makes of the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.special import gammaincinv

from optics.formation import rfft2_frequencies
from optics.fourier import rfft2, rfft_column_weights
from optics.inverse.blur import transfer_function
from optics.inverse.operator import squared_modulus
from optics.inverse.spectrum_law import SpectrumBins, SpectrumLaw
from optics.plane import Plane


@dataclass(frozen=True)
class SpectrumFitSettings:
    """Tune the fit of a power law and noise to a photograph's spectrum.

    Values are chosen where no other origin is given.

    min_periods: lowest frequency that is used, in periods per frame. The window and slow trends of
        the picture dominate the frequencies below.
    max_signal_to_noise: ratio of signal to noise power below which a frequency shows the noise
        alone.
    min_noise_frequencies: number of such frequencies from which the noise is taken from them alone.
    least_evidence: logarithm of the likelihood ratio, per frequency, from which the PSF's error is
        believed. Of 480 photographs with exact PSFs, it is 0.008 at most, with measured ones 0.013
        to 0.08.
    least_total_evidence: the same for all frequencies together: 345 at most with exact PSFs, with
        measured ones on frames of 255 pixels 411 and more.
    least_harm: standard deviation of noise and error over that of the noise from which the error is
        believed. Where the evidence with an exact PSF is above 220, it is 1.05 at most; with
        measured ones it is 1.29 and more.
    model_error_factor: factor on the noise if there is such an error. Measured: the best of 1 to 3
        in the mean of 33 photographs with PSFs that were disturbed by random errors.
    flat_share: share of the photograph's blocks that are taken to be flat.
    flat_block: pixels along a side of a block.
    flat_ratio: noise over that of flat blocks below which the spectrum's noise isn't believed: the
        power law has taken it for detail.
    """

    min_periods: int = 3
    max_signal_to_noise: float = 0.1
    min_noise_frequencies: int = 300
    least_evidence: float = 0.008
    least_total_evidence: float = 280.0
    least_harm: float = 1.15
    model_error_factor: float = 1.5
    flat_share: float = 0.1
    flat_block: int = 16
    flat_ratio: float = 0.45


_SETTINGS = SpectrumFitSettings()


@dataclass(frozen=True)
class WienerPrediction:
    """What the Wiener filter is predicted to find in a photograph.

    explained_share: share of the data that the filter explains.
    gradient: rms length of the found picture's gradient, in light per pixel, times the sum of the
        PSF.
    """

    explained_share: float
    gradient: float


@dataclass(frozen=True)
class PowerLaw:
    """A photograph's modelled power spectrum, |H|² strength / frequency^slope + noise_variance.

    `strength` and `noise_variance` are variances per pixel of the photograph; the frequency is in
    cycles per pixel. `model_error_variance` is the variance that the PSF's error adds, expressed as
    white noise that does as much harm.
    """

    strength: float
    slope: float
    noise_variance: float
    model_error_variance: float = 0.0

    @property
    def total_variance(self) -> float:
        """The variance of noise and model error, against which a prior is weighed."""
        return self.noise_variance + self.model_error_variance

    def in_unit(self, unit: float) -> PowerLaw:
        """Return the law for light in another unit, in which this one's unit is `unit`."""
        square = unit * unit
        return PowerLaw(
            self.strength * square,
            self.slope,
            self.noise_variance * square,
            self.model_error_variance * square,
        )

    def wiener_prediction(
        self, squared_mtf: torch.Tensor, shape: tuple[int, int]
    ) -> WienerPrediction:
        """Predict what the filter of least mean square error finds (Wiener 1949).

        squared_mtf: |H|² on the rfft2 grid of a period of `shape`.
        """
        squares = squared_frequencies(shape).to(squared_mtf)
        squares[0, 0] = max(shape) ** -2
        scene = self.strength * squares ** (-self.slope / 2)
        share = scene * squared_mtf / (scene * squared_mtf + max(self.total_variance, 1e-30))
        # The squared transfer function of differences between neighbours is 4 sin²(π f) per axis,
        # which is about (2 π f)² at low frequencies and no more than 8 for both axes.
        steep = (4 * math.pi**2 * squares).clamp(max=8)
        weight = rfft_column_weights(shape[1]).to(share) / math.prod(shape)
        return WienerPrediction(
            float((share * weight).sum()),
            math.sqrt(float((scene * share * steep * weight).sum())),
        )


@torch.no_grad()
def fit_power_law(
    image: torch.Tensor, psf: torch.Tensor, *, finds_model_error: bool = True
) -> PowerLaw:
    """Fit a power law and white noise to a blurred photograph's spectrum.

    The spectrum of the frame, with a Hann window, is modelled as the sum of white noise and of a
    scene blurred by the PSF, whose power falls as a power of the frequency. Strength, slope and
    noise maximise the likelihood of independent, exponentially distributed powers (Whittle 1953).
    Frequencies that the PSF suppresses show the noise. Power that is left there and falls with the
    frequency is the scene, blurred by the error of the PSF. In a photograph without blur, the
    finest detail of the scene counts as noise.

    image: (rows, columns).
    psf: has a sum of 1.
    finds_model_error: False where pixels were filled in, which the PSF doesn't explain either.
    """
    transfer = transfer_function(psf.to(image), (image.shape[0], image.shape[1]))
    law = fit_power_law_with_mtf(
        image, squared_modulus(transfer), finds_model_error=finds_model_error
    )
    flat = (
        flat_block_noise([image], _SETTINGS.flat_share)
        if min(image.shape) > 2 * _SETTINGS.flat_block + 1
        else 0.0
    )
    if law.total_variance >= (_SETTINGS.flat_ratio * flat) ** 2:
        return law
    return PowerLaw(law.strength, law.slope, flat**2)


@torch.no_grad()
def flat_block_noise(planes: Sequence[torch.Tensor], share: float) -> float:
    """Estimate noise from the flattest blocks; 0 for fewer than three rows or columns.

    Second differences tell it (Immerkaer 1996, doi 10.1006/cviu.1996.0060). The noise is the one
    for which white noise has the variance that is found at the low quantile `share` of all blocks.
    """
    found = torch.cat([_block_powers(plane.to(torch.float64)) for plane in planes])
    if not len(found):
        return 0.0
    side = _SETTINGS.flat_block
    # Neighbouring second differences of white noise are correlated. Along an axis, this number of
    # them counts as one independent sample: the sum of the squared correlation coefficients.
    count = (side / (1 + 2 * ((4 / 6) ** 2 + (1 / 6) ** 2))) ** 2
    # The quantile of the chi-squared distribution, which the powers of blocks of noise have.
    expected = 2 * float(gammaincinv(count / 2, share)) / count if len(found) * share > 1 else 1.0
    return math.sqrt(float(torch.quantile(found, share)) / expected)


def _block_powers(image: torch.Tensor) -> torch.Tensor:
    """Return the power of second differences in each block, where white noise has its variance."""
    if min(image.shape) < 3:
        return image.new_empty(0)
    down = image[2:] - 2 * image[1:-1] + image[:-2]
    both = down[:, 2:] - 2 * down[:, 1:-1] + down[:, :-2]
    side = min(_SETTINGS.flat_block, *both.shape)
    rows, columns = (n // side for n in both.shape)
    blocks = both[: rows * side, : columns * side].reshape(rows, side, columns, side)
    return blocks.square().mean((1, 3)).flatten() / 36


@torch.no_grad()
def fit_power_law_with_mtf(
    image: torch.Tensor,
    squared_mtf: torch.Tensor,
    region: torch.Tensor | None = None,
    *,
    finds_model_error: bool = True,
) -> PowerLaw:
    """Fit a power law and white noise to a spectrum, given an MTF: see fit_power_law().

    squared_mtf: on the photograph's rfft2 grid; for several PSFs the mean of their squared MTFs.
    region: smooth window, (rows, columns), around the part of the photograph that is used.
    """
    spectrum = PhotographSpectrum.of(image, region)
    if spectrum is None:
        return PowerLaw(0.0, 2.0, float(image.var(correction=0)) if image.numel() > 1 else 0.0)
    return _fit_binned_spectrum(
        spectrum.bins(squared_mtf), spectrum.count, finds_model_error=finds_model_error
    )


@dataclass(frozen=True, eq=False)
class PhotographSpectrum:
    """The power spectrum of a blurred photograph, to which laws are fitted.

    shape: (rows, columns) of the photograph.
    used: indices of the frequencies that are used, in the flattened rfft2 grid.
    power: power of these frequencies, of which white noise has its variance.
    squares: squares of these frequencies, (cycles/pixel)².
    weight: a half for frequencies whose conjugate is on the grid as well, and else 1. Without it, a
        picture that is turned would have another spectrum.
    """

    shape: tuple[int, int]
    used: torch.Tensor
    power: torch.Tensor
    squares: torch.Tensor
    weight: torch.Tensor

    @classmethod
    def of(
        cls, image: torch.Tensor, region: torch.Tensor | None = None
    ) -> PhotographSpectrum | None:
        """Compute the spectrum of a photograph; None for one without structure.

        region: as for fit_power_law_with_mtf().
        """
        shape = int(image.shape[0]), int(image.shape[1])
        rounding = 1e-7 * float(image.abs().max()) if image.numel() else 0.0
        if min(shape) < 2 * _SETTINGS.min_periods + 2 or float(image.std()) <= rounding:
            return None
        power, squares = _windowed_periodogram(image, region), squared_frequencies(shape).to(image)
        used = (squares > (_SETTINGS.min_periods / min(shape)) ** 2).flatten().nonzero()[:, 0]
        weight = (rfft_column_weights(shape[1]).to(image) / 2).expand(squares.shape)
        each = (one.flatten()[used] for one in (power, squares, weight))
        return cls(shape, used, *each)

    @property
    def count(self) -> float:
        """The number of different frequencies that are used."""
        return float(self.weight.sum())

    def seen_mtf(self, squared_mtf: torch.Tensor) -> torch.Tensor:
        """Return the squared MTF of the used frequencies, as the photograph's window smooths it."""
        smooth = _smooth_by_window(squared_mtf.to(self.power), self.shape[1])
        return smooth.flatten()[self.used]

    def bins(self, squared_mtf: torch.Tensor) -> SpectrumBins:
        """Average the spectrum over similar frequencies and MTFs."""
        return SpectrumBins.of(self.power, self.squares, self.seen_mtf(squared_mtf), self.weight)

    def log_likelihood(self, psf: torch.Tensor) -> float:
        """Return the largest log-likelihood of the spectrum for a PSF with a sum of 1.

        The law is that of fit_power_law(), without an error of the PSF.
        """
        transfer = transfer_function(psf.to(self.power), self.shape)
        seen = self.seen_mtf(squared_modulus(transfer))
        law = _fit_plain_law(SpectrumBins.of(self.power, self.squares, seen, self.weight))
        model = law.strength * seen * self.squares.pow(-law.slope / 2) + law.noise
        each = (model.log() + self.power / model) * self.weight
        return -float(each.sum(dtype=torch.float64))


def _smooth_by_window(squared_mtf: torch.Tensor, columns: int) -> torch.Tensor:
    """Smooth a squared MTF as the Hann window smooths a photograph's power spectrum.

    The window's spectrum has three samples along an axis, whose squares are as 1 : 4 : 1. Without
    this step, zeros of the MTF seem to let light through.

    squared_mtf: on the rfft2 grid of a frame with `columns` columns.
    """
    along_y = (squared_mtf.roll(1, 0) + squared_mtf.roll(-1, 0) + 4 * squared_mtf) / 6
    # Beyond the ends of the half spectrum, it continues with the rows in reverse.
    mirrored = torch.cat([along_y[:1], along_y[1:].flip(0)])
    last = mirrored[:, -1 if columns % 2 else -2]
    wide = torch.cat([mirrored[:, 1:2], along_y, last[:, None]], 1)
    return (wide[:, :-2] + wide[:, 2:] + 4 * along_y) / 6


def _windowed_periodogram(image: torch.Tensor, region: torch.Tensor | None) -> torch.Tensor:
    """Compute the power spectrum with a Hann window, in which white noise has its variance."""
    rows, columns = (torch.hann_window(n + 2, False, dtype=image.dtype)[1:-1] for n in image.shape)
    window = rows[:, None] * columns
    if region is not None:
        window = window * region.to(window)
    square = window.square()
    detail = (image - (image * square).sum() / square.sum()) * window
    spectrum = rfft2(detail)
    return squared_modulus(spectrum) / square.sum()


def squared_frequencies(shape: tuple[int, int]) -> torch.Tensor:
    """Return the squared frequencies of an rfft2 grid, (cycles/pixel)², float64."""
    fy, fx = rfft2_frequencies(Plane(shape, (1.0, 1.0)))
    return fy.square() + fx.square()


def _fit_plain_law(pools: SpectrumBins) -> SpectrumLaw:
    """Fit the law without an error of the PSF.

    The likelihood is maximised from two initial noise levels, and the likelier fit is kept.
    """
    lowest = max(float(pools.power.min()), 1e-30)
    return min(
        (pools.fit(pools.initial_law(lowest * share)) for share in (1.0, 0.03)),
        key=pools.negative_log_likelihood,
    )


def _fit_binned_spectrum(pools: SpectrumBins, count: float, *, finds_model_error: bool) -> PowerLaw:
    """Fit a power law and noise to a binned spectrum.

    The noise of the likeliest law is replaced by the mean power above the signal at frequencies
    where the signal is weak. Another fit looks there for light that falls with the frequency, which
    the PSF's error leaves.

    count: number of all frequencies.
    """
    plain = _fit_plain_law(pools)
    noise = _noise_at_quiet_frequencies(pools, plain, count)
    if finds_model_error and (law := _law_with_model_error(pools, plain, count)):
        total = _SETTINGS.model_error_factor**2 * pools.harmful_variance(law)
        return PowerLaw(law.strength, law.slope, noise, max(total - noise, 0.0))
    return PowerLaw(plain.strength, plain.slope, noise)


def _noise_at_quiet_frequencies(pools: SpectrumBins, law: SpectrumLaw, count: float) -> float:
    """Return the mean power above a weak signal, or the law's noise if too few bins are quiet.

    count: number of all frequencies.
    """
    noise, signal = law.noise, pools.signal_power(law)
    for _ in range(3):
        quiet = signal < _SETTINGS.max_signal_to_noise * noise
        share = pools.share[quiet]
        if float(share.sum()) * count < _SETTINGS.min_noise_frequencies:
            break
        left = share * (pools.power[quiet] - signal[quiet])
        noise = max(float(left.sum() / share.sum()), 0.1 * noise)
    return noise


def _law_with_model_error(
    pools: SpectrumBins, plain: SpectrumLaw, count: float
) -> SpectrumLaw | None:
    """Fit the law with the error of the PSF; None without evidence of such an error.

    count: number of all frequencies.
    """
    law = min(
        (pools.fit(pools.with_model_error(plain, slope)) for slope in (1.0, 2.5)),
        key=pools.negative_log_likelihood,
    )
    evidence = pools.negative_log_likelihood(plain) - pools.negative_log_likelihood(law)
    least = max(_SETTINGS.least_evidence, _SETTINGS.least_total_evidence / count)
    harm = pools.harmful_variance(law) / plain.noise
    return law if evidence > least and harm > _SETTINGS.least_harm**2 else None
